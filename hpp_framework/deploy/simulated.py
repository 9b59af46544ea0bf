"""Simulated robots that behave like real ones: they send messages, heed commands and have a watchdog.

Disturbances, latencies and judgement are those of every other episode
(:class:`~hpp_framework.episodes.core.EpisodeBatch`); the estimators belong to the agents' side.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.estimator import Estimate, Estimator, Reading
from hpp_framework.core.robot import Lidar
from hpp_framework.core.schedule import Schedule, presence
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.world import World
from hpp_framework.deploy.port import Fix, Motion, Scan
from hpp_framework.deploy.safety import Watchdog
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.evaluation.rollout import Episodes
from hpp_framework.sim.simulator import Simulator


class _Tap(Estimator):
    """Keeps what reaches an agent, which estimates elsewhere."""

    reading: Reading

    def reset(self, reading: Reading) -> Estimate:
        self.reading = reading
        return Estimate(reading.poses, reading.velocity, reading.scan)

    def update(self, reading: Reading, command: Float[Tensor, "b 2"]) -> Estimate:
        del command
        return self.reset(reading)

    def restart(self, reading: Reading, robots: Bool[Tensor, "b n"]) -> Estimate:
        del robots
        return self.reset(reading)


class SimulatedTeam:
    """A team in a world, one episode at a time.

    Args:
        simulator: of the team.
        team: all robots.
        schedule: who takes part when, with the task.
        disturbances: of each robot.
    """

    def __init__(
        self, simulator: Simulator, team: Team, schedule: Schedule, disturbances: Sequence[Disturbances]
    ) -> None:
        self.team, self.schedule = team, schedule
        self._taps = [_Tap() for _ in team.ids]
        self.batch = EpisodeBatch(
            simulator, schedule, disturbances=disturbances, estimators=self._taps, history=1, keyframes=0
        )

    def begin(self, world: World, start: Float[np.ndarray, "n 3"], seed: int) -> None:
        """Begin an episode, robots at rest.

        Args:
            world: that they are in.
            start: poses.
            seed: of the disturbances.
        """
        self.batch.begin([world], torch.from_numpy(start[None]).float(), [seed])
        self.watchdogs = [Watchdog(robot.drive) for robot in self.team.robots]
        self._poses = [self.batch.state.poses]
        self._goals: list[Tensor] = []

    @property
    def now(self) -> float:
        """Seconds since the episode began."""
        return self.batch.steps * CONTROL_PERIOD

    @property
    def running(self) -> bool:
        """Whether the task is not yet fulfilled."""
        return bool(self.batch.running[0])

    def reading(self, robot: int) -> Reading:
        """Return what reaches a robot's agent now."""
        return self._taps[robot].reading

    def step(self, goals: Float[Tensor, "n 2"], now: float | None = None) -> None:
        """Drive for one control period as the watchdogs say.

        Args:
            goals: that the agents have now, for reports.
            now: seconds, of the clock by which the watchdogs took commands; None for simulated time.
        """
        now = self.now if now is None else now
        commands = torch.tensor([[dog.command(now) for dog in self.watchdogs]], dtype=torch.float32)
        self._goals.append(goals)
        self._poses.append(self.batch.step(commands).poses)

    def episode(self, plan_seconds: list[float]) -> Episodes:
        """Return what has happened.

        Args:
            plan_seconds: wall times of single plans.
        """
        batch, several = self.batch, len(self.schedule) > 1
        return Episodes(
            poses=torch.stack(self._poses, 1).cpu(),
            goals=torch.stack(self._goals)[None].cpu(),
            done_step=batch.done_step,
            contact_step=batch.contact_step,
            touched_obstacle=batch.touched_obstacle,
            touched_robot=batch.touched_robot,
            touched_person=batch.touched_person,
            plan_seconds=plan_seconds,
            present=presence(self.schedule, len(self._poses), len(self.team)) if several else None,
        )


def scan_of(reading: Reading, lidar: Lidar, clock: float, now: float) -> Scan:
    """Return the scan that a robot's driver sends.

    Args:
        reading: of one episode.
        lidar: of the robot.
        clock: seconds, of the clock that all share.
        now: seconds, of the clock that never jumps.
    """
    ranges = reading.scan[0].numpy()
    step = lidar.field_of_view / (lidar.beams - 1)
    return Scan(
        stamp=clock - float(reading.ages[0, reading.agent]), arrived=now,
        ranges=np.where(ranges >= np.float32(lidar.max_range), np.float32(np.inf), ranges),
        angle_min=-lidar.field_of_view / 2, angle_increment=step,
        range_min=lidar.min_range, range_max=lidar.max_range,
    )  # fmt: skip


def motion_of(reading: Reading, clock: float, now: float) -> Motion:
    """Return the odometry that a robot sends; see :func:`scan_of`."""
    speed, turn = reading.velocity[0].tolist()
    return Motion(stamp=clock - float(reading.ages[0, reading.agent]), arrived=now, velocity=(speed, turn))


def fix_of(reading: Reading, robot: int, clock: float, now: float) -> Fix:
    """Return the pose of a robot as it reaches the agent; see :func:`scan_of`."""
    x, y, heading = reading.poses[0, robot].tolist()
    return Fix(stamp=clock - float(reading.ages[0, robot]), arrived=now, pose=(x, y, heading))


def joined(found: Sequence[Episodes]) -> Episodes:
    """Return episodes of one team as a batch; what ended sooner is held from then on."""
    longest = max(each.poses.shape[1] for each in found)

    def held(values: Tensor, length: int) -> Tensor:
        return torch.cat([values, values[:, -1:].expand(-1, length - values.shape[1], -1, -1)], 1)

    def rows(name: str) -> Tensor:
        return torch.cat([getattr(each, name) for each in found])

    present = max((each.present for each in found if each.present is not None), key=len, default=None)
    return Episodes(
        poses=torch.cat([held(each.poses, longest) for each in found]),
        goals=torch.cat([held(each.goals, longest - 1) for each in found]),
        done_step=rows("done_step"), contact_step=rows("contact_step"),
        touched_obstacle=rows("touched_obstacle"), touched_robot=rows("touched_robot"),
        touched_person=rows("touched_person"),
        plan_seconds=[each for episode in found for each in episode.plan_seconds], present=present,
    )  # fmt: skip
