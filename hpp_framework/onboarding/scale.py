"""How much a newcomer is trained and judged, and how long that takes."""

from __future__ import annotations

from dataclasses import dataclass

from hpp_framework.prediction.collect import Collection
from hpp_framework.utils.errors import ConfigError, unknown_name


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Numbers of an onboarding.

    Attributes:
        skill_steps: control steps of a skill that is trained from nothing.
        further_steps: of one that starts from another robot's weights.
        trajectories: that each pair of robots drives.
        trajectory_steps: control steps of each.
        chunk: trajectories that are simulated and held out together.
        predictor_steps: gradient steps per model.
        batch: samples a gradient step.
        navigation_tasks: navigation tasks per world that each skill is judged by.
        asked: trajectories that predictors are judged by.
        episodes: that each pair is judged by, a world.
        worlds: that pairs are judged in.
    """

    skill_steps: int = 6_000_000
    further_steps: int = 2_000_000
    trajectories: int = 10_000
    trajectory_steps: int = 100
    chunk: int = 500
    predictor_steps: int = 10_000
    batch: int = 500
    navigation_tasks: int = 300
    asked: int = 100
    episodes: int = 100
    worlds: tuple[str, ...] = ("simple", "wall")

    def __post_init__(self) -> None:
        if self.trajectories < 2 * self.chunk:
            raise ConfigError(
                f"at least {2 * self.chunk} trajectories are needed, so that some can be held out; "
                f"got {self.trajectories}."
            )

    def collection(self, seed: int) -> Collection:
        """Return how the data of a pair are made."""
        return Collection(
            trajectories=self.trajectories, steps=self.trajectory_steps, chunk=self.chunk,
            worlds=max(1, self.chunk // 10), world="varied", seed=seed,
        )  # fmt: skip


SCALES = {
    "smoke": Scale(
        skill_steps=4_000, further_steps=60_000, trajectories=40, trajectory_steps=60, chunk=20,
        predictor_steps=20, batch=50, navigation_tasks=10, asked=5, episodes=5, worlds=("simple",),
    ),
    "standard": Scale(),
}  # fmt: skip
"""``smoke`` shows in minutes that everything works, and teaches models next to nothing. Its skills can drive:
training first makes the weights that it starts from worse, and 60,000 steps make good for that."""


def find_scale(name: str) -> Scale:
    """Return a scale by name.

    Raises:
        UnknownNameError: if there is no such scale.
    """
    if name not in SCALES:
        raise unknown_name("scale", name, SCALES)
    return SCALES[name]


@dataclass(frozen=True)
class Rates:
    """What two shared cores do in a second (docs/performance.md, and an onboarding at scale ``standard``).

    Attributes:
        skill_steps: control steps of skill training.
        rooms: worlds that a skill is trained in, built before it.
        trajectory_steps: control steps of a collected pair.
        predictor_steps: gradient steps of one model, samples of batch 500.
        navigation_tasks: navigation tasks that a skill is judged by.
        episodes: of a pair that plans.
        start: seconds that every stage needs whatever its size.
    """

    skill_steps: float = 11_800
    rooms: float = 30
    trajectory_steps: float = 50_000
    predictor_steps: float = 40
    navigation_tasks: float = 15
    episodes: float = 8
    start: float = 4.0


RATES = Rates()
