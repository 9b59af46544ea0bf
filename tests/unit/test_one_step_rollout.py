"""The fused rollout of the paper's models against the same sums written plainly."""

from __future__ import annotations

import pytest
import torch

from hpp_framework.core import geometry
from hpp_framework.core.types import Observation
from hpp_framework.perception.sensing import HISTORY
from hpp_framework.prediction import delta_general_pose_lidar, delta_pose_lidar, pose_lidar
from hpp_framework.prediction.one_step import RANGE_CAP, OneStepNetwork
from hpp_framework.prediction.one_step_rollout import OneStep

BEAMS = 40
FORMS = [delta_pose_lidar.FORM, pose_lidar.FORM, delta_general_pose_lidar.FORM]


@pytest.fixture(params=FORMS, ids=lambda form: form.kind)
def form(request):
    return request.param


def plain_rollout(form, models, agent, observation, goals, horizon):
    """Algorithm 1's imagination, network by network, lidar by lidar."""
    count, candidates = goals.shape[:2]
    flat = goals.reshape(-1, 2)
    poses = observation.poses.repeat_interleave(candidates, 0)
    scans = [observation.scans.clamp(max=RANGE_CAP).repeat_interleave(candidates, 0) for _ in models]
    steps = []
    for _ in range(horizon):
        frame = form.frame(poses[:, -1, agent])
        newest = []
        for subject, model in enumerate(models):
            local = geometry.between(frame[:, None], poses[:, :, subject])
            out = model(local, scans[subject], geometry.to_frame(frame, flat))
            pose = out[:, :3] * form.pose_scale(own=subject == agent)
            seen = out[:, 3:] * form.scan_scale
            pose = local[:, -1] + pose if form.pose_changes else pose
            seen = scans[subject][:, -1] + seen if form.scan_changes else seen
            newest.append(geometry.compose(frame, pose))
            scans[subject] = torch.cat([scans[subject][:, 1:], seen[:, None]], 1)
        steps.append(torch.stack(newest, 1))
        poses = torch.cat([poses[:, 1:], steps[-1][:, None]], 1)
    return torch.stack(steps, 1).reshape(count, candidates, horizon, len(models), 3)


def networks(form, count, agent):
    torch.manual_seed(0)
    models = [OneStepNetwork(BEAMS) for _ in range(count)]
    for robot, model in enumerate(models):
        # motions of decimetres per step, and lidar changes that matter
        model.output.weight.data[:3] /= form.pose_scale(own=robot == agent)[:, None]
        model.output.weight.data[3:] *= 10
    return models


def observe(agent, robots, episodes=3):
    generator = torch.Generator().manual_seed(1)
    poses = torch.randn(episodes, HISTORY, robots, 3, generator=generator)
    scans = 6 + torch.rand(episodes, HISTORY, BEAMS, generator=generator)
    scans[:, :, :5] = 25.0
    return Observation(agent, poses, scans, torch.zeros(episodes, 2))


@pytest.mark.parametrize("candidates", [1, 6, 7])
@pytest.mark.parametrize(("robots", "agent"), [(1, 0), (2, 0), (2, 1), (5, 3)])
@pytest.mark.parametrize("horizon", [1, 5, 9])
@torch.no_grad()
def test_the_fused_rollout_equals_the_plain_one(monkeypatch, form, robots, agent, candidates, horizon):
    # the plain version imagines the lidar and must not cap it again on its way into the network
    monkeypatch.setattr(OneStepNetwork, "forward", uncapped)
    models = networks(form, robots, agent)
    seen = observe(agent, robots)
    goals = 3 * torch.randn(3, candidates, 2, generator=torch.Generator().manual_seed(2))
    expected = plain_rollout(form, models, agent, seen, goals, horizon)
    actual = OneStep(form, models, agent).rollout(seen, goals, horizon).poses
    assert (expected[:, :, -1] - expected[:, :, 0]).abs().max() > 0.01 or horizon == 1
    assert (actual - expected)[..., :2].abs().max() < 2e-4
    assert geometry.wrap_angle(actual[..., 2] - expected[..., 2]).abs().max() < 2e-4


def uncapped(self, poses, scans, goals):
    x = torch.cat([poses.flatten(1), scans.flatten(1) / RANGE_CAP, goals / RANGE_CAP], 1)
    return self.output(self.layers(x))


@torch.no_grad()
def test_goals_may_differ_in_number_and_value_from_call_to_call(form):
    predictor = OneStep(form, networks(form, 2, 0), 0)
    seen = observe(0, 2)
    imagine = predictor.condition(seen, 5)
    generator = torch.Generator().manual_seed(3)
    for candidates in (4, 4, 9):
        goals = torch.randn(3, candidates, 2, generator=generator)
        assert torch.equal(imagine(goals).poses, predictor.rollout(seen, goals, 5).poses)


@torch.no_grad()
def test_an_episode_does_not_depend_on_its_neighbours(form):
    predictor = OneStep(form, networks(form, 2, 1), 1)
    seen = observe(1, 2)
    goals = torch.randn(3, 5, 2, generator=torch.Generator().manual_seed(4))
    together = predictor.rollout(seen, goals, 5).poses
    for row in range(3):
        part = slice(row, row + 1)
        alone = Observation(1, seen.poses[part], seen.scans[part], seen.velocity[part])
        alone_poses = predictor.rollout(alone, goals[part], 5).poses[0]
        assert torch.allclose(alone_poses, together[row], atol=1e-5)
