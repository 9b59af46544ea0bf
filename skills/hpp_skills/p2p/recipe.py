"""Everything that decides how a point-to-point policy turns out, in one place that a search can reach."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from hpp_framework.config.settings import altered
from hpp_framework.envs.problem import DomainRandomisation, PointToPoint
from hpp_framework.training.ppo import PpoConfig
from hpp_skills.p2p.network import NetworkShape


@dataclass(frozen=True, kw_only=True)
class Rooms:
    """The training worlds.

    Attributes:
        world: registered world, from easy to hard if its generator takes a ``difficulty``.
        count: how many different ones.
        goals: places in each that robots are sent to.
        margin: metres by which robots are thicker than they are, so that they learn to keep off.
        clearance: gap between such a robot at a start or goal and the nearest obstacle, in metres.
        comfort: gap to obstacles that the rewarded path prefers to keep, in metres.
        robots: trained side by side.
        robots_per_world: that share a world and are in each other's way.
        first_share: part of the worlds, the easiest, that training begins with.
        all_from: share of the training after which all worlds are used.
    """

    world: str = "mixed"
    count: int = 2000
    goals: int = 6
    margin: float = 0.03
    clearance: float = 0.03
    comfort: float = 0.3
    robots: int = 512
    robots_per_world: int = 2
    first_share: float = 0.3
    all_from: float = 0.3


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How a policy is trained.

    Attributes:
        reward: the problem and what is rewarded.
        randomisation: disturbances, drawn anew with each world.
        rooms: where.
        network: how large.
        ppo: how it learns.
    """

    RENAMED: ClassVar[Mapping[str, str]] = {"practice": "randomisation"}

    reward: PointToPoint = field(default_factory=lambda: PointToPoint(
        goal_distance=(0.5, 12.0), max_steps=200, progress=1.0, arrival=3.0, collision=-2.5, touch=-0.2,
        step=-0.05, turn=-0.005, linger=0.3,
    ))  # fmt: skip
    randomisation: DomainRandomisation = field(default_factory=DomainRandomisation)
    rooms: Rooms = field(default_factory=Rooms)
    network: NetworkShape = field(default_factory=NetworkShape)
    ppo: PpoConfig = field(
        default_factory=lambda: PpoConfig(learning_rate=5e-4, n_epochs=3, log_std_final=-2.3)
    )

    def altered(self, settings: Mapping[str, Any]) -> Recipe:
        """Return a copy with other settings.

        Args:
            settings: values by dotted name, e.g. ``{"reward.touch": -0.4, "network.hidden": 64}``.

        Raises:
            ConfigError: if a name is unknown, or a value is of another type than the one it replaces.
        """
        return altered(self, settings, "the recipe")


GOING_ON: Mapping[str, Any] = {
    "ppo.learning_rate": 3e-4, "ppo.log_std_init": -1.5, "rooms.first_share": 1.0,
    "randomisation.detours": 0.3,
}  # fmt: skip
"""Settings of a training that goes on from trained weights: small steps and little exploration keep what the
policy knows, and navigation tasks are harder."""
