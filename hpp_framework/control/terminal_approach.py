"""Docking: the last metres into a gathering, where a skill made for obstacles would circle.

To a skill that drives by lidar, teammates that have arrived are obstacles around its goal: it swerves, drives
round them and never arrives. What is known of them is better than a scan: where they are, and how wide.

What a planner wants matters no longer once everybody is near: goals a metre apart are as good, and a robot
that turns from one to the next never gets anywhere. Then the team settles around its middle, which all know.
Two robots pass each other by as easily, each on its way to a goal of its own; they meet at their middle, and
once they see each other they need no goal: they drive straight together and brake together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.control.safety_filter import Guard
from hpp_framework.control.stopping import Halting
from hpp_framework.control.yield_together import Braking
from hpp_framework.core.geometry import polar, to_frame, wrap_angle
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation
from hpp_framework.perception.sensing import seen_points
from hpp_framework.perception.visibility import GAP, in_the_way, see_each_other

NEAR = 1.5
"""Metres from its spot within which a robot docks."""
LOOKS = 8
"""Times that the middle of a settling team is moved off the nearest thing that stands still."""
ASTRAY = 1.0
"""Metres that it may be moved by; where there is no room that near, robots do not settle."""
GAP_OF_TWO = 0.2
"""Metres that two robots keep that drive at each other, both faster than the other last saw them drive."""
EXACT = 0.03
"""Metres at which it is there."""
STRAIGHT = (0.0, 0.5)
"""Radians aside from which on it drives slower, and turns on the spot: others may stand beside its way."""
STRAIGHT_OF_TWO = (0.5, math.pi / 2)
"""The same of two robots near each other: turning while it drives is quicker, and nobody else is there.
From afar they do not slow down to turn at all: to gain speed again takes longer than to turn."""
CAREFUL = 0.8
"""Share of the deceleration, driving and turning, that it counts on."""
CHANGED = 0.05
"""m/s and rad/s by which a guard changes a command that it objects to."""


class Docking:
    """Takes over from the skill near a spot: turns to it, drives straight, and waits for who is in the way.

    Where something else than a teammate is in the way, the skill goes on: that is what it is made for. It is
    kept from driving into teammates, though.

    In a team each settles as soon as its own way is free, and makes room for the others. Two that may meet
    anywhere meet only if both come, so each makes sure that the other's way is free as well: of what lies
    between them both see the same. From afar they drive at each other once each is in the other's view.

    Args:
        robots: the team.
        agent: index of the robot.
        guard: tells what is in the way.
        task: says whether a team settles, and where, and whether each robot has a spot of its own.
    """

    def __init__(self, robots: Sequence[RobotSpec], agent: int, guard: Guard, task: Task) -> None:
        self.task = task
        self.robot = robots[agent]
        self.guard = guard
        self.agent = agent
        self.halting = Halting(robots)
        self.spots = _spots(task, len(robots))
        self.two = len(robots) == 2 and not self.spots
        self.straight = STRAIGHT_OF_TWO if self.two else STRAIGHT
        self.braking = Braking(robots, agent, task) if self.two else None
        self.sure_of = [0, 1] if self.two else [agent]
        others = [index for index in range(len(robots)) if index != agent]
        self.mates = [*others, *(len(robots) + index for index in others)]
        radii = torch.tensor([robots[index].footprint_radius for index in others])
        self.apart = (radii + self.robot.footprint_radius + (GAP_OF_TWO if self.two else GAP)).repeat(2)

    def __call__(
        self, observation: Observation, spot: Float[Tensor, "b 2"], command: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return the command that docks where the robot is near its spot, else the given one.

        Args:
            observation: what the agent knows.
            spot: where to unless the team settles, world frame, metres.
            command: of the skill.
        """
        command = self._docked(observation, spot, command)
        return command if self.braking is None else _slowed(command, self.braking(observation))

    def _docked(
        self, observation: Observation, spot: Float[Tensor, "b 2"], command: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        room = self._room(observation)
        command = _slowed(command, _stoppable(room, self.robot.drive.acceleration))
        stance, near = self.stance_among(observation, spot)
        afar = torch.zeros_like(near)
        if self.two:
            apart = (~near).nonzero()[:, 0]
            afar = afar.index_put((apart,), see_each_other(observation.episodes(apart), self.robot))
            mate = observation.team_poses[:, 1 - self.agent, :2]
            stance = torch.where(afar[:, None], torch.cat([mate, stance[:, 2:]], -1), stance)
        docks = near | afar
        if not bool(docks.any()):
            return command
        wanted = self._straight(observation, stance, room, afar)
        allowed = self.guard(observation, wanted)
        free = ((allowed - wanted).abs() < CHANGED).all(-1) & ~self._blocked(observation, stance[:, :2])
        return torch.where((docks & free)[:, None], wanted, command)

    def stance_among(
        self, observation: Observation, spot: Float[Tensor, "b 2"]
    ) -> tuple[Float[Tensor, "b 3"], Bool[Tensor, "b"]]:
        """Return where the robot docks, looking where (NaN: anywhere), and whether it does.

        It docks near its spot, and where its team settles and it sees that the way there is free.
        """
        poses = observation.team_poses
        stance = torch.cat([spot, torch.full_like(spot[:, :1], torch.nan)], -1)
        near = (observation.pose[:, :2] - spot).norm(dim=-1) < (NEAR if self.spots else 0.0)
        settling = self.task.settling(poses)
        if settling is None or not bool(settling.near.any()):
            return stance, near
        rows = settling.near.nonzero()[:, 0]
        middle = settling.middle[rows]
        points, still = seen_points(observation.episodes(rows), self.robot.lidar)
        centre = _off(middle, points, still, settling.clear) if settling.clear else middle
        free = (centre - middle).norm(dim=-1) < ASTRAY
        for each in self.sure_of:
            free &= ~in_the_way(poses[rows, each], centre, points, still, self.robot.footprint_radius)
        rows, centre = rows[free], centre[free]
        stances = self.task.stances(centre, poses[rows])
        return stance.index_put((rows,), stances[:, self.agent]), near.index_fill(0, rows, True)

    def _straight(
        self,
        observation: Observation,
        stance: Float[Tensor, "b 3"],
        room: Float[Tensor, "b"],
        afar: Bool[Tensor, "b"],
    ) -> Float[Tensor, "b 2"]:
        """Return the command [v, omega] towards a stance, as slow as the room before teammates asks for.

        Where the stance is far off, it does not slow down to turn.
        """
        drive = self.robot.drive
        distance, aside = polar(observation.pose, stance[:, :2]).unbind(-1)
        there = distance < EXACT
        look = wrap_angle(stance[:, 2] - observation.pose[:, 2]).nan_to_num(0.0)
        aside = torch.where(there, look, aside)
        turn = aside.sign() * _stoppable(aside.abs(), drive.turn_acceleration).clamp(max=drive.turn_rate)
        speed = _stoppable(distance.minimum(room), drive.acceleration).clamp(max=drive.speed[1])
        slows, stops = self.straight
        share = ((stops - aside.abs()) / (stops - slows)).clamp(0, 1)
        speed = speed * torch.where(afar, 1.0, share)
        return torch.stack([speed.masked_fill(there, 0.0), turn], -1)

    def _blocked(self, observation: Observation, spot: Float[Tensor, "b 2"]) -> Bool[Tensor, "b"]:
        """Return whether the scan shows something on the straight way to the spot that is no teammate."""
        # what is seen now counts, not what stood there before
        points, still = seen_points(replace(observation, keyframes=None), self.robot.lidar)
        return in_the_way(observation.pose, spot, points, still, self.robot.footprint_radius)

    def _room(self, observation: Observation) -> Float[Tensor, "b"]:
        """Return how far the robot can drive on before it is too near a teammate or its halt, metres."""
        places = torch.cat([observation.team_poses[..., :2], self.halting(observation)], 1)
        ahead, aside = to_frame(observation.pose[:, None], places[:, self.mates]).unbind(-1)
        apart = self.apart.to(ahead)
        blocks = (ahead > 0) & (aside.abs() < apart)
        room = ahead - (apart.square() - aside.square()).clamp(min=0).sqrt()
        return torch.where(blocks, room.clamp(min=0), torch.inf).amin(-1)


def _slowed(command: Float[Tensor, "b 2"], most: Float[Tensor, "b"]) -> Float[Tensor, "b 2"]:
    """Return the command at a speed of no more than so many m/s."""
    return torch.stack([command[:, 0].minimum(most), command[:, 1]], -1)


def docks(task: Task, robots: int, *, guided: bool) -> bool:
    """Return whether robots dock: at spots around a goal, or to settle; two that meet anywhere if guided.

    Args:
        task: the shared objective.
        robots: in the team.
        guided: whether the robot has a guide.
    """
    goal, poses = torch.zeros(1, 2), torch.zeros(1, robots, 3)
    if task.parking(goal, poses) is not None:
        return True
    return task.settling(poses) is not None and (guided or robots != 2 or _spots(task, robots))


def dockings(robots: Sequence[RobotSpec], task: Task) -> list[Docking] | None:
    """Return the docking of everybody without a guide; None where a task has no use for it."""
    if not docks(task, len(robots), guided=False):
        return None
    return [Docking(robots, index, Guard(robot), task) for index, robot in enumerate(robots)]


def _spots(task: Task, robots: int) -> bool:
    """Return whether each robot has a spot of its own around a goal."""
    goal, poses = torch.zeros(1, 2), torch.zeros(1, robots, 3)
    return task.parking(goal, poses) is not None or task.places(goal, poses) is not None


def _stoppable(room: Float[Tensor, "b"], deceleration: float) -> Float[Tensor, "b"]:
    """Return the speed from which a robot stops within a distance or angle, one control period from now."""
    counted_on = CAREFUL * deceleration
    lost = counted_on * CONTROL_PERIOD
    return (lost**2 + 2 * counted_on * room).sqrt() - lost


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
