"""Teams that change during an episode: their agents, and the least times in which they can succeed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from hpp_framework.agents.hierarchical import Agent
from hpp_framework.agents.scheduled import PartTimeAgent, Shift
from hpp_framework.core.privileged import PrivilegedPlanner
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.world import World
from hpp_framework.evaluation.rollout import EPISODE_STEPS
from hpp_framework.evaluation.task_bounds import task_bounds
from hpp_framework.utils.errors import ConfigError


def join_agents(turns: Sequence[Shift], agents: Sequence[Sequence[Agent]], robots: int) -> list[Agent]:
    """Return the agents of a team, in team order; those of a team that changes take part when they shall.

    Args:
        turns: who takes part when.
        agents: of those who take part, a list for each turn.
        robots: of the whole team.

    Raises:
        ConfigError: if a ceiling is to plan for a team that changes, or nobody can succeed in time.
    """
    if len(turns) == 1:
        return list(agents[0])
    if any(isinstance(agent.planner, PrivilegedPlanner) for those in agents for agent in those):
        raise ConfigError(
            "a ceiling plans for the whole team at once, not for one that robots join or leave. "
            "Leave out either the ceiling, or joins_at and leaves_at."
        )
    first = next(turn.first for turn in turns if turn.complete)
    if first >= EPISODE_STEPS:
        raise ConfigError(
            f"the last robot joins at {first * CONTROL_PERIOD:g} s, but episodes end after "
            f"{EPISODE_STEPS * CONTROL_PERIOD:g} s; lower its joins_at."
        )
    return [
        PartTimeAgent(
            [
                (turn, those[turn.present.index(index)] if index in turn.present else None)
                for turn, those in zip(turns, agents, strict=True)
            ]
        )
        for index in range(robots)
    ]


def least_times(
    worlds: Sequence[World], starts: Float[np.ndarray, "b n 3"], team: Team, turns: Sequence[Shift]
) -> Float[np.ndarray, "b"]:
    """Return times in seconds that no team beats, whoever takes part at the end.

    See :func:`~hpp_framework.evaluation.task_bounds.task_bounds`. A robot that joins late could have used
    that time, as far as this bound knows, so it is loose for those.

    Args:
        worlds: one an episode.
        starts: start poses, at rest.
        team: everybody.
        turns: who takes part when.
    """
    least = np.full(len(worlds), np.inf)
    for turn in turns:
        if turn.complete:
            those = list(turn.present)
            found = task_bounds(worlds, starts[:, those], team.part(those).robots, turn.task)
            begun = (turn.first + turn.task.sustain_steps) * CONTROL_PERIOD
            least = np.minimum(least, np.maximum(found, begun))
    return least
