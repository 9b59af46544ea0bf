"""Pictures of tasks: an episode each from above, with the paths that the robots took.

The picture of the documentation is drawn by::

    python -m hpp_framework.evaluation.task_pictures docs/images/tasks.png examples/tasks
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hpp_framework.config.task_file import task_name
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.evaluation.experiment import Experiment
from hpp_framework.evaluation.replay import replay
from hpp_framework.viz.backdrop import Image
from hpp_framework.viz.topdown import TopDown, close_view
from hpp_framework.viz.world_pictures import save_picture, tiled
from hpp_framework.worlds.loader import resolve_world

SIDE = 420
COLUMNS = 3
AROUND = 1.2
"""Ground shown around everything that happened, metres."""
SEED = 6001
"""Of the episodes shown; those of reports have other seeds."""


def draw_tasks(out: Path, shown: Sequence[Experiment], *, side: int = SIDE) -> Path:
    """Draw the first episode of each experiment's first world and planner into one PNG, three in a row.

    Args:
        out: the picture; its folder is made if need be.
        shown: the experiments.
        side: pixels of each.

    Raises:
        HppError: if an experiment names something wrong, or the file cannot be written.
    """
    return save_picture(out, tiled([_ended(experiment, side) for experiment in shown], COLUMNS))


def _ended(experiment: Experiment, side: int) -> Image:
    """Return a picture of how an episode ended."""
    (ran,) = replay(experiment, resolve_world(experiment.worlds[0]), [0])
    last = int(ran.episodes.last_step()[0])
    poses = ran.episodes.poses[0, : last + 1].double().numpy()
    world = ran.worlds[0]
    view = TopDown(world, ran.team.robots, size=(side, side), view=close_view(world, poses, AROUND))
    title = task_name(experiment.task) + ("" if int(ran.episodes.done_step[0]) >= 0 else " (not fulfilled)")
    return view.frame(poses[-1], trails=np.asarray(poses), clock=last * CONTROL_PERIOD, title=title)


def _documented(teams: Path) -> list[Experiment]:
    """Return what the documentation shows; teams with a leader or a stranger are files."""
    chosen = (
        ("formation", "wall", "fetch,freight,fetch"),
        ("formation:shape=ring:spacing=1.6", "simple", "fetch,freight,fetch,freight"),
        ("region:x=2:y=3", "wall", "fetch,freight"),
        ("handover", "wall", "fetch,freight"),
        ("dispersion", "simple", "fetch,freight,fetch"),
        ("follow:leader=leader", "simple", str(teams / "escort.yaml")),
        ("pursuit:stranger=stranger", "simple", str(teams / "chase.yaml")),
        (str(teams / "meet_at_corner.yaml"), "wall", "alice=fetch,bob=freight"),
        ("rendezvous", "wall", "fetch,freight,fetch,freight"),
    )
    return [
        Experiment(worlds=(world,), planners=("hpp",), team=team, task=task, seed=SEED, episodes=1)
        for task, world, team in chosen
    ]


if __name__ == "__main__":
    draw_tasks(Path(sys.argv[1]), _documented(Path(sys.argv[2])))
