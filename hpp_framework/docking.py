"""Docking: the last metres into a gathering, where a skill made for obstacles would circle.

To a skill that drives by lidar, teammates that have arrived are obstacles around its goal: it swerves, drives
round them and never arrives. What is known of them is better than a scan: where they are, and how wide.

What a planner wants matters no longer once everybody is near: goals a metre apart are as good, and a robot
that turns from one to the next never gets anywhere. Then the team settles around its middle, which all know.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.geometry import polar, to_frame, wrap_angle
from hpp_framework.guard import Guard
from hpp_framework.halting import Halting
from hpp_framework.robot import RobotSpec
from hpp_framework.sensing import seen_points
from hpp_framework.sim.simulator import CONTROL_PERIOD
from hpp_framework.task import Task
from hpp_framework.types import Observation

NEAR = 1.5
"""Metres from its spot within which a robot docks."""
LOOKS = 8
"""Times that the middle of a settling team is moved off the nearest thing that stands still."""
ASTRAY = 1.0
"""Metres that it may be moved by; where there is no room that near, robots do not settle."""
EXACT = 0.03
"""Metres at which it is there."""
GAP = 0.04
"""Metres that it keeps from teammates."""
STRAIGHT = 0.5
"""Radians aside from which on it turns on the spot."""
CAREFUL = 0.8
"""Share of the deceleration, driving and turning, that it counts on."""
CHANGED = 0.05
"""m/s and rad/s by which a guard changes a command that it objects to."""


class Docking:
    """Takes over from the skill near a spot: turns to it, drives straight, and waits for who is in the way.

    Where something else than a teammate is in the way, the skill goes on: that is what it is made for. It is
    kept from driving into teammates, though.

    Args:
        robots: the team.
        agent: index of the robot.
        guard: tells what is in the way.
        task: says whether a team settles, and where.
    """

    def __init__(self, robots: Sequence[RobotSpec], agent: int, guard: Guard, task: Task) -> None:
        self.task = task
        self.robot = robots[agent]
        self.guard = guard
        self.agent = agent
        self.halting = Halting(robots)
        others = [index for index in range(len(robots)) if index != agent]
        self.mates = [*others, *(len(robots) + index for index in others)]
        radii = torch.tensor([robots[index].footprint_radius for index in others])
        self.apart = (radii + self.robot.footprint_radius + GAP).repeat(2)

    def __call__(
        self, observation: Observation, spot: Float[Tensor, "b 2"], command: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return the command that docks where the robot is near its spot, else the given one.

        Args:
            observation: what the agent knows.
            spot: where to unless the team settles, world frame, metres.
            command: of the skill.
        """
        room = self._room(observation)
        slow = _stoppable(room, self.robot.drive.acceleration)
        command = torch.stack([command[:, 0].minimum(slow), command[:, 1]], -1)
        stance, near = self.stance_among(observation, spot)
        if not bool(near.any()):
            return command
        wanted = self._straight(observation, stance, room)
        allowed = self.guard(observation, wanted)
        free = ((allowed - wanted).abs() < CHANGED).all(-1) & ~self._blocked(observation, stance[:, :2])
        return torch.where((near & free)[:, None], wanted, command)

    def stance_among(
        self, observation: Observation, spot: Float[Tensor, "b 2"]
    ) -> tuple[Float[Tensor, "b 3"], Bool[Tensor, "b"]]:
        """Return where the robot docks, looking where (NaN: anywhere), and whether it does.

        It docks near its spot, and where its team settles and it sees that its way there is free.
        """
        poses = observation.team_poses
        stance = torch.cat([spot, torch.full_like(spot[:, :1], torch.nan)], -1)
        near = (observation.pose[:, :2] - spot).norm(dim=-1) < NEAR
        settling = self.task.settling(poses)
        if settling is None or not bool(settling.near.any()):
            return stance, near
        rows = settling.near.nonzero()[:, 0]
        middle = settling.middle[rows]
        points, still = seen_points(observation.episodes(rows), self.robot.lidar)
        centre = _off(middle, points, still, settling.clear)
        free = ~self._on_way(poses[rows, self.agent], centre, points, still)
        free &= (centre - middle).norm(dim=-1) < ASTRAY
        rows, centre = rows[free], centre[free]
        stances = self.task.stances(centre, poses[rows])
        return stance.index_put((rows,), stances[:, self.agent]), near.index_fill(0, rows, True)

    def _straight(
        self, observation: Observation, stance: Float[Tensor, "b 3"], room: Float[Tensor, "b"]
    ) -> Float[Tensor, "b 2"]:
        """Return the command [v, omega] towards a stance, as slow as the room before teammates asks for."""
        drive = self.robot.drive
        distance, aside = polar(observation.pose, stance[:, :2]).unbind(-1)
        there = distance < EXACT
        look = wrap_angle(stance[:, 2] - observation.pose[:, 2]).nan_to_num(0.0)
        aside = torch.where(there, look, aside)
        turn = aside.sign() * _stoppable(aside.abs(), drive.turn_acceleration).clamp(max=drive.turn_rate)
        speed = _stoppable(distance.minimum(room), drive.acceleration).clamp(max=drive.speed[1])
        speed = speed * (1 - aside.abs() / STRAIGHT).clamp(min=0)
        return torch.stack([speed.masked_fill(there, 0.0), turn], -1)

    def _blocked(self, observation: Observation, spot: Float[Tensor, "b 2"]) -> Bool[Tensor, "b"]:
        """Return whether the scan shows something on the straight way to the spot that is no teammate."""
        # what is seen now counts, not what stood there before
        points, still = seen_points(replace(observation, keyframes=None), self.robot.lidar)
        return self._on_way(observation.pose, spot, points, still)

    def _on_way(
        self,
        pose: Float[Tensor, "b 3"],
        spot: Float[Tensor, "b 2"],
        points: Float[Tensor, "b q 2"],
        still: Bool[Tensor, "b q"],
    ) -> Bool[Tensor, "b"]:
        """Return whether points that stand still are in the way from a pose straight to a spot."""
        distance, bearing = polar(pose, spot).unbind(-1)
        towards = torch.cat([pose[:, :2], (pose[:, 2] + bearing)[:, None]], -1)
        ahead, aside = to_frame(towards[:, None], points).unbind(-1)
        reach = self.robot.footprint_radius + GAP
        on_way = (ahead > 0) & (ahead < distance[:, None] + reach) & (aside.abs() < reach)
        return (on_way & still).any(-1)

    def _room(self, observation: Observation) -> Float[Tensor, "b"]:
        """Return how far the robot can drive on before it is too near a teammate or its halt, metres."""
        places = torch.cat([observation.team_poses[..., :2], self.halting(observation)], 1)
        ahead, aside = to_frame(observation.pose[:, None], places[:, self.mates]).unbind(-1)
        apart = self.apart.to(ahead)
        blocks = (ahead > 0) & (aside.abs() < apart)
        room = ahead - (apart.square() - aside.square()).clamp(min=0).sqrt()
        return torch.where(blocks, room.clamp(min=0), torch.inf).amin(-1)


def docks(task: Task, robots: int) -> bool:
    """Return whether a task has spots around a goal, or a way to settle, for a team of so many robots."""
    poses = torch.zeros(1, robots, 3)
    return task.parking(torch.zeros(1, 2), poses) is not None or task.settling(poses) is not None


def dockings(robots: Sequence[RobotSpec], task: Task) -> list[Docking] | None:
    """Return everybody's docking; None where a task has no use for it."""
    if not docks(task, len(robots)):
        return None
    return [Docking(robots, index, Guard(robot), task) for index, robot in enumerate(robots)]


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
