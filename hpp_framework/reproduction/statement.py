"""How statements of the paper are put together from comparisons of arms."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from hpp_framework.reproduction.claims import Claim, Part
from hpp_framework.reproduction.measures import Arm

SUCCESS = "Success counts as higher if the whole interval of the paired difference is above 0:"
FAILURE = "A planner counts as failing if the whole interval of its success is below 0.5:"
FASTER = (
    "A planner counts as better if its chance to do better on an episode is above 0.5 by the whole interval:"
)
ALIKE = "Planners count as alike if the whole interval of the difference of success is within 0.15 of 0:"


def arms(experiment: str, planners: Sequence[str]) -> list[Arm]:
    """Return planners of an experiment."""
    return [Arm(experiment, planner) for planner in planners]


def statement(
    text: str, where: str, rule: str, parts: Iterable[Part | None], experiments: Sequence[str] = ("main",)
) -> Claim:
    """Return a claim and the parts that could be measured.

    Args:
        text: the statement, in our words.
        where: in the paper.
        rule: what counts as a yes, ending in a colon.
        parts: its comparisons, None where something was not run.
        experiments: that they rest on.
    """
    every = list(parts)
    found = [part for part in every if part is not None]
    return Claim(
        claim=text, where=where, rule=rule, parts=found, experiments=experiments,
        missing=len(every) - len(found),
    )  # fmt: skip


def each(
    compare: Callable[[Arm, Arm, str], Part | None],
    ones: Sequence[Arm],
    others: Sequence[Arm],
    worlds: Sequence[str],
) -> list[Part | None]:
    """Compare every one of some arms with every other arm in every world."""
    return [compare(one, other, world) for world in worlds for one in ones for other in others]
