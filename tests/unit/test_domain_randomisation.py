"""Domain randomisation, settings of a recipe, and repeatable training."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from hpp_skills.p2p import train as p2p
from hpp_skills.p2p.network import NetworkShape, PolicyNetwork
from hpp_skills.p2p.recipe import GOING_ON, Recipe
from safetensors.torch import load_file

from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.skill import SkillTraining
from hpp_framework.envs.navigation_tasks import NavigationTasks
from hpp_framework.envs.point_to_point import PRIVILEGED, PointToPointVectorEnv
from hpp_framework.envs.problem import DomainRandomisation, PointToPoint
from hpp_framework.training.ppo import PpoConfig
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.pool import build_training_pool

QUIET = DomainRandomisation(
    disturbances=Disturbances(), late=0.0, weakest_drive=1.0, end_on_touch=0.0, detours=0.0
)


@pytest.fixture(scope="module")
def pool(fetch):
    return build_training_pool("mixed", 4, [fetch], seed=0, clearance=0.1, goals=3, comfort=0.3)


def training_env(pool, randomisation, count=32, **options):
    env = PointToPointVectorEnv(count, pool=pool, randomisation=randomisation, seed=0, **options)
    env.reset(seed=0)
    return env


def test_a_training_pool_goes_from_easy_to_hard_and_knows_the_paths_to_its_goals(pool):
    assert pool.paths is not None
    assert len(pool.paths.values) == 4 * 3
    for world in range(4):
        goals = torch.from_numpy(pool.points[world, :3])
        field = torch.arange(3) + 3 * world
        assert pool.paths.at(field, goals).max() < 0.4
        others = pool.paths.at(field, goals.roll(1, 0))
        assert (others >= (goals - goals.roll(1, 0)).norm(dim=1) * 0.98 - 0.1).all()


def test_reward_counts_metres_along_the_path_and_the_guide_tells_them(pool):
    env = training_env(pool, QUIET, problem=PointToPoint(step=0.0, turn=0.0, linger=0.0, touch=0.0))
    before = env.tasks.left(env.simulator.state().poses)
    seen, reward, ended, truncated, _ = env.step(np.tile([0.5, 0.2], (32, 1)))
    after = env.tasks.left(env.simulator.state().poses)
    going = ~(ended | truncated)
    assert np.allclose(reward[going], (before - after).flatten().numpy()[going], atol=1e-5)
    assert seen["privileged"].shape == (32, PRIVILEGED)
    assert np.allclose(seen["privileged"][:, 0], after.flatten().numpy() / 10, atol=1e-5)
    assert np.allclose(np.hypot(seen["privileged"][:, 1], seen["privileged"][:, 2]), 1, atol=1e-5)


def test_the_guide_points_down_the_path(pool):
    env = training_env(pool, QUIET, count=64)
    poses = env.simulator.state().poses
    bearing = env.tasks.direction(poses) + poses[..., 2]
    ahead = poses.clone()
    ahead[..., :2] += 0.2 * torch.stack([bearing.cos(), bearing.sin()], -1)
    nearer = env.tasks.left(ahead) < env.tasks.left(poses)
    assert nearer.float().mean() > 0.95


def test_late_commands_take_effect_a_period_later(pool):
    late, prompt = (training_env(pool, replace(QUIET, late=share)) for share in (1.0, 0.0))
    go = np.tile([1.0, 0.0], (32, 1))
    assert np.abs(late.step(go)[0]["velocity"]).max() == 0
    assert prompt.step(go)[0]["velocity"][:, 0].max() > 0.05
    assert late.step(go)[0]["velocity"][:, 0].max() > 0.05


def test_weaker_drives_are_slower_and_differ_between_worlds(pool):
    env = training_env(pool, replace(QUIET, weakest_drive=0.5))
    speeds = env.step(np.tile([1.0, 0.0], (32, 1)))[0]["velocity"][:, 0]
    limit = env.robot.drive.acceleration * 0.2
    assert (speeds <= limit + 1e-6).all()
    assert speeds.min() < 0.75 * limit
    assert len(np.unique(speeds.round(4))) > 5


def test_touches_end_episodes_as_failures_if_asked(pool):
    def failures(share):
        env = training_env(pool, replace(QUIET, end_on_touch=share), count=64)
        ends = 0
        for _ in range(60):
            _, _, ended, _, info = env.step(np.tile([1.0, 0.0], (64, 1)))
            ends += int((ended & ~info.get("final_info", {"success": ended})["success"]).sum())
        return ends

    assert failures(0.0) == 0
    assert failures(1.0) > 10


def test_disturbances_are_a_share_of_the_strongest_anew_in_each_world(pool):
    strong = replace(QUIET, disturbances=Disturbances(position_std=0.5))
    env = training_env(pool, strong, count=256)
    true = env.tasks.straight(env.simulator.state().poses).flatten().numpy()
    error = np.abs(env.reset(seed=0)[0]["goal"][:, 0] - true)
    strength = env._batch.sensing.sensors.intensity.numpy()
    assert strength.min() < 0.1
    assert strength.max() > 0.9
    assert error[strength < 0.1].mean() < error[strength > 0.7].mean() / 3


def test_detours_lead_a_longer_path_around(pool, torch_rng):
    def extra(share):
        tasks = NavigationTasks(pool, (400, 1), (1.0, 8.0), 0.9, share)
        poses = tasks.draw(torch.ones(400, 1, dtype=torch.bool), torch.zeros(400, 1, 3), torch_rng)
        return float((tasks.left(poses) - tasks.straight(poses)).mean())

    assert extra(1.0) > 1.2 * extra(0.0)


@pytest.mark.parametrize("name", ["late", "weakest_drive", "end_on_touch", "detours"])
def test_shares_beyond_one_are_refused(name):
    with pytest.raises(
        ConfigError, match=f"'{name}' must be at most 1, got 1.5. .*is a share between 0 and 1"
    ):
        DomainRandomisation(**{name: 1.5})


def test_a_recipe_takes_settings_by_dotted_name():
    recipe = Recipe().altered({"reward.touch": -1, "network.hidden": 64, "rooms.world": "rooms"})
    assert (recipe.reward.touch, recipe.network.hidden, recipe.rooms.world) == (-1.0, 64, "rooms")
    assert recipe.altered(GOING_ON).rooms.first_share == 1.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"reward.tuch": 1.0}, "'tuch' is unknown. Did you mean 'touch'"),
        ({"practice.detours": 0.3}, "'practice' is unknown. It is now called 'randomisation'"),
        ({"rewards": 1.0}, "'rewards' is unknown. Did you mean 'reward'"),
        ({"reward": 1.0}, "names no single setting"),
        ({"reward.touch.more": 1.0}, "names no single setting"),
        ({"network.hidden": 64.5}, r"must be a whole number \(like 128\), got 64.5"),
        ({"network.hidden": "eight"}, r"must be a whole number \(like 128\), got 'eight'"),
        ({"reward.touch": "much"}, r"must be a number \(like -\d.*\), got 'much'"),
        ({"rooms.world": 3}, r"must be text \(like 'mixed'\), got 3"),
        ({"network.scan": "rnn"}, "'scan' must be 'conv' or 'dense', got 'rnn'"),
    ],
)
def test_wrong_settings_are_named(settings, message):
    with pytest.raises(ConfigError, match=message):
        Recipe().altered(settings)


@pytest.mark.parametrize("scan", ["conv", "dense"])
def test_networks_of_either_kind_keep_to_the_drive_limits(fetch, scan, torch_rng):
    network = PolicyNetwork(fetch, NetworkShape(scan=scan, channels=4, features=16, hidden=8))
    scan = torch.rand(50, fetch.lidar.beams, generator=torch_rng) * 5
    command = network(scan, torch.rand(50, 2, generator=torch_rng), torch.zeros(50, 2))
    assert command.shape == (50, 2)
    assert ((command[:, 0] >= 0) & (command[:, 0] <= 1) & (command[:, 1].abs() <= 3)).all()


def test_the_same_seed_trains_the_same_policy(tmp_path, monkeypatch, tiny_training):
    monkeypatch.setattr(
        p2p, "Recipe", partial(p2p.Recipe, ppo=PpoConfig(n_steps=16, batch_size=16, n_epochs=1))
    )

    def weights(name, seed):
        config = SkillTraining(
            robot="fetch", out=tmp_path / name, seed=seed, steps=64, threads=1, judge=False
        )
        config.out.mkdir()
        return load_file(p2p.train(config))

    first, again, other = weights("a", 5), weights("b", 5), weights("c", 6)
    assert all(torch.equal(first[name], again[name]) for name in first)
    assert not all(torch.equal(first[name], other[name]) for name in first)
    assert (tmp_path / "a" / "learning_curve.png").stat().st_size > 5000
