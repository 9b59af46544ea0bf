"""MADDPG: gradient steps against a slow reference, a game with a known answer, files, and who drives."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
import torch
from torch import nn

from hpp_framework.agents.policy import PolicyAgent
from hpp_framework.cli.main import main
from hpp_framework.core.control import ControlStack
from hpp_framework.core.planner import PlannerContext
from hpp_framework.core.types import Observation
from hpp_framework.planning.baselines.maddpg import (
    MaddpgPolicy,
    empty_actors,
    expected_metadata,
    feature_count,
    features,
    file_name,
)
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.plugins.weights import load_checkpoint, save_checkpoint
from hpp_framework.training.maddpg.episodes import Rooms, TrainingEpisodes, exploration
from hpp_framework.training.maddpg.learner import Learner, MaddpgConfig, Replay, Transitions
from hpp_framework.training.maddpg.seeds import Judge, MaddpgTraining, keep_best, plot_seeds, train_seed
from hpp_framework.utils.errors import CheckpointError, ConfigError
from hpp_framework.utils.seeding import torch_rng

AGENTS, FEATURES = 3, 5
TINY = {
    "rooms.count": 2, "rooms.episodes": 5, "rooms.steps": 4, "warm_up": 20, "update_every": 10, "judged": 3
}  # fmt: skip


def transitions(rng, size=32):
    def draw(*shape):
        return torch.randn(size, *shape, generator=rng)

    return Transitions(draw(AGENTS, FEATURES), draw(AGENTS, 2).tanh(), draw(), draw(AGENTS, FEATURES))


def alone(layers, index):
    """Copy one network of a stack into torch's own layers."""
    sizes = [weight.shape[1:] for weight in layers.weights]
    parts = [nn.Linear(*size) for size in sizes]
    for linear, weight, bias in zip(parts, layers.weights, layers.biases, strict=True):
        linear.weight.data, linear.bias.data = weight.data[index].T.clone(), bias.data[index, 0].clone()
    return nn.Sequential(parts[0], nn.ReLU(), parts[1], nn.ReLU(), parts[2])


class Reference:
    """Algorithm 1 of Lowe et al., agent by agent and term by term."""

    def __init__(self, learner):
        self.config = learner.config
        pairs = [(learner.actors, learner.critics), (learner.actors, learner.critics)]
        (self.actors, self.critics), (self.old_actors, self.old_critics) = (
            tuple([alone(layers, index) for index in range(AGENTS)] for layers in pair) for pair in pairs
        )
        self.adam = {
            network: torch.optim.Adam(network.parameters(), lr=self.config.learning_rate)
            for network in [*self.actors, *self.critics]
        }

    def step(self, network, loss):
        self.adam[network].zero_grad()
        loss.backward()
        for parameters in network.parameters():
            nn.utils.clip_grad_norm_([parameters], self.config.clip)
        self.adam[network].step()

    def update(self, batch):
        flat = batch.seen.flatten(1)
        for agent in range(AGENTS):
            with torch.no_grad():
                then = [self.old_actors[j](batch.seen_next[:, j]).tanh() for j in range(AGENTS)]
                worth = self.old_critics[agent](torch.cat([batch.seen_next.flatten(1), *then], 1))[:, 0]
            target = batch.rewards + self.config.gamma * worth
            guess = self.critics[agent](torch.cat([flat, batch.actions.flatten(1)], 1))[:, 0]
            self.step(self.critics[agent], ((guess - target) ** 2).mean())
        for agent in range(AGENTS):
            raw = self.actors[agent](batch.seen[:, agent])
            actions = [batch.actions[:, j] if j != agent else raw.tanh() for j in range(AGENTS)]
            worth = self.critics[agent](torch.cat([flat, *actions], 1))
            self.step(self.actors[agent], self.config.shrink * (raw**2).mean() - worth.mean())
        for old, new in zip(
            [*self.old_actors, *self.old_critics], [*self.actors, *self.critics], strict=True
        ):
            for target, parameters in zip(old.parameters(), new.parameters(), strict=True):
                target.data = (1 - self.config.follow) * target.data + self.config.follow * parameters.data


def test_updates_agree_with_algorithm_1():
    rng = torch_rng(0, "reference")
    learner = Learner(AGENTS, FEATURES, 2, MaddpgConfig(follow=0.3, learning_rate=0.01), rng)
    reference = Reference(learner)
    for _ in range(4):
        batch = transitions(rng)
        learner.update(batch)
        reference.update(batch)
    for layers, networks in ((learner.actors, reference.actors), (learner.critics, reference.critics)):
        for index, network in enumerate(networks):
            for ours, theirs in zip(alone(layers, index).parameters(), network.parameters(), strict=True):
                torch.testing.assert_close(ours, theirs, atol=2e-5, rtol=1e-4)


def test_targets_by_hand():
    """Weights of zero: Q is the last bias, so y = r + gamma * bias and the loss is known."""
    learner = Learner(2, 1, 1, MaddpgConfig(gamma=0.5), torch_rng(0, "hand"))
    _, target_critics = learner._targets
    for layers in (learner.critics, target_critics):
        for parameters in layers.parameters():
            parameters.data.zero_()
    learner.critics.biases[2].data[:, 0, 0] = torch.tensor([1.0, 3.0])
    target_critics.biases[2].data[:, 0, 0] = torch.tensor([2.0, 4.0])
    batch = Transitions(
        torch.zeros(2, 2, 1), torch.zeros(2, 2, 1), torch.tensor([0.0, 6.0]), torch.ones(2, 2, 1)
    )
    # targets (1, 7) against 1, and (2, 8) against 3
    assert float(learner.critic_loss(batch).detach()) == pytest.approx((0 + 36) / 2 + (1 + 25) / 2)


def test_agents_learn_to_share_a_sum():
    """Both see s and are paid for a sum of s and for equal shares: s / 2 each is best."""
    rng = torch_rng(3, "game")
    learner = Learner(2, 1, 1, MaddpgConfig(gamma=0.0, batch=256, learning_rate=3e-3), rng)
    for _ in range(400):
        sums = torch.rand(256, 1, 1, generator=rng) * 1.6 - 0.8
        seen = sums.expand(-1, 2, -1)
        actions = (learner.act(seen) + 0.3 * torch.randn(256, 2, 1, generator=rng)).clamp(-1, 1)
        one, other = actions[:, 0, 0], actions[:, 1, 0]
        reward = -((one + other - sums[:, 0, 0]) ** 2) - 0.3 * (one - other) ** 2
        learner.update(Transitions(seen, actions, reward, seen))
    sums = torch.tensor([-0.5, -0.2, 0.3, 0.5])
    chosen = learner.act(sums[:, None, None].expand(-1, 2, -1))[..., 0]
    assert (chosen - sums[:, None] / 2).abs().max() < 0.1


def test_replay_gives_whole_transitions_of_finished_rounds_only():
    """Features say round, step and episode; a transition's two must be neighbours of one episode."""
    replay = Replay(2, 3, 4, (2, 1), 1)
    for round_ in range(3):
        number = torch.arange(4.0)[:, None, None].expand(-1, 2, -1) + 100 * round_
        replay.begin(number)
        for step in range(3):
            if round_ == 2 and step == 2:
                break
            replay.add(step, number, number[:, 0, 0], number + 10 * (step + 1))
    # the third round is not finished, and the first has not been forgotten for it
    assert len(replay) == 2 * 12
    batch = replay.sample(500, torch_rng(0, "replay"))
    assert torch.equal(batch.seen_next, batch.seen + 10)
    rewards = batch.rewards
    assert torch.equal(rewards, batch.actions[:, 0, 0])
    assert torch.equal(batch.seen[:, 0, 0] % 10, rewards % 10)
    assert sorted({int(number) // 100 for number in rewards}) == [0, 1]
    for step in range(3):
        replay.add(step, number, number[:, 0, 0], number + 10 * (step + 1))
    assert sorted({int(number) // 100 for number in replay.sample(500, torch_rng(0, "x")).rewards}) == [1, 2]


def test_noise_has_its_deviation_and_lasts():
    noise = exploration((2000, 1), 0.3, 0.15, torch_rng(0, "noise"))
    now, then = next(noise), next(noise)
    assert float(then.std()) == pytest.approx(0.3, rel=0.1)
    assert float((now * then).mean() / 0.09) == pytest.approx(0.85, rel=0.1)


@pytest.fixture
def team():
    return parse_team("fetch,freight", skill="pure-pursuit")


def observation(agent, poses):
    poses = torch.tensor(poses)[None, None]
    return Observation(agent, poses, torch.full((1, 1, 222), 3.0), torch.tensor([[0.5, 0.3]]))


def test_features_are_seen_from_the_robot(team):
    seen = features(observation(0, [[1.0, 2.0, torch.pi / 2], [1.0, 7.0, 0.0]]), team.robots[0], [1])
    assert seen.shape == (1, feature_count(team.robots))
    torch.testing.assert_close(seen[0, :6], torch.tensor([0.5, 0.1, 0.5, 0.0, 0.0, -1.0]), atol=1e-6, rtol=0)
    assert bool((seen[0, 6:] == 0.3).all())


def test_a_robot_keeps_its_actor_whatever_the_teams_order(team):
    actors = empty_actors(team.robots, torch_rng(0, "actors"))
    here, there = [0.0, 0.0, 0.3], [2.0, 1.0, 1.0]
    first = MaddpgPolicy(actors, team.robots, 0).act(observation(0, [here, there]))
    swapped = MaddpgPolicy(actors, team.robots[::-1], 1).act(observation(1, [there, here]))
    assert torch.equal(first, swapped)
    assert not torch.equal(first, MaddpgPolicy(actors, team.robots, 1).act(observation(1, [there, here])))


def test_a_policy_drives_itself_and_points_where_it_goes(team):
    actors = empty_actors(team.robots, torch_rng(0, "actors"))
    policy = MaddpgPolicy(actors, team.robots, 0)
    agent = PolicyAgent(policy, ControlStack())
    seen = observation(0, [[1.0, 2.0, 0.5], [4.0, 4.0, 0.0]])
    speed, turn = policy.act(seen)[0]
    assert torch.equal(agent.act(seen), policy.act(seen))
    # one second along the arc, in small steps
    time = (torch.arange(2000) + 0.5) / 2000
    heading = 0.5 + turn * time
    arc = torch.tensor([1.0, 2.0]) + speed * torch.stack([heading.cos(), heading.sin()], -1).mean(0)
    torch.testing.assert_close(agent.goal[0], arc, atol=1e-4, rtol=0)


def test_weights_fit_their_team_and_task_only(team, tmp_path):
    task = hub().tasks.create("rendezvous", team.robots)
    actors = empty_actors(team.robots, torch_rng(0, "actors"))
    file = tmp_path / "maddpg" / f"{file_name(team.robots)}.safetensors"
    save_checkpoint(file, actors.state_dict(), expected_metadata(team.robots, task))
    context = PlannerContext(team=team, agent=0, task=task, weights=(tmp_path,))
    assert torch.equal(hub().policies.create("maddpg", context).actors.weights[0], actors.weights[0])
    task.radius = 2.0
    with pytest.raises(CheckpointError, match="radius"):
        hub().policies.create("maddpg", context)
    trio = parse_team("fetch,freight,fetch", skill="pure-pursuit")
    with pytest.raises(CheckpointError, match="hpp train maddpg --team fetch,freight,fetch"):
        hub().policies.create("maddpg", replace(context, team=trio))
    with pytest.raises(ConfigError, match="two and more robots"):
        hub().policies.create("maddpg", replace(context, team=parse_team("fetch")))


def test_finished_seeds_are_kept_and_the_best_one_chosen(team, tmp_path):
    trainings = [
        MaddpgTraining(team=team, out=tmp_path, seed=seed, steps=80, settings=TINY) for seed in (0, 1)
    ]
    for training in trainings:
        train_seed(training, lambda _: None)
    written = trainings[0].file.read_bytes()
    train_seed(trainings[0], lambda _: None)
    assert trainings[0].file.read_bytes() == written
    train_seed(replace(trainings[0], out=tmp_path / "again"), lambda _: None)
    assert (tmp_path / "again/seed-0/maddpg/fetch-freight.safetensors").read_bytes() == written
    with pytest.raises(ConfigError, match="steps was 80, is 40"):
        train_seed(replace(trainings[0], steps=40), lambda _: None)
    weights, card = load_checkpoint(trainings[1].file, {})
    card["curve"][-1]["judged_return"] = 1.0
    save_checkpoint(trainings[1].file, weights, card)
    file, card = keep_best(trainings)
    assert card["run"]["seed"] == 1
    assert torch.equal(load_checkpoint(file, {})[0]["weights.0"], weights["weights.0"])
    assert len(json.loads(file.with_suffix(".json").read_text())["curves"]["0"]) == 4
    assert plot_seeds(tmp_path / "seeds.png", card).is_file()


def test_the_weights_judged_best_are_kept(team, tmp_path, monkeypatch):
    returns = iter([-5.0, -7.0, -6.0, -8.0])
    monkeypatch.setattr(Judge, "__call__", lambda *_: {"judged_return": next(returns), "success": 0.0})
    training = MaddpgTraining(team=team, out=tmp_path, steps=80, settings={**TINY, "warm_up": 40})
    train_seed(training, lambda _: None)
    weights, card = load_checkpoint(training.file, {})
    assert card["judged"]["steps"] == 20
    # before any gradient step
    learner = Learner(2, feature_count(team.robots), 2, MaddpgConfig(), torch_rng(0, "network"))
    assert torch.equal(weights["weights.0"], learner.actors.weights[0])


def test_agents_train_with_the_control_stack_that_they_are_judged_with(team):
    """A team that stands together stops on success whatever it wants to do; without layers it drives off."""
    task = hub().tasks.create("rendezvous", team.robots)
    moved = {}
    for control in ("stop-on-success:beyond=0", "stop-on-success:beyond=0,safety-filter", "none"):
        rooms = Rooms(world="simple", count=1, episodes=2, steps=3, control=control)
        episodes = TrainingEpisodes(team.robots, task, rooms, 0)
        together = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.8, 0.0]]).expand(2, 2, 3)
        whole_team = torch.ones(2, 2, dtype=torch.bool)
        episodes._batch.start(
            episodes._simulator.place(torch.zeros(2, dtype=torch.int32), whole_team, together), range(2)
        )
        seen, reward = episodes.step(torch.ones(2, 2, 2))
        moved[control] = float(seen[..., 0].max())
        assert bool((reward == 0).all())
    assert moved.pop("none") > 0.05
    assert set(moved.values()) == {0.0}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--team fetch", "two and more robots"), ("--seeds 3..1", "--seeds"), ("--seeds -1", "--seeds"),
        ("--set learner.gama=0.9", "'gamma'"), ("--task rendezvouz", "'rendezvous'"),
    ],
)  # fmt: skip
def test_wrong_options_are_refused(options, message, tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["train", "maddpg", "--out", str(tmp_path / "out"), *options.replace("-1", "'-1'").split()])
    assert message in capsys.readouterr().err
