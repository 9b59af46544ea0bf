"""The model of skills in an empty world against the simulator."""

from __future__ import annotations

import torch

from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.plugins.build import make_skills, parse_team
from hpp_framework.prediction.empty_world import EmptyWorld, observed_velocities
from hpp_framework.sim.batch.simulator import BatchSimulator


def drive(team, world, goals, steps):
    """Drive a team for some steps; returns observations and the poses of all, step by step."""
    batch = EpisodeBatch(BatchSimulator(team.robots, threads=1))
    starts = torch.tensor([[[-4.0, 0.0, 0.5], [4.0, 1.0, 2.0]], [[-3.0, 2.0, -1.0], [3.0, -4.0, 0.0]]])
    batch.begin([world, world], starts, range(2))
    skills = make_skills(team)
    seen, poses = [], []
    for _ in range(steps):
        seen.append([batch.observe(i) for i in range(len(team))])
        commands = [skill.act(own, goals) for skill, own in zip(skills, seen[-1], strict=True)]
        poses.append(batch.step(torch.stack(commands, 1)).poses)
    return seen, poses


def test_in_an_empty_world_it_is_right(empty_world):
    team = parse_team("fetch,freight", skill="pure-pursuit")
    goals = torch.tensor([[0.0, 8.0], [1.0, 6.0]])
    seen, poses = drive(team, empty_world, goals, 25)
    out = EmptyWorld(team).rollout(seen[4][0], goals[:, None], 4)
    assert out.times.tolist() == [1, 2, 3, 4]
    for second in range(4):
        truth = poses[4 + 5 * (second + 1) - 1]
        own, other = (out.poses[:, 0, second] - truth)[..., :2].norm(dim=-1).amax(0)
        assert own < 1e-5
        assert other < 0.3  # its speed is a mean over the last step


def test_goals_do_not_influence_each_other_and_may_change_in_number(empty_world):
    team = parse_team("fetch,freight")
    seen = drive(team, empty_world, torch.zeros(2, 2), 3)[0][-1][1]
    model = EmptyWorld(team)
    goals = torch.randn(2, 3, 2, generator=torch.Generator().manual_seed(0))
    together = model.rollout(seen, goals, 2).poses
    alone = torch.cat([model.rollout(seen, goals[:, i : i + 1], 2).poses for i in range(3)], 1)
    assert torch.allclose(together, alone, atol=1e-5)


def test_speeds_are_read_off_the_last_step(empty_world):
    team = parse_team("fetch,freight", skill="pure-pursuit")
    seen, _ = drive(team, empty_world, torch.zeros(2, 2), 12)
    own, other = seen[-1]
    theirs = observed_velocities(own)[:, 1]
    assert torch.equal(observed_velocities(own)[:, 0], own.velocity)
    # mean over a step, not its end
    assert (theirs - other.velocity)[:, 0].abs().max() < 0.06
