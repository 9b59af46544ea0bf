"""Motion as RRT+CEM imagines it: all robots follow RRT paths through what the asking robot knows.

There is one tree per robot and observation, and every goal is reached from its nodes. This costs a fraction
of one tree per candidate. Goals near each other then also get like paths.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.predictor import Imagine, Predictor
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.types import Observation, Trajectories
from hpp_framework.planning.baselines.rrt import Tree, TreeConfig, grow_tree
from hpp_framework.planning.baselines.rrt_map import Points, Room, room_for
from hpp_framework.prediction.empty_world import observed_velocities
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.validation import Count, Positive, validated
from hpp_framework.worlds.occupancy import FreeSpace

NEIGHBOURS = 5
"""Nodes nearest to a goal from which it is tried to be reached."""
FOREBEARS = 2
"""Of each, so many nodes before it are tried too."""
CORNERS_CUT = 6
"""Rounds in which every node is joined to the parent of its parent if nothing is between them."""


@validated
class MotionConfig:
    """How all robots are imagined to move.

    Attributes:
        period: seconds per prediction step.
        speed: at which robots follow paths once they have got there from their present speed, m/s.
        samples: of a tree.
    """

    period: Positive = 1.0
    speed: Positive = 0.7
    samples: Count = 600


class RrtPredictor(Predictor):
    """All robots go along RRT paths; no weights, nothing learned.

    Args:
        robots: the team.
        margin: gap between footprints and obstacles that paths keep, metres.
        config: how all robots move.
    """

    def __init__(self, robots: Sequence[RobotSpec], margin: float, config: MotionConfig) -> None:
        self.robots = tuple(robots)
        self.margin = margin
        self.config = config
        self._spaces: Sequence[FreeSpace] = ()
        self._seeds: Sequence[int] = ()

    def prepare(self, spaces: Sequence[FreeSpace], seeds: Sequence[int]) -> None:
        """Take note of what the asking robot knows in each episode, and of the seeds of the next trees."""
        self._spaces, self._seeds = spaces, seeds

    def rollout(self, observation: Observation, goals: Float[Tensor, "b g 2"], horizon: int) -> Trajectories:
        """Imagine the motion of the team; headings are NaN."""
        return self.condition(observation, horizon)(goals)

    def condition(self, observation: Observation, horizon: int) -> Imagine:
        """Grow the trees once for many calls.

        Raises:
            ConfigError: if :meth:`prepare` was not called for as many episodes as are observed.
        """
        positions = observation.team_poses[..., :2].double().cpu().numpy()
        if not len(positions) == len(self._spaces) == len(self._seeds):
            raise ConfigError("the RRT predictor was not prepared for these episodes; call prepare() first.")
        times = torch.arange(1, horizon + 1) * self.config.period
        arcs = self._arcs(observation, times)
        paths = [
            [self._paths(robot, space, positions[row, i], seed) for i, robot in enumerate(self.robots)]
            for row, (space, seed) in enumerate(zip(self._spaces, self._seeds, strict=True))
        ]

        def imagine(goals: Float[Tensor, "b g 2"]) -> Trajectories:
            wanted = goals.double().cpu().numpy()
            places = [
                np.stack([path.towards(wanted[row], arcs[row, i]) for i, path in enumerate(team)], -2)
                for row, team in enumerate(paths)
            ]
            xy = torch.from_numpy(np.stack(places)).to(goals)
            return Trajectories(torch.cat([xy, torch.full_like(xy[..., :1], torch.nan)], -1), times.to(goals))

        return imagine

    def _arcs(self, observation: Observation, times: Tensor) -> npt.NDArray[np.float64]:
        """Return how far each robot has gone after each time: (b, n, t) metres."""
        most = self.config.speed
        speed = observed_velocities(observation)[..., :1].clamp(0, most).cpu()
        gain = torch.tensor([robot.drive.acceleration for robot in self.robots])[:, None]
        rising = torch.minimum(times, (most - speed) / gain)
        return (speed * rising + gain * rising.square() / 2 + most * (times - rising)).double().numpy()

    def _paths(self, robot: RobotSpec, space: FreeSpace, start: Points, seed: int) -> _Paths:
        room = room_for(space, robot.footprint_radius + self.margin)
        begin = room.nearest(start)
        if begin is None:
            return _Paths(room, Tree(start[None].astype(np.float64), np.zeros(1, np.int64)))
        around = room.around(begin)
        tree = grow_tree(around, begin, TreeConfig(iterations=self.config.samples), seed)
        return _Paths(around, tree)


class _Paths:
    """The paths of one robot from the root of its tree to any goal.

    Args:
        room: where it fits.
        tree: through the room.
    """

    def __init__(self, room: Room, tree: Tree) -> None:
        self.room = room
        self.points = tree.points
        self.root = int((tree.parents == np.arange(len(tree.parents))).argmax())
        self.parents = self._cut_corners(tree.parents)
        self.lengths = self._lengths()

    def towards(self, goals: Points, arcs: Points) -> Points:
        """Return where the robot is (g, t, 2) when it has gone so far (t,) towards each goal (g, 2).

        Where a goal cannot be reached, the path ends at the node nearest to it.
        """
        nodes, ends = self._last_nodes(goals)
        places = _along(self.points[nodes], ends, arcs - self.lengths[nodes, None])
        while bool((nodes != self.root).any()):
            before = self.parents[nodes]
            on_edge = _along(self.points[before], self.points[nodes], arcs - self.lengths[before, None])
            places = np.where((arcs < self.lengths[nodes, None])[..., None], on_edge, places)
            nodes = before
        return places

    def _last_nodes(self, goals: Points) -> tuple[npt.NDArray[np.int64], Points]:
        """Return the node (g,) from which each goal is reached at the least cost, and the end of the path."""
        away = np.linalg.norm(goals[:, None] - self.points, axis=-1)
        count = min(NEIGHBOURS, len(self.points))
        tried = [np.argpartition(away, count - 1, axis=1)[:, :count]]
        nearest = away.argmin(1)
        for _ in range(FOREBEARS):
            tried.append(self.parents[tried[-1]])
        nodes = np.concatenate(tried, 1)
        rows = np.arange(len(goals))
        clear = self.room.passes(self.points[nodes], goals[:, None]).reshape(nodes.shape)
        cost = np.where(clear, self.lengths[nodes] + away[rows[:, None], nodes], np.inf)
        reached = np.asarray(clear.any(1))
        chosen = np.where(reached, nodes[rows, cost.argmin(1)], nearest)
        return chosen, np.where(reached[:, None], goals, self.points[nearest])

    def _cut_corners(self, parents: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        seen = self.room.passes(self.points[self.root], self.points)
        parents = np.where(seen, self.root, parents)
        for _ in range(CORNERS_CUT):
            farther = parents[parents]
            joined = self.room.passes(self.points[farther], self.points)
            parents = np.where(joined, farther, parents)
        return parents

    def _lengths(self) -> npt.NDArray[np.float64]:
        """Return the length of the path to each node; ancestors are skipped by powers of two."""
        lengths = np.linalg.norm(self.points - self.points[self.parents], axis=-1)
        ancestors = self.parents
        while bool((ancestors != self.root).any()):
            lengths = lengths + lengths[ancestors]
            ancestors = ancestors[ancestors]
        return lengths


def _along(starts: Points, ends: Points, gone: Points) -> Points:
    """Return where one is (g, t, 2) after so many metres (g, t) from starts to ends (g, 2); ends hold."""
    leg = ends - starts
    length = np.linalg.norm(leg, axis=-1)
    share = np.clip(gone / np.maximum(length, 1e-9)[:, None], 0, 1)
    return starts[:, None] + share[..., None] * leg[:, None]
