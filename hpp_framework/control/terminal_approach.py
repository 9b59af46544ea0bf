"""Terminal approach: the last metres to a target, where a skill made for obstacles would circle.

To a skill that drives by lidar, teammates that have arrived are obstacles around its goal: it swerves, drives
round them and never arrives. This layer uses more than the scan: the teammates' poses and footprints.

Once the whole team is near, the planner's goal no longer matters: goals a metre apart are as good, and a
robot that turns from one to the next never arrives. The team is then in its terminal phase and gathers
around its middle, which all robots know. Two robots would pass each other as easily, each driving to its own
goal. They meet at their middle; once they see each other they drive straight at each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.control.safety_filter import SafetyFilter
from hpp_framework.control.stopping import StoppingPoints, motion
from hpp_framework.core.control import ControlContext, ControlLayer
from hpp_framework.core.geometry import polar, to_frame, wrap_angle
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task, any_heading
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation
from hpp_framework.perception.sensing import seen_points
from hpp_framework.perception.visibility import all_in_view, in_the_way
from hpp_framework.utils.errors import ConfigError

LOOKS = 8
"""Times that the middle of a team in its terminal phase is moved off the nearest static point."""
CHANGED = 0.05
"""m/s and rad/s by which a safety filter changes a command that it objects to."""


@dataclass(frozen=True, kw_only=True)
class TerminalApproachConfig:
    """How a robot approaches its target.

    Attributes:
        near: metres from a target of its own within which the layer takes over from the skill.
        astray: metres that the middle of a team may be moved by to find room; where there is none that near,
            the skills go on.
        gap: metres that a robot keeps from a teammate that stands; from one that drives it keeps farther, by
            as much as that drives in a control period.
        exact: metres at which it is there.
        slows: radians aside of its path from which on it drives slower: turning while it drives is quicker.
            From afar it does not slow down to turn at all.
        stops: radians from which on it turns on the spot.
        slows_in_crowd: the same where several teammates are near, who may stand beside its path.
        stops_in_crowd: the same.
        careful: share of the deceleration, driving and turning, that it counts on.
    """

    near: float = 1.5
    astray: float = 1.0
    gap: float = 0.04
    exact: float = 0.03
    slows: float = 0.5
    stops: float = math.pi / 2
    slows_in_crowd: float = 0.0
    stops_in_crowd: float = 0.5
    careful: float = 0.8

    def __post_init__(self) -> None:
        for name in ("near", "astray", "gap", "exact"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ConfigError(
                    f"terminal-approach: {name} must be 0 m or more, got {getattr(self, name)}."
                )
        if not (0 <= self.slows < self.stops and 0 <= self.slows_in_crowd < self.stops_in_crowd):
            raise ConfigError(f"terminal-approach must slow down before it stops to turn, got {self}.")
        if not 0 < self.careful <= 1:
            raise ConfigError(f"terminal-approach: careful is a share above 0, got {self.careful}.")


class TerminalApproach(ControlLayer):
    """Takes over from the skill near a target: turns to it, drives straight, waits for teammates in the way.

    Where something else than a teammate is in the way, the skill goes on: it is made for obstacles. It is
    kept from driving into teammates, though.

    Where each robot has a target of its own, it goes there as soon as its own path is free, and makes room
    for the others. Where all come to one place, they meet only if all come, so each makes sure that the paths
    of the others are free as well. And it drives there from afar once it and all others see each other: of
    what lies between them all see the same, so that no robot needs to guess.

    Args:
        robots: the team.
        agent: index of the robot.
        task: says whether there is a terminal phase, and where, and whether each robot has its own target.
        config: how it approaches.
    """

    def __init__(
        self,
        robots: Sequence[RobotSpec],
        agent: int,
        task: Task,
        config: TerminalApproachConfig | None = None,
    ) -> None:
        self.config = config or TerminalApproachConfig()
        self.task = task
        self.robot = robots[agent]
        self.safety = SafetyFilter(self.robot)
        self.agent = agent
        self.useful = ends_together(task, len(robots))
        self.stopping = StoppingPoints(robots)
        self.robots = tuple(robots)
        self.own_targets = has_targets(task, len(robots))
        self.sure_of = [agent] if self.own_targets else list(range(len(robots)))
        self.mates = [index for index in range(len(robots)) if index != agent]
        radii = torch.tensor([robots[index].footprint_radius for index in self.mates])
        self.apart = radii + self.robot.footprint_radius + self.config.gap

    def filter(
        self, observation: Observation, waypoint: Float[Tensor, "b 2"], command: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return the command that approaches where the robot is near its target, else the given one."""
        if not self.useful:
            return command
        room = self._room(observation)
        command = slowed(command, self._stoppable(room, self.robot.drive.acceleration))
        target, near = self.target_among(observation, waypoint)
        afar = torch.zeros_like(near)
        terminal = self.task.terminal(observation.team_poses)
        if terminal is not None and not self.own_targets:
            apart = (~near).nonzero()[:, 0]
            afar = afar.index_put((apart,), all_in_view(observation.episodes(apart), self.robots))
            # as far beyond the middle, so that it does not slow down for it
            beyond = any_heading(2 * terminal.middle - observation.pose[:, :2])
            target = torch.where(afar[:, None], beyond, target)
        approaches = near | afar
        if not bool(approaches.any()):
            return command
        wanted = self._straight(observation, target, room, afar)
        allowed = self.safety.corrected(observation, wanted)
        free = ((allowed - wanted).abs() < CHANGED).all(-1) & ~self._blocked(observation, target[:, :2])
        return torch.where((approaches & free)[:, None], wanted, command)

    def target_among(
        self, observation: Observation, waypoint: Float[Tensor, "b 2"]
    ) -> tuple[Float[Tensor, "b 3"], Bool[Tensor, "b"]]:
        """Return the robot's target pose (heading NaN: any), and whether it approaches it.

        It approaches near a target of its own, and in the terminal phase where it sees that the path is free.
        """
        poses = observation.team_poses
        target = any_heading(waypoint)
        distance = (observation.pose[:, :2] - waypoint).norm(dim=-1)
        near = distance < (self.config.near if self.own_targets else 0.0)
        terminal = self.task.terminal(poses)
        if terminal is None or not bool(terminal.now.any()):
            return target, near
        rows = terminal.now.nonzero()[:, 0]
        middle = terminal.middle[rows]
        points, still = seen_points(observation.episodes(rows), self.robot.lidar)
        centre = _off(middle, points, still, terminal.clear) if terminal.clear else middle
        free = (centre - middle).norm(dim=-1) < self.config.astray
        for each in self.sure_of:
            free &= ~in_the_way(poses[rows, each], centre, points, still, self.robot.footprint_radius)
        rows, centre = rows[free], centre[free]
        targets = self.task.targets(centre, poses[rows])
        own = any_heading(centre) if targets is None else targets[:, self.agent]
        return target.index_put((rows,), own), near.index_fill(0, rows, True)

    def _straight(
        self,
        observation: Observation,
        target: Float[Tensor, "b 3"],
        room: Float[Tensor, "b"],
        afar: Bool[Tensor, "b"],
    ) -> Float[Tensor, "b 2"]:
        """Return the command [v, omega] towards a target, as slow as the room before teammates requires.

        Where the target is far off, it does not slow down to turn.
        """
        drive = self.robot.drive
        distance, aside = polar(observation.pose, target[:, :2]).unbind(-1)
        there = distance < self.config.exact
        look = wrap_angle(target[:, 2] - observation.pose[:, 2]).nan_to_num(0.0)
        aside = torch.where(there, look, aside)
        turn = aside.sign() * self._stoppable(aside.abs(), drive.turn_acceleration).clamp(max=drive.turn_rate)
        speed = self._stoppable(distance.minimum(room), drive.acceleration).clamp(max=drive.speed[1])
        config, crowd = self.config, self._in_crowd(observation)
        slows = torch.where(crowd, config.slows_in_crowd, config.slows)
        stops = torch.where(crowd, config.stops_in_crowd, config.stops)
        share = ((stops - aside.abs()) / (stops - slows)).clamp(0, 1)
        speed = speed * torch.where(afar, 1.0, share)
        return torch.stack([speed.masked_fill(there, 0.0), turn], -1)

    def _in_crowd(self, observation: Observation) -> Bool[Tensor, "b"]:
        """Return whether several teammates are near."""
        mates = observation.team_poses[:, self.mates, :2]
        away = (mates - observation.pose[:, None, :2]).norm(dim=-1)
        return (away < self.config.near).sum(-1) > 1

    def _blocked(self, observation: Observation, target: Float[Tensor, "b 2"]) -> Bool[Tensor, "b"]:
        """Return whether the scan shows something on the straight path to the target that is no teammate."""
        # what is seen now counts, not what stood there before
        points, still = seen_points(replace(observation, keyframes=None), self.robot.lidar)
        return in_the_way(observation.pose, target, points, still, self.robot.footprint_radius)

    def _room(self, observation: Observation) -> Float[Tensor, "b"]:
        """Return how far the robot can drive on before it is too near a teammate or its halt, metres."""
        now, halt = observation.team_poses[:, self.mates, :2], self.stopping(observation)[:, self.mates]
        ahead, aside = to_frame(observation.pose[:, None], torch.cat([now, halt], 1)).unbind(-1)
        driven = motion(observation)[0][:, self.mates] * CONTROL_PERIOD
        apart = (self.apart.to(driven) + driven).repeat(1, 2)
        blocks = (ahead > 0) & (aside.abs() < apart)
        room = ahead - (apart.square() - aside.square()).clamp(min=0).sqrt()
        return torch.where(blocks, room.clamp(min=0), torch.inf).amin(-1)

    def _stoppable(self, room: Float[Tensor, "b"], deceleration: float) -> Float[Tensor, "b"]:
        """Return the speed from which a robot stops within a distance or angle, a control period from now."""
        counted_on = self.config.careful * deceleration
        lost = counted_on * CONTROL_PERIOD
        return (lost**2 + 2 * counted_on * room).sqrt() - lost


def slowed(command: Float[Tensor, "b 2"], most: Float[Tensor, "b"]) -> Float[Tensor, "b 2"]:
    """Return the command at a speed of no more than so many m/s."""
    return torch.stack([command[:, 0].minimum(most), command[:, 1]], -1)


def ends_together(task: Task, robots: int) -> bool:
    """Return whether a task has a terminal phase."""
    return task.terminal(torch.zeros(1, robots, 3)) is not None


def has_targets(task: Task, robots: int) -> bool:
    """Return whether each robot has a target of its own around a goal."""
    return task.targets(torch.zeros(1, 2), torch.zeros(1, robots, 3)) is not None


def _off(
    centre: Float[Tensor, "b 2"], points: Float[Tensor, "b q 2"], still: Bool[Tensor, "b q"], clear: float
) -> Float[Tensor, "b 2"]:
    """Return a centre moved off the nearest points that stand still until it is clear of all, if it can."""
    rows = torch.arange(len(centre), device=centre.device)
    for _ in range(LOOKS):
        away = centre[:, None] - points
        distance, nearest = away.norm(dim=-1).masked_fill(~still, torch.inf).min(1)
        direction = away[rows, nearest] / distance.clamp(min=1e-3)[:, None]
        centre = centre + direction * (clear - distance).clamp(min=0)[:, None]
    return centre


def terminal_approach(context: ControlContext) -> TerminalApproach:
    """Build the layer."""
    config = altered(TerminalApproachConfig(), context.settings, "layer 'terminal-approach'")
    return TerminalApproach(context.robots, context.agent, context.task, config)
