"""Terms: single things that a team is judged by. Tasks are composed of them, by code or by a YAML file.

A term says how far each robot, or each pair, is from what is wanted::

    term = hub().terms.create("spacing", robots, least=0.8)
    errors = term.errors(poses)

A composed task (:mod:`hpp_framework.core.composition`) pays minus the weighed sum of the errors, and is met
where no error exceeds a limit.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.requirement import Requirement
from hpp_framework.core.task import Terminal


class Term(ABC):
    """One thing that a team is judged by; pure and batched."""

    @abstractmethod
    def errors(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b k"]:
        """Return how far each robot or pair is from what is wanted: 0 where it is, in the term's own unit.

        Args:
            poses: of the team, world frame; headings are NaN where a predictor has none, and must then count
                as right.
        """

    def targets(
        self, goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"]
    ) -> Float[Tensor, "*c n 3"] | None:
        """Return each robot's target for a shared goal; see :meth:`hpp_framework.core.task.Task.targets`."""
        del goals, poses
        return None

    def terminal(self, poses: Float[Tensor, "b n 3"]) -> Terminal | None:
        """Return which teams finish now; see :meth:`hpp_framework.core.task.Task.terminal`."""
        del poses
        return None

    def requirement(self, limit: float) -> Requirement | None:
        """Return what holds wherever no error exceeds a limit, for lower bounds; None if unknown."""
        del limit
        return None
