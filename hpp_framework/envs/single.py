"""Point-to-point navigation of one robot as a ``gymnasium.Env`` (``hpp/PointToPoint-v0``)."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from hpp_framework.core.disturbances import IDEAL, Disturbances
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.envs.point_to_point import PointToPointVectorEnv
from hpp_framework.envs.problem import PointToPoint
from hpp_framework.envs.spaces import FloatArray, check_action
from hpp_framework.plugins.builtin import DEFAULT_ROBOT, DEFAULT_WORLD
from hpp_framework.utils.errors import SimulatorError
from hpp_framework.viz.picture import Picture, check_mode


class PointToPointEnv(gym.Env[Any, Any]):
    """A vector environment of one robot, seen as one environment; so problem and reward exist once.

    Args:
        robot: registered robot or its data.
        world: registered world or world file that the pool is drawn from.
        pool_size: number of different worlds.
        problem: arrival and rewards.
        disturbances: of sensing and acting.
        seed: of the pool of worlds; episodes are seeded by :meth:`reset`.
        unit_actions: whether actions lie in [-1, 1] and are scaled to the drive limits.
        render_mode: ``"rgb_array"`` or None.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  # Gymnasium's own form
        "render_modes": ["rgb_array"],
        "render_fps": round(1 / CONTROL_PERIOD),
    }

    def __init__(
        self,
        *,
        robot: str | RobotSpec = DEFAULT_ROBOT,
        world: str = DEFAULT_WORLD,
        pool_size: int = 64,
        problem: PointToPoint | None = None,
        disturbances: Disturbances = IDEAL,
        seed: int = 0,
        unit_actions: bool = True,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = check_mode(render_mode)
        self._batch = PointToPointVectorEnv(
            1, robot=robot, world=world, pool_size=pool_size, problem=problem, seed=seed,
            disturbances=disturbances, unit_actions=unit_actions, autoreset=False,
        )  # fmt: skip
        self.observation_space = self._batch.single_observation_space
        self.action_space = self._batch.single_action_space
        self._meaning = "[v, omega] in -1..1" if unit_actions else "[v in m/s, omega in rad/s]"
        self._picture = Picture([self._batch.robot])
        self._running = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, FloatArray], dict[str, Any]]:
        """Start an episode: a world of the pool, a start, a goal.

        Args:
            seed: makes this episode and all that follow repeatable; the same as in the vector environment.
            options: ignored.
        """
        del options
        super().reset(seed=seed)
        # unseeded, the first episode is a random one; the batch alone would begin with the seed of its pool
        first = seed is None and not self._batch.started
        observation, _ = self._batch.reset(seed=int(self.np_random.integers(2**31)) if first else seed)
        self._running = True
        return _only(observation), {}

    def step(self, action: Any) -> tuple[dict[str, FloatArray], float, bool, bool, dict[str, Any]]:
        """Drive for one control step.

        Args:
            action: forward speed and turn rate, in -1..1 or m/s and rad/s.

        Returns:
            Observation, reward, whether the robot arrived, whether time ran out, and info: ``touched``,
            whether the robot touched anything.

        Raises:
            SimulatorError: if no episode runs, or the action is not two finite numbers.
        """
        if not self._running:
            raise SimulatorError("no episode is running; call reset() first.")
        checked = check_action(action, "the robot", self._meaning)
        observation, reward, success, truncated, info = self._batch.step(checked[None])
        self._running = not (success[0] or truncated[0])
        touched = bool(info["touched"][0])
        return (
            _only(observation),
            float(reward[0]),
            bool(success[0]),
            bool(truncated[0]),
            {"touched": touched},
        )

    def render(self) -> npt.NDArray[np.uint8] | None:  # type: ignore[override]  # Gymnasium leaves the frame's type open
        """Return a top-down picture (height, width, 3), or None without a render mode."""
        if self.render_mode is None:
            return None
        if not self._batch.started:
            raise SimulatorError("there is nothing to draw yet; call reset() first.")
        world, poses, goals = self._batch.scene(0)
        return self._picture.draw(world, poses, goals)


def _only(observation: dict[str, FloatArray]) -> dict[str, FloatArray]:
    return {name: part[0].copy() for name, part in observation.items()}
