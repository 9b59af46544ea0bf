"""How well a skill reaches goals in worlds it has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.envs.point_to_point import PointToPoint
from hpp_framework.errors import ConfigError
from hpp_framework.evaluation.statistics import wilson_interval
from hpp_framework.robot import RobotSpec
from hpp_framework.seeding import numpy_rng, torch_rng
from hpp_framework.sensing import NoiseModel, Sensing
from hpp_framework.sim.batch import BatchSimulator
from hpp_framework.sim.simulator import CONTROL_PERIOD
from hpp_framework.skill import Skill
from hpp_framework.worlds.pool import WorldPool, build_pool

ARRIVAL = PointToPoint()
"""What counts as arriving, the same as in training."""

STARTS = 32
"""Points of a world that are tried as starts."""


@dataclass(frozen=True, kw_only=True)
class SkillScore:
    """Outcome over a set of episodes.

    Attributes:
        episodes: how many.
        success: share that came to rest within 0.3 m of the goal for 1 s, with its 95 % Wilson bounds.
        success_low, success_high: those bounds.
        clean: share that succeeded without touching anything.
        time_median_s: median time of the successes, in seconds.
    """

    episodes: int
    success: float
    success_low: float
    success_high: float
    clean: float
    time_median_s: float


@torch.no_grad()
def evaluate_skill(
    skill: Skill,
    robot: RobotSpec,
    *,
    world: str = "training",
    episodes: int = 500,
    goal_distance: tuple[float, float] = (5.0, 10.0),
    steps: int = 200,
    noise: NoiseModel | None = None,
    seed: int = 0,
) -> SkillScore:
    """Drive one robot to one reachable goal an episode, each episode in a world of its own.

    Args:
        skill: what drives.
        robot: what it drives.
        world: registered world.
        episodes: how many.
        goal_distance: nearest and farthest goal, straight line, in metres.
        steps: control steps before an episode counts as failed (200 are 40 s).
        noise: disturbances of what is observed.
        seed: of worlds, starts and goals.

    Raises:
        ConfigError: if a world has no goal at the distance asked for.
    """
    pool = build_pool(world, episodes, [robot], seed=seed)
    poses, goal = _journeys(pool, goal_distance, numpy_rng(seed, "evaluate-skill"))
    simulator = BatchSimulator([robot])
    state = simulator.reset(pool.worlds, poses)
    sensing = Sensing([robot], noise or NoiseModel(), torch_rng(seed, "sensing"))
    sensing.reset(state)
    done = torch.full((episodes,), -1)
    dwelt = torch.zeros(episodes, dtype=torch.int64)
    touched = torch.zeros(episodes, dtype=torch.bool)
    for step in range(1, steps + 1):
        state = simulator.step(skill.act(sensing.observe(0), goal)[:, None])
        sensing.update(state)
        touched |= state.collided[:, 0] & (done < 0)
        near = (state.poses[:, 0, :2] - goal).norm(dim=1) < ARRIVAL.goal_radius
        resting = state.velocities[:, 0, 0].abs() < ARRIVAL.rest_speed
        dwelt = torch.where(near & resting, dwelt + 1, 0)
        done = torch.where((done < 0) & (dwelt >= ARRIVAL.dwell), step, done)
    success = done >= 0
    low, high = wilson_interval(int(success.sum()), episodes)
    return SkillScore(
        episodes=episodes,
        success=float(success.float().mean()),
        success_low=low,
        success_high=high,
        clean=float((success & ~touched).float().mean()),
        time_median_s=float(done[success].float().median() * CONTROL_PERIOD)
        if bool(success.any())
        else float("nan"),
    )


def _journeys(
    pool: WorldPool, goal_distance: tuple[float, float], rng: np.random.Generator
) -> tuple[Float[Tensor, "b 1 3"], Float[Tensor, "b 2"]]:
    """Draw a start pose and a goal at the distance asked for in each world of a pool."""
    rows = np.arange(len(pool))
    gaps = np.linalg.norm(pool.points[:, :, None] - pool.points[:, None, :STARTS], axis=-1)
    suitable = (gaps >= goal_distance[0]) & (gaps <= goal_distance[1])
    if not suitable.any((1, 2)).all():
        raise ConfigError(f"some worlds have no goal {goal_distance[0]} to {goal_distance[1]} m away.")
    # the start is the first point that has any such goal, the goal a random one of those
    start = suitable.any(1).argmax(1)
    choices = suitable[rows, :, start]
    goal = np.where(choices, rng.random(choices.shape), -1.0).argmax(1)
    heading = rng.uniform(-np.pi, np.pi, (len(pool), 1))
    poses = np.concatenate([pool.points[rows, start], heading], 1)
    return torch.from_numpy(poses).float()[:, None], torch.from_numpy(pool.points[rows, goal])
