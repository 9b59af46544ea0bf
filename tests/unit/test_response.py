"""Evidence of goals from motion, and the reward of a goal against what the others probably do."""

from __future__ import annotations

import pytest
import torch

from hpp_framework.core.types import Trajectories
from hpp_framework.planning.hpp.best_response import as_one_gaussian, likeliest, moments, pair_rewards
from hpp_framework.planning.hpp.inference import Evidence, GoalInference
from hpp_framework.planning.hpp.lattice import lattice_config
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub

INFERENCE = GoalInference(elapsed=1.0, surprise=0.2, forgetting=0.5, reach=0.5)
GOALS = torch.tensor([[[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]]])


def foreseen(positions):
    """Return what was foreseen for one second ahead: positions (b, g, n, 2)."""
    poses = torch.nn.functional.pad(positions[:, :, None], (0, 1))
    return Evidence(GOALS, Trajectories(poses, torch.ones(1)), torch.zeros(positions.shape[:3]))


def test_goals_that_explain_a_motion_gain(torch_rng):
    foretold = torch.randn(1, 3, 2, 2, generator=torch_rng)
    now = torch.stack([foretold[:, 1, 0], foretold[:, 2, 1]], 1)
    found = INFERENCE.weigh(foreseen(foretold), now, GOALS)
    assert found.argmax(1).tolist() == [[1, 2]]
    assert torch.equal(found.amax(1), torch.zeros(1, 2))


def test_there_is_no_evidence_at_the_start():
    assert not INFERENCE.weigh(None, torch.zeros(1, 2, 2), GOALS).any()


def test_evidence_fades_and_goes_to_the_nearest_candidate():
    before = foreseen(torch.zeros(1, 3, 1, 2))
    before = Evidence(GOALS, before.imagined, torch.tensor([[[0.0], [-8.0], [-2.0]]]))
    moved = torch.tensor([[[0.1, 3.1], [9.0, 9.0], [3.0, 0.2], [0.1, 0.0]]])
    found = INFERENCE.weigh(before, torch.zeros(1, 1, 2), moved)[0, :, 0]
    # the second lies near none of the old ones: as unlikely as the least likely
    assert found.tolist() == pytest.approx([-1.0, -4.0, -4.0, 0.0])


def test_pairs_of_goals_are_scored_as_one_by_one(torch_rng):
    team = parse_team("fetch,freight,fetch")
    task = hub().tasks.create("rendezvous", team.robots)
    poses = torch.randn(10, 6, 4, 3, 3, generator=torch_rng)
    imagined = Trajectories(poses, torch.arange(1.0, 5.0))
    others, chosen = likeliest(torch.randn(10, 6, generator=torch_rng), 3)
    found = pair_rewards(task, imagined, 1, others, chosen)
    assert others.sum(1).allclose(torch.ones(10))
    for row, own in [(0, 0), (3, 5), (9, 2)]:
        expected = torch.zeros(4)
        for share, goal in zip(others[row], chosen[row].tolist(), strict=True):
            pair = poses[row, goal].clone()
            pair[:, 1] = poses[row, own, :, 1]
            expected += share * task.reward(pair)
        assert found[row, own].allclose(expected, atol=1e-5)


def test_one_gaussian_puts_its_peak_between_two_ends():
    goals = torch.tensor([[[-3.0, 0.0], [0.0, 0.0], [3.0, 0.0]]])
    logits = torch.tensor([[0.0, -9.0, 0.0]])
    assert as_one_gaussian(logits, goals).argmax().item() == 1
    mean, std = moments(logits, goals)
    assert mean.abs().max() < 1e-3
    assert std[0].tolist() == pytest.approx([3.0, 0.0], abs=0.01)


def test_the_price_of_a_response_grows_with_the_robots_not_with_their_pairs():
    weighed = [lattice_config(robots).hypotheses for robots in (2, 4, 8, 16, 32, 400)]
    assert weighed == [24, 24, 24, 12, 6, 1]
