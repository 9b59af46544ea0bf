"""Meta-planning as a Gymnasium environment: the action is a goal, skills drive (``hpp/Rendezvous-v0``).

One robot, the learner, is given goals from outside; its teammates run ordinary agents. So any Gymnasium
algorithm can be trained as a meta-planner: the upper level of the hierarchy.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from jaxtyping import Float
from torch import Tensor

from hpp_framework.agents.build import AgentConfig, Bounds, MakePlanner, build_scheduled_agents
from hpp_framework.config.planner_choice import parse_planner
from hpp_framework.core.agent import Agent
from hpp_framework.core.option import BUDGET, Option
from hpp_framework.core.planner import Belief, Decision, MetaPlanner, certain
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation
from hpp_framework.core.world import World
from hpp_framework.envs.episode import EpisodeConfig, TeamEpisode
from hpp_framework.envs.spaces import (
    FloatArray,
    check_action,
    command_space,
    poses_space,
    scan_space,
    team_poses,
    to_arrays,
    unit_space,
)
from hpp_framework.plugins.build import MakeOption, make_option
from hpp_framework.plugins.builtin import DEFAULT_BASELINE, DEFAULT_CONTROL, DEFAULT_TEAM, DEFAULT_WORLD
from hpp_framework.utils.errors import ConfigError, SimulatorError
from hpp_framework.utils.seeding import EpisodeRng
from hpp_framework.utils.validation import Count, Positive, validated
from hpp_framework.viz.picture import check_mode

PLAN_EVERY = 10

STAND = -1
"""Of no option: the robot stands."""

_MEANINGS = {
    2: "[x, y] of the goal, in -1..1",
    3: "[x, y] of the goal and the choice of the option, in -1..1",
}


@validated
class HierarchyConfig:
    """How goals are given and who the teammates are.

    Attributes:
        plan_every: control steps a goal lasts, at most; one environment step, unless there are options.
        options: that the learner chooses among, registered skills or functions that build one for its robot;
            an environment step then lasts until the option is over. None: its own skill, for ``plan_every``.
        budget: control steps an option made of a registered skill may take.
        reach: metres from the team's midpoint that an action of 1 stands for, each axis.
        control: control stack of the learner; the safety filter alone lets it go where it is told.
        teammates_control: control stack of the teammates.
        preset: of the teammates' planners.
        weights: extra folders searched for the teammates' predictor weights.
        episode: task, disturbances, backend, length in control steps.
    """

    plan_every: Count = PLAN_EVERY
    options: tuple[str | MakeOption, ...] = ()
    budget: Count = BUDGET
    reach: Positive = 5.0
    control: str = "safety-filter"
    teammates_control: str = DEFAULT_CONTROL
    preset: str = "best"
    weights: tuple[Path, ...] = ()
    episode: EpisodeConfig = EpisodeConfig()


class RendezvousEnv(gym.Env[Any, Any]):
    """One robot's meta-planner from the outside.

    Args:
        team: a team, or text such as ``"fetch,freight"``.
        world: a world, a registered world or a world file; a registered one is drawn afresh at each reset.
        learner: index of the robot that is given goals.
        teammates: registered planner or policy of the other robots, or a factory of a planner.
        config: planning period, control stacks, reach, task, disturbances, backend, length.
        render_mode: ``"rgb_array"`` or None.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  # Gymnasium's own form
        "render_modes": ["rgb_array"],
        "render_fps": 1 / (PLAN_EVERY * CONTROL_PERIOD),
    }

    def __init__(
        self,
        team: Team | str = DEFAULT_TEAM,
        *,
        world: World | str = DEFAULT_WORLD,
        learner: int = 0,
        teammates: str | MakePlanner = DEFAULT_BASELINE,
        config: HierarchyConfig | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = check_mode(render_mode)
        self.config = config or HierarchyConfig()
        self.episode = TeamEpisode(team, world, self.config.episode)
        count = len(self.episode.team)
        if not 0 <= learner < count:
            raise ConfigError(f"learner must be the index of a robot, 0 to {count - 1}, got {learner}.")
        self.learner = learner
        if isinstance(teammates, str):
            parse_planner(teammates)
        robot = self.episode.team.robots[learner]
        self.observation_space = spaces.Dict(
            {"scan": scan_space(robot), "poses": poses_space(count), "velocity": command_space(robot)}
        )
        self.options = [make_option(given, robot, self.config.budget) for given in self.config.options]
        self.action_space = unit_space(3 if len(self.options) > 1 else 2)
        self._told = _Told(self.config.plan_every, self.options)
        own = AgentConfig(planner=lambda _: self._told, control=self.config.control)
        other = AgentConfig(
            planner=teammates, control=self.config.teammates_control, preset=self.config.preset,
            weights=self.config.weights,
        )  # fmt: skip
        self._configs = [own if index == learner else other for index in range(count)]
        self._bounds: Bounds | None = None
        self._agents: list[Agent] = []
        self._running = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, FloatArray], dict[str, Any]]:
        """Start an episode: a new world, new starts, teammates without a belief.

        Args:
            seed: makes this episode and all that follow repeatable.
            options: ``"poses"``, starts (n, 3); others are ignored.
        """
        super().reset(seed=seed)
        self.episode.reset(int(self.np_random.integers(2**62)), (options or {}).get("poses"))
        if self._bounds != self.episode.world.bounds:
            # planners are told the bounds of their world
            self._bounds = self.episode.world.bounds
            self._agents = build_scheduled_agents(
                self.episode.team, self.episode.schedule, self._configs, self._bounds
            )
        for agent in self._agents:
            agent.reset([self.episode.seed])
        self._told.goal = self._midpoint()
        self._running = True
        return self._view(), {}

    def step(self, action: Any) -> tuple[dict[str, FloatArray], float, bool, bool, dict[str, Any]]:
        """Let the learner drive to a goal for ``plan_every`` control steps, or until the episode ends.

        With options, the learner follows the chosen one until it is over instead; one that may not be started
        for the goal stops the robot for ``plan_every`` steps.

        Args:
            action: offset of the goal from the midpoint of the observed positions, in units of ``reach``,
                along the world's axes; cut off at [-1, 1] and at the world's bounds. With several options a
                third number chooses: [-1, 1] is shared out among them evenly, in their order.

        Returns:
            Observation, reward (of the true poses, summed over the control steps), whether the task was
            fulfilled for its ``sustain_steps``, whether time ran out, and info: ``goal`` (2,) in world
            coordinates, control ``steps`` driven, ``success_now``, ``collided`` (the learner, any of them);
            with options also the name of the ``option``, and whether it was ``started``.

        Raises:
            SimulatorError: if no episode runs, or the action is not as many finite numbers as it should be.
        """
        if not self._running:
            raise SimulatorError("no episode is running; call reset() first.")
        option = self._choose(action)
        started = option is None or self._may_start(option)
        self._told.option = None if option is None else self.options.index(option) if started else STAND
        self._told.fresh = True
        before = self.episode.steps
        reward, collided = self._drive(option if started else None)
        info: dict[str, Any] = {
            "goal": self._told.goal[0].cpu().numpy().copy(),
            "steps": self.episode.steps - before,
            "success_now": self.episode.success_now,
            "collided": collided,
        }
        if option is not None:
            info |= {"option": option.name, "started": started}
        return self._view(), reward, self.episode.success, self.episode.truncated, info

    def _drive(self, option: Option | None) -> tuple[float, bool]:
        """Let all act until the option is over, or for ``plan_every`` steps; return reward and contact."""
        reward, collided, begun = 0.0, False, self.episode.steps
        while self._running:
            commands = [agent.act(self.episode.observe(i)) for i, agent in enumerate(self._agents)]
            reward += self.episode.step(torch.cat(commands).detach().cpu().numpy())
            collided |= bool(self.episode.collided[self.learner])
            self._running = not (self.episode.success or self.episode.truncated)
            if self._over(option, self.episode.steps - begun):
                break
        return reward, collided

    def render(self) -> npt.NDArray[np.uint8] | None:  # type: ignore[override]  # Gymnasium leaves the frame's type open
        """Return a top-down picture (height, width, 3), or None without a render mode."""
        if self.render_mode is None:
            return None
        goals = [_goal(agent) for agent in self._agents]
        return self.episode.draw(np.array(goals))

    def close(self) -> None:
        """Free the simulator; safe to call twice."""
        self.episode.close()

    def _choose(self, action: Any) -> Option | None:
        """Set the goal that an action means and return the option, None if there are none."""
        count = 3 if len(self.options) > 1 else 2
        numbers = np.clip(check_action(action, "the learner", _MEANINGS[count], count), -1, 1)
        goal = self._midpoint() + torch.from_numpy(numbers[:2]) * self.config.reach
        x_min, y_min, x_max, y_max = self.episode.world.bounds
        self._told.goal = torch.minimum(
            torch.maximum(goal, goal.new_tensor([x_min, y_min])), goal.new_tensor([x_max, y_max])
        )
        if len(self.options) < 2:
            return self.options[0] if self.options else None
        index = int((numbers[2] + 1) / 2 * len(self.options))
        return self.options[min(index, len(self.options) - 1)]

    def _may_start(self, option: Option) -> bool:
        return bool(option.may_start(self.episode.observe(self.learner), self._told.goal)[0])

    def _over(self, option: Option | None, steps: int) -> bool:
        """Return whether the environment step ends now, after a number of control steps."""
        if option is None:
            return steps >= self.config.plan_every
        return bool(option.is_over(self.episode.observe(self.learner), self._told.goal, steps)[0])

    def _midpoint(self) -> Float[Tensor, "1 2"]:
        return self.episode.observe(self.learner).team_poses[..., :2].mean(1)

    def _view(self) -> dict[str, FloatArray]:
        seen = self.episode.observe(self.learner)
        return to_arrays(
            {"scan": seen.scan, "poses": team_poses(seen), "velocity": seen.velocity}, self.observation_space
        )


class _Told(MetaPlanner):
    """Decides what it is told, at once.

    Attributes:
        goal: that all robots are to share, world frame, metres.
        option: index of the option that drives, -1 to stand; None for the learner's own skill.
        fresh: whether it has been told anew since it decided last.
    """

    goal: Float[Tensor, "1 2"]

    def __init__(self, plan_every: int, options: Sequence[Option]) -> None:
        self.plan_every = plan_every
        self.options = options
        self.option: int | None = None
        self.fresh = True

    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the goal set from outside."""
        self.fresh = False
        option = None if self.option is None else torch.tensor([self.option])
        return Decision(self.goal, certain(self.goal), option)

    def follow(self, observation: Observation, decision: Decision) -> Decision:
        """Decide anew where it has been told so."""
        return self.plan(observation, None, EpisodeRng([0])) if self.fresh else decision


def _goal(agent: Agent) -> npt.NDArray[np.floating]:
    """Return the goal (2,) an agent pursues, NaN before its first plan."""
    return np.full(2, np.nan) if agent.belief is None else agent.belief.goal[0].detach().cpu().numpy()
