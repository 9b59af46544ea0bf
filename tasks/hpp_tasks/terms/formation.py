"""The term ``formation``: how far robots are from their places in a shape, wherever that is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.requirement import Gathering, Requirement
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import any_heading
from hpp_framework.core.term import Term
from hpp_framework.utils.errors import ConfigError, unknown_name
from hpp_tasks.terms.assignment import MOST_TURNED, nearest_roles, turned_roles
from hpp_tasks.terms.shapes import Offsets, line, ring, turned

ROLES = ("nearest", "fixed")
SPACING = 1.2
"""Metres between neighbours, unless a task says otherwise."""

SHAPES = {"line": line, "ring": ring}


@dataclass(frozen=True)
class Form:
    """A shape and what about it is free.

    Attributes:
        offsets: places, metres.
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


def fitted(form: Form, positions: Float[Tensor, "*b n 2"]) -> Float[Tensor, "*b n 2"]:
    """Return each robot's place in the shape as it fits best about a point, metres from that.

    Args:
        form: the shape.
        positions: of the robots about the point, metres.
    """
    offsets = form.offsets.to(positions)
    if form.nearest:
        choose = turned_roles if form.turn else nearest_roles
        taken = offsets[choose(positions, offsets)]
    else:
        taken = offsets.expand_as(positions)
    return turned(taken, positions) if form.turn else taken


class Formation(Term):
    """How far each robot is from its place in a shape around the team's centre.

    Roles and turn are those of the least sum of squares, so that planners and judges agree on them.

    Args:
        form: the shape.
    """

    def __init__(self, form: Form) -> None:
        self.form = replace(form, offsets=form.offsets - form.offsets.mean(0))
        self.offsets = self.form.offsets

    def errors(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b n"]:
        """Return the distances, metres."""
        off = poses[..., :2] - poses[..., :2].mean(-2, keepdim=True)
        missed = off - fitted(self.form, off)
        return torch.hypot(missed[..., 0], missed[..., 1])

    def targets(
        self, goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"]
    ) -> Float[Tensor, "*c n 3"]:
        """Return the places of the shape around a goal; roles and turn do not depend on the goal.

        The sum of squared distances to places around any point differs from that around the team's centre
        only by what is the same for all roles and turns.
        """
        off = poses[..., :2] - poses[..., :2].mean(-2, keepdim=True)
        return any_heading(goals[..., None, :] + fitted(self.form, off))

    def requirement(self, limit: float) -> Requirement:
        """Return that all robots are as near to the team's centre as the shape is large."""
        return Gathering(float(self.offsets.norm(dim=-1).max()) + limit)


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
