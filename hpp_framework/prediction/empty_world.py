"""What a skill would do if nothing stood in its way: every robot drives on, alone in an empty world.

Knows the robots' drive limits and skills exactly, and obstacles not at all: what a learned model gains over
it is what it has read off the lidar.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.core.predictor import Predictor, PredictorRequest
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.skill import Skill
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation, Trajectories
from hpp_framework.core.world import World
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.plugins.build import make_skills
from hpp_framework.sim.batch.simulator import BatchSimulator

STEPS = 5
"""Control steps per prediction step: one second."""
EMPTY = World(name="empty", bounds=(-1e3, -1e3, 1e3, 1e3), walled=False)


class EmptyWorld(Predictor):
    """Drives each robot's own skill in the batch simulator, each robot by itself; a step is one second.

    Args:
        team: all robots, with their skills.
    """

    def __init__(self, team: Team) -> None:
        self._drivers = [_Driver(m.robot, s) for m, s in zip(team.members, make_skills(team), strict=True)]

    @torch.no_grad()
    def rollout(self, observation: Observation, goals: Float[Tensor, "b g 2"], horizon: int) -> Trajectories:
        """Imagine ``horizon`` seconds; the speed of others is read off their last observed step."""
        candidates = goals.shape[1]
        moving = observed_velocities(observation)
        parts = [
            driver.drive(
                observation.team_poses[:, robot].repeat_interleave(candidates, 0),
                moving[:, robot].repeat_interleave(candidates, 0),
                goals.flatten(0, 1),
                horizon,
            )
            for robot, driver in enumerate(self._drivers)
        ]
        times = torch.arange(1, horizon + 1, device=goals.device, dtype=goals.dtype) * STEPS * CONTROL_PERIOD
        return Trajectories(torch.stack(parts, 2).unflatten(0, goals.shape[:2]), times)


class _Driver:
    """One robot and its skill in a simulator of its own."""

    def __init__(self, robot: RobotSpec, skill: Skill) -> None:
        self._robot = robot
        self._skill = skill
        self._simulator = BatchSimulator([robot], threads=1)
        self._episodes = 0

    def drive(
        self,
        poses: Float[Tensor, "e 3"],
        velocities: Float[Tensor, "e 2"],
        goals: Float[Tensor, "e 2"],
        horizon: int,
    ) -> Float[Tensor, "e t 3"]:
        """Return the poses of one robot in every episode, second by second."""
        if self._episodes != len(poses):
            self._episodes = len(poses)
            self._simulator.load((EMPTY,), episodes=self._episodes)
        index = torch.zeros(self._episodes, dtype=torch.int32)
        alone = torch.ones(self._episodes, 1, dtype=torch.bool)
        state = self._simulator.place(index, alone, poses[:, None], velocities[:, None])
        batch = EpisodeBatch(self._simulator, keyframes=0, shared=True)
        batch.start(state, range(self._episodes))
        out = poses.new_empty(self._episodes, horizon, 3)
        for second in range(horizon):
            for _ in range(STEPS):
                batch.step(self._skill.act(batch.observe(0), goals)[:, None])
            out[:, second] = batch.state.poses[:, 0]
        return out


def observed_velocities(observation: Observation) -> Float[Tensor, "b n 2"]:
    """Return forward speeds (m/s) and turn rates (rad/s): the agent's own odometry, others' last step."""
    last, before = observation.poses[:, -1], observation.poses[:, -2]
    ahead = torch.stack([last[..., 2].cos(), last[..., 2].sin()], -1)
    forward = ((last - before)[..., :2] * ahead).sum(-1)
    turned = geometry.wrap_angle(last[..., 2] - before[..., 2])
    out = torch.stack([forward, turned], -1) / CONTROL_PERIOD
    out[:, observation.agent] = observation.velocity
    return out


def create(request: PredictorRequest) -> EmptyWorld:
    """Build the model; any team will do whose skills can be built."""
    return EmptyWorld(request.team)
