"""A team as a PettingZoo ``ParallelEnv``: the paper's Dec-POMDP over any simulator.

Every agent sees its own lidar and odometry, noisy poses of the team and its current goal, and is driven by
commands. The reward is shared. See docs/environments.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from pettingzoo import ParallelEnv

from hpp_framework.core import geometry
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.world import World
from hpp_framework.envs.episode import EpisodeConfig, TeamEpisode
from hpp_framework.envs.spaces import (
    FloatArray,
    check_action,
    command_space,
    goal_space,
    poses_space,
    scan_space,
    team_poses,
    to_arrays,
    to_numbers,
)
from hpp_framework.plugins.builtin import DEFAULT_TEAM, DEFAULT_WORLD
from hpp_framework.utils.errors import ConfigError, SimulatorError, unknown_name
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.viz.picture import check_mode

Observations = dict[str, dict[str, FloatArray]]

COMMAND = "[v in m/s, omega in rad/s]"


class TeamEnv(ParallelEnv[str, Any, Any]):
    """Drives a team by commands.

    Args:
        team: a team, or text such as ``"fetch,freight"`` or ``"alice=fetch,bob=freight"``; its ids are the
            agents.
        world: a world, a registered world or a world file; a registered one is drawn afresh at each reset.
        config: task, disturbances, backend, length of episodes.
        render_mode: ``"rgb_array"`` or None. ``"human"`` is accepted, as PettingZoo's tests ask, but
            rendering it is an error: there is no window.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  # PettingZoo's own form
        "name": "hpp_team_v0",
        "render_modes": ["rgb_array"],
        "render_fps": round(1 / CONTROL_PERIOD),
    }

    def __init__(
        self,
        team: Team | str = DEFAULT_TEAM,
        *,
        world: World | str = DEFAULT_WORLD,
        config: EpisodeConfig | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = check_mode(render_mode, (None, "human", "rgb_array"))
        self.episode = TeamEpisode(team, world, config or EpisodeConfig())
        members = self.episode.team.members
        self.possible_agents = list(self.episode.team.ids)
        self.agents: list[str] = []
        self.observation_spaces = {
            member.id: _observation_space(member.robot, len(members)) for member in members
        }
        self.action_spaces = {member.id: command_space(member.robot) for member in members}
        self._rng: np.random.Generator | None = None
        self._goals = np.zeros((len(members), 2), np.float32)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of one agent's observations; always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of one agent's commands; always the same object."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, dict[str, Any]]]:
        """Start an episode: a new world, new starts, a new common goal.

        Args:
            seed: makes this episode and all that follow repeatable; without one they go on from the last.
            options: ``"goals"``, as for :meth:`set_goals`, and ``"poses"``, starts (n, 3); others are
                ignored.

        Raises:
            ConfigError: if the world has no room for the team, or an option is malformed.
        """
        if seed is not None:
            self._rng = numpy_rng(seed, "team-env")
        elif self._rng is None:
            self._rng = np.random.default_rng()
        options = options or {}
        self.episode.reset(int(self._rng.integers(2**62)), options.get("poses"))
        self._goals[:] = self.episode.draw_goal()
        self.agents = list(self.possible_agents)
        if "goals" in options:
            self.set_goals(options["goals"])
        return self._observations(), self._infos()

    def set_goals(self, goals: Mapping[str, Any]) -> None:
        """Give agents new goals; they show from the next observation on and last until the next reset.

        Args:
            goals: world coordinates (x, y) in metres by agent; agents left out keep theirs.

        Raises:
            UnknownNameError: if there is no such agent.
            ConfigError: if a goal is not two finite numbers.
        """
        for agent, goal in goals.items():
            if agent not in self.possible_agents:
                raise unknown_name("agent", agent, self.possible_agents)
            point = to_numbers(goal)
            if point.shape != (2,) or not np.isfinite(point).all():
                raise ConfigError(
                    f"the goal of agent '{agent}' must be two finite numbers [x, y], got {goal!r}."
                )
            self._goals[self.possible_agents.index(agent)] = point

    @property
    def goals(self) -> dict[str, tuple[float, float]]:
        """Current goals in world coordinates, metres, by agent."""
        return {
            agent: (float(x), float(y))
            for agent, (x, y) in zip(self.possible_agents, self._goals, strict=True)
        }

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[Observations, dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Drive all robots for one control step.

        Args:
            actions: commands [v in m/s, omega in rad/s] by agent; drive limits are applied.

        Raises:
            SimulatorError: if no episode runs, an agent is missing or unknown, or a command is not two finite
                numbers.
        """
        if not self.agents and not actions:
            return {}, {}, {}, {}, {}
        reward = self.episode.step(self._commands(actions))
        success, truncated = self.episode.success, self.episode.truncated
        live = self.agents
        if success or truncated:
            self.agents = []
        return (
            self._observations(),
            dict.fromkeys(live, reward),
            dict.fromkeys(live, success),
            dict.fromkeys(live, truncated),
            self._infos(),
        )

    def observe(self, agent: str) -> dict[str, FloatArray]:
        """Return what one agent knows now; fresh after :meth:`set_goals`."""
        index = self.possible_agents.index(agent)
        seen = self.episode.observe(index)
        parts = {
            "scan": seen.scan,
            "poses": team_poses(seen),
            "goal": geometry.polar(seen.pose, torch.from_numpy(self._goals[index : index + 1]).to(seen.pose)),
            "velocity": seen.velocity,
        }
        return to_arrays(parts, self.observation_spaces[agent])

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return a top-down picture (height, width, 3), or None without a render mode.

        Raises:
            ConfigError: if the render mode is ``"human"``.
            SimulatorError: before the first reset.
        """
        if self.render_mode is None:
            return None
        if self.render_mode == "human":
            raise ConfigError("there is no window to draw in; use render_mode='rgb_array'.")
        return self.episode.draw(self._goals)

    def close(self) -> None:
        """Free the simulator; safe to call twice."""
        self.episode.close()

    def _commands(self, actions: Mapping[str, Any]) -> FloatArray:
        if not self.agents:
            raise SimulatorError("no episode is running; call reset() first.")
        for agent in actions:
            if agent not in self.agents:
                raise SimulatorError(f"there is no agent '{agent}'; agents: {', '.join(self.agents)}.")
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise SimulatorError(f"there is no action for agent '{missing[0]}'; every agent needs {COMMAND}.")
        return np.stack([check_action(actions[agent], f"agent '{agent}'", COMMAND) for agent in self.agents])

    def _observations(self) -> Observations:
        return {agent: self.observe(agent) for agent in self.possible_agents}

    def _infos(self) -> dict[str, dict[str, Any]]:
        now, collided = self.episode.success_now, self.episode.collided
        return {
            agent: {"success_now": now, "success": self.episode.success, "collided": bool(collided[i])}
            for i, agent in enumerate(self.possible_agents)
        }


def _observation_space(robot: RobotSpec, count: int) -> spaces.Space[Any]:
    return spaces.Dict(
        {
            "scan": scan_space(robot),
            "poses": poses_space(count),
            "goal": goal_space(),
            "velocity": command_space(robot),
        }
    )
