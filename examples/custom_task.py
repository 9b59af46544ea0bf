"""A task of one's own in 20 lines, with the motion models that are there: nothing is trained.

    python examples/custom_task.py --episodes 20

To keep it, put the class into a package of yours: `hpp new task` writes one to start from.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core.task import Task, relative_speed
from hpp_framework.evaluation.experiment import Experiment, run_experiment
from hpp_framework.plugins.registry import hub


class MeetAtDoor(Task):
    """All robots within 1 m of a door, at rest."""

    def __init__(self, door: tuple[float, float]) -> None:
        self.door = torch.tensor(door)

    def _distances(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b n"]:
        return (poses[..., :2] - self.door.to(poses)).norm(dim=-1)

    def reward(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b"]:
        """Return minus the distances that are left."""
        return -(self._distances(poses) - 1).clamp(min=0).sum(-1)

    def success(
        self, poses: Float[Tensor, "*b n 3"], velocities: Float[Tensor, "*b n 2"] | None = None
    ) -> Bool[Tensor, "*b"]:
        """Return whether all robots are there, and at rest where their velocities are told."""
        near = (self._distances(poses) < 1).all(-1)
        return near if velocities is None else near & (relative_speed(poses, velocities) < 0.1)


def main() -> None:
    """Register the task in this process and evaluate a planner on it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--door", type=float, nargs=2, default=(2.0, 2.0), help="x and y in metres")
    parser.add_argument("--out", type=Path, default=Path("out/custom-task"))
    given = parser.parse_args()

    hub().tasks.add("meet-at-door", lambda robots: MeetAtDoor(tuple(given.door)), summary="meet at a door")
    experiment = Experiment(
        worlds=("simple",), planners=("hpp",), task="meet-at-door", episodes=given.episodes, seed=5001
    )
    (cell,) = run_experiment(experiment, given.out)["cells"]
    print(f"{cell['success']:.2f} of {cell['episodes']} episodes ended with all robots at {given.door}")


if __name__ == "__main__":
    main()
