"""The term ``formation``: how far robots are from their places in a shape, wherever that is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.errors import ConfigError, unknown_name
from hpp_framework.requirement import AllOf, AnyOf, Apart, Displaced, Requirement
from hpp_framework.robot import RobotSpec
from hpp_framework.term import Term
from hpp_tasks.terms.assignment import MOST_TURNED, nearest_roles, turned_roles
from hpp_tasks.terms.distances import pairs

ROLES = ("nearest", "fixed")
SPACING = 1.2
"""Metres between neighbours, unless a task says otherwise."""

Offsets = Float[Tensor, "n 2"]


def line(count: int, spacing: float) -> Offsets:
    """Return places in a row along x, metres."""
    x = (torch.arange(count) - (count - 1) / 2) * spacing
    return torch.stack([x, torch.zeros_like(x)], -1)


def ring(count: int, spacing: float) -> Offsets:
    """Return places at equal distances on a circle, neighbours ``spacing`` metres from each other."""
    radius = spacing / (2 * math.sin(math.pi / count)) if count > 1 else 0.0
    angles = torch.arange(count) * (2 * math.pi / count)
    return radius * torch.stack([angles.cos(), angles.sin()], -1)


SHAPES = {"line": line, "ring": ring}


@dataclass(frozen=True)
class Form:
    """A shape and what about it is free.

    Attributes:
        offsets: places about their mean, metres.
        nearest: whether any robot may take any place; else the first robot takes the first.
        turn: whether the shape may be turned.
    """

    offsets: Offsets
    nearest: bool = True
    turn: bool = False

    def __post_init__(self) -> None:
        if self.nearest and self.turn and len(self.offsets) > MOST_TURNED:
            raise ConfigError(
                f"a formation of {len(self.offsets)} robots that may turn needs roles=fixed: who takes which "
                f"place is worked out for up to {MOST_TURNED} robots."
            )


class Formation(Term):
    """How far each robot is from its place in a shape around the team's centre.

    Roles and turn are those of the least sum of squares, so that planners and judges agree on them.

    Args:
        form: the shape.
    """

    def __init__(self, form: Form) -> None:
        self.form = form
        self.offsets = form.offsets - form.offsets.mean(0)

    def errors(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b n"]:
        """Return the distances, metres."""
        off = poses[..., :2] - poses[..., :2].mean(-2, keepdim=True)
        missed = off - self.fitted(off)
        return torch.hypot(missed[..., 0], missed[..., 1])

    def fitted(self, positions: Float[Tensor, "*b n 2"]) -> Float[Tensor, "*b n 2"]:
        """Return each robot's place in the shape that fits best, metres from its middle.

        Args:
            positions: about their mean, metres.
        """
        offsets = self.offsets.to(positions)
        if self.form.nearest:
            choose = turned_roles if self.form.turn else nearest_roles
            taken = offsets[choose(positions, offsets)]
        else:
            taken = offsets.expand_as(positions)
        return _turned(taken, positions) if self.form.turn else taken

    def places(
        self, goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"]
    ) -> Float[Tensor, "*c n 2"]:
        """Return the places of the shape around a goal; roles and turn do not depend on the goal.

        The sum of squared distances to places around any point differs from that around the team's centre
        only by what is the same for all roles and turns.
        """
        return goals[..., None, :] + self.fitted(poses[..., :2] - poses[..., :2].mean(-2, keepdim=True))

    def requirement(self, limit: float) -> Requirement:
        """Return how pairs of robots must lie to each other; each may be off by the limit."""
        count, slack = len(self.offsets), 2 * limit
        if not self.form.nearest:
            return AllOf(tuple(self._pair(pair, pair, slack) for pair in pairs(count)))
        if count <= MOST_TURNED:
            return AnyOf(
                tuple(
                    AllOf(tuple(self._pair(p, (roles[p[0]], roles[p[1]]), slack) for p in pairs(count)))
                    for roles in permutations(range(count))
                )
            )
        ordered = list(permutations(range(count), 2))
        return AllOf(
            tuple(AnyOf(tuple(self._pair(p, roles, slack) for roles in ordered)) for p in pairs(count))
        )

    def _pair(self, pair: tuple[int, int], roles: tuple[int, int], slack: float) -> Requirement:
        x, y = (self.offsets[roles[0]] - self.offsets[roles[1]]).tolist()
        if self.form.turn:
            apart = math.hypot(x, y)
            return Apart(*pair, max(apart - slack, 0.0), apart + slack)
        return Displaced(*pair, (x, y), slack)


def _turned(places: Float[Tensor, "*b n 2"], positions: Float[Tensor, "*b n 2"]) -> Float[Tensor, "*b n 2"]:
    """Return places turned about their mean so that they fit positions best (both about their means)."""
    (px, py), (qx, qy) = places.unbind(-1), positions.unbind(-1)
    angle = torch.atan2((px * qy - py * qx).sum(-1), (px * qx + py * qy).sum(-1))[..., None]
    cos, sin = angle.cos(), angle.sin()
    return torch.stack([cos * px - sin * py, sin * px + cos * py], -1)


def formation(
    robots: Sequence[RobotSpec],
    *,
    shape: str = "line",
    spacing: float = SPACING,
    offsets: tuple[Any, ...] = (),
    roles: str = "nearest",
    turn: bool = False,
) -> Formation:
    """Build the term ``formation``.

    Args:
        robots: the team.
        shape: ``"line"`` (along x) or ``"ring"``.
        spacing: of neighbours, metres.
        offsets: a place [x, y] for each robot instead of a shape, metres.
        roles: ``"nearest"``: any robot may take any place; ``"fixed"``: the first robot takes the first.
        turn: whether the shape may be turned.

    Raises:
        ConfigError: if offsets are not a place for each robot, or the spacing is not positive.
        UnknownNameError: if there is no such shape or roles.
    """
    if roles not in ROLES:
        raise unknown_name("kind of roles", roles, ROLES)
    places = _offsets(offsets, len(robots)) if offsets else _shape(shape, len(robots), spacing)
    return Formation(Form(places, nearest=roles == "nearest", turn=turn))


def _shape(shape: str, count: int, spacing: float) -> Offsets:
    if shape not in SHAPES:
        raise unknown_name("shape", shape, SHAPES)
    if not 0 < spacing < math.inf:
        raise ConfigError(f"the spacing of a formation must be positive, got {spacing}.")
    return SHAPES[shape](count, spacing)


def _offsets(offsets: tuple[Any, ...], count: int) -> Offsets:
    try:
        places = torch.tensor([[float(x), float(y)] for x, y in offsets])
    except (TypeError, ValueError) as error:
        raise ConfigError(
            f"offsets must be places like [[0, 0], [1.2, 0]] in metres, got {list(offsets)}."
        ) from error
    if len(places) != count:
        raise ConfigError(f"offsets has {len(places)} places for {count} robots; give one for each.")
    return places
