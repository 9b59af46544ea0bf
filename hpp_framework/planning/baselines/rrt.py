"""Paths by rapidly-exploring random trees (LaValle 1998), grown by OMPL; its only import.

OMPL draws its random numbers from one generator per process. Each search here begins by seeding it, and
builds all that draws from it anew, so that a search depends on its own seed only. Searches are bounded by
iterations, not by time, for the same reason. They must not run in several threads at once.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, cast, get_args

import numpy as np
import numpy.typing as npt

from hpp_framework.planning.baselines.rrt_map import Room
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.validation import Count, Positive, Share, validated

if TYPE_CHECKING:
    from ompl import base, geometric

Algorithm = Literal["rrt", "rrt-connect", "rrt-star"]
ALGORITHMS: tuple[Algorithm, ...] = get_args(Algorithm)
CHECK_EVERY = 0.05
"""Metres between two points of a motion that are checked."""
ARRIVED = 0.05
"""Metres from the goal at which a tree has reached it."""


@validated
class TreeConfig:
    """How trees grow.

    Attributes:
        algorithm: ``"rrt"``, ``"rrt-connect"`` (a second tree from the goal) or ``"rrt-star"`` (rewires, and
            always takes all iterations).
        step: longest edge, metres.
        goal_bias: share of the samples that are the goal; ``"rrt-connect"`` has none.
        iterations: samples of a tree, at most.
        tries: trees a search; the shortest path counts.
        simplify: whether to cut corners of the path afterwards.
    """

    algorithm: Algorithm = "rrt"
    step: Positive = 1.0
    goal_bias: Share = 0.05
    iterations: Count = 2000
    tries: Count = 3
    simplify: bool = True


@dataclass(frozen=True)
class Tree:
    """A tree that covers what can be reached from its root.

    Attributes:
        points: (v, 2) its nodes in metres, in no order.
        parents: (v,) index of the node that each was reached from; the root is its own.
    """

    points: npt.NDArray[np.float64]
    parents: npt.NDArray[np.int64]


def require_ompl() -> None:
    """Check that OMPL is there.

    Raises:
        ConfigError: if it is not installed.
    """
    try:
        importlib.import_module("ompl")
    except ImportError as error:
        raise ConfigError("the planners rrt-* need OMPL: pip install hpp-framework[planning]") from error


def find_path(
    room: Room, start: npt.NDArray[np.floating], goal: npt.NDArray[np.floating], config: TreeConfig, seed: int
) -> npt.NDArray[np.float64] | None:
    """Return a path (p, 2) from start to goal, or None if no tree reached the goal.

    Args:
        room: where there is room.
        start: where the path begins, metres.
        goal: where it ends, metres.
        config: how trees grow.
        seed: of the search, positive.
    """
    from ompl import geometric

    if not bool(room.fits(np.stack([start, goal])).all()):
        return None
    space = _space(room, seed)
    best: geometric.PathGeometric | None = None
    for _ in range(config.tries):
        problem = _problem(space, start, goal)
        _grow(problem, space, config)
        # an approximate solution, which ends somewhere else, does not count
        if not problem.hasExactSolution():
            continue
        path = cast("geometric.PathGeometric", problem.getSolutionPath())
        if config.simplify:
            geometric.PathSimplifier(space).simplifyMax(path)
        if best is None or path.length() < best.length():
            best = path
    return None if best is None else np.array([*map(_pair, best.getStates()[:-1]), goal])


def grow_tree(room: Room, start: npt.NDArray[np.floating], config: TreeConfig, seed: int) -> Tree:
    """Grow a plain RRT from a free place into all directions, with all the iterations there are.

    Args:
        room: where there is room.
        start: the root, metres.
        config: its ``step`` and ``iterations`` count.
        seed: of the tree, positive.
    """
    from ompl import base

    space = _space(room, seed)
    nowhere = np.array(room.corners()[1]) + 1e3
    planner = _grow(_problem(space, start, nowhere), space, replace(config, algorithm="rrt", goal_bias=0.0))
    data = base.PlannerData(space)
    planner.getPlannerData(data)
    count = data.numVertices()
    points = np.array([_pair(data.getVertex(node).getState()) for node in range(count)])
    incoming = [data.getIncomingEdges(node) for node in range(count)]
    return Tree(points, np.array([edges[0] if edges else node for node, edges in enumerate(incoming)]))


def _space(room: Room, seed: int) -> base.SpaceInformation:
    """Describe the room to OMPL, and seed what it draws."""
    from ompl import base, util

    # OMPL complains about a second seed, though it heeds it
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed)
    plane = base.RealVectorStateSpace(2)
    limits = base.RealVectorBounds(2)
    for axis, (low, high) in enumerate(zip(*room.corners(), strict=True)):
        limits.setLow(axis, low)
        limits.setHigh(axis, high)
    plane.setBounds(limits)
    space = base.SpaceInformation(plane)
    space.setStateValidityChecker(_checker(room))
    space.setStateValidityCheckingResolution(CHECK_EVERY / plane.getMaximumExtent())
    space.setup()
    return space


def _checker(room: Room) -> Callable[[base.State], bool]:
    """Return the look-up that is most of the work: no numpy, which is slow for single numbers."""
    cells, columns = (room.slack > 0).tobytes(), room.slack.shape[1]
    (left, bottom), cells_a_metre = room.origin, 1 / room.resolution

    def fits(state: Any) -> bool:
        row = int((state[1] - bottom) * cells_a_metre)
        return cells[row * columns + int((state[0] - left) * cells_a_metre)] > 0

    return fits


def _problem(
    space: base.SpaceInformation, start: npt.NDArray[np.floating], goal: npt.NDArray[np.floating]
) -> base.ProblemDefinition:
    from ompl import base

    problem = base.ProblemDefinition(space)
    states: tuple[Any, Any] = (space.allocState(), space.allocState())
    for state, point in zip(states, (start, goal), strict=True):
        state[0], state[1] = float(point[0]), float(point[1])
    problem.setStartAndGoalStates(*states, ARRIVED)
    return problem


def _grow(problem: base.ProblemDefinition, space: base.SpaceInformation, config: TreeConfig) -> base.Planner:
    """Grow one tree until it solves the problem or has had its iterations."""
    from ompl import base, geometric

    kinds = {"rrt": geometric.RRT, "rrt-connect": geometric.RRTConnect, "rrt-star": geometric.RRTstar}
    tree = kinds[config.algorithm](space)
    tree.setRange(config.step)
    if not isinstance(tree, geometric.RRTConnect):
        tree.setGoalBias(config.goal_bias)
    tree.setProblemDefinition(problem)
    tree.setup()
    samples = iter(range(config.iterations))
    tree.solve(base.PlannerTerminationCondition(lambda: next(samples, None) is None))
    return tree


def _pair(state: Any) -> tuple[float, float]:
    # Any: the stubs of OMPL give states no elements
    return state[0], state[1]
