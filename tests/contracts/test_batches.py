"""An episode is the same, bit for bit, alone and among others: seeds, noise and networks do not mix rows."""

from __future__ import annotations

from functools import cache

import pytest
import torch

from hpp_framework.evaluation import experiment as experiments
from hpp_framework.evaluation.experiment import Experiment, draw_episode, run_drawn
from hpp_framework.evaluation.rollout import run_episodes
from hpp_framework.worlds.loader import resolve_world

EPISODES, WATCHED, STEPS = 5, 3, 12
ROUGH = (
    "field:position_std=0.1:heading_std=0.1:lost_beams=0.05:message_loss=0.3:jump_rate=0.2:jump_size=0.3:"
    "fault=frozen:fault_rate=0.3:fault_time=0.4:glass=0.1:nan_beams=0.02"
)
PLANNERS = ("centralized-mp", "centralized-rp", "hpp", "hpp:preset=paper", "maddpg", "rrt-mp", "wander")


@cache
def drawn(world):
    """Return worlds and starts of some episodes."""
    named = Experiment(worlds=(world,), planners=("hpp",), seed=21)
    return {number: draw_episode(named, world, resolve_world(world), number) for number in range(EPISODES)}


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """A few seconds show what would differ: rounding errors grow with every contact and every plan."""

    def few(*args, **options):
        return run_episodes(*args, **options, steps=STEPS)

    monkeypatch.setattr(experiments, "run_episodes", few)


def poses_of(experiment, numbers):
    world = experiment.worlds[0]
    chosen = {number: drawn(world)[number] for number in numbers}
    return run_drawn(experiment, experiment.planners[0], world, chosen).poses


def check_alone_as_in_a_batch(experiment):
    together = poses_of(experiment, range(EPISODES))[WATCHED]
    alone = poses_of(experiment, [WATCHED])[0]
    length = min(len(together), len(alone))
    assert torch.equal(alone[:length], together[:length])
    assert not torch.equal(alone[0], alone[length - 1]), "who stands all the time shows nothing"


@pytest.mark.parametrize("noise", ["ideal", ROUGH], ids=["exact", "noisy"])
@pytest.mark.parametrize("planner", PLANNERS)
def test_an_episode_alone_equals_itself_in_a_batch(planner, noise):
    check_alone_as_in_a_batch(
        Experiment(
            worlds=("navigation",), planners=(planner,), episodes=EPISODES, seed=21, disturbances=noise
        )
    )


@pytest.mark.parametrize(("team", "world"), [("fetch,freight,fetch", "wall"), ("fetch", "simple")])
def test_so_do_episodes_of_teams_of_any_size(team, world):
    named = Experiment(
        worlds=(world,), planners=("hpp",), episodes=EPISODES, seed=21, team=team, disturbances=ROUGH
    )
    chosen = {number: draw_episode(named, world, resolve_world(world), number) for number in range(2)}
    together = run_drawn(named, "hpp", world, chosen).poses[1]
    alone = run_drawn(named, "hpp", world, {1: chosen[1]}).poses[0]
    length = min(len(together), len(alone))
    assert torch.equal(alone[:length], together[:length])


def test_the_order_of_a_batch_does_not_matter():
    noisy = Experiment(
        worlds=("navigation",), planners=("hpp",), episodes=EPISODES, seed=21, disturbances=ROUGH
    )
    forward, backward = poses_of(noisy, [1, 2]), poses_of(noisy, [2, 1])
    assert torch.equal(forward, backward.flip(0))


def test_episodes_with_the_same_world_and_start_but_other_seeds_differ():
    """Else a broken seed, the same for all episodes, would go unnoticed here."""
    noisy = Experiment(
        worlds=("simple",), planners=("wander",), episodes=EPISODES, seed=21, disturbances=ROUGH
    )
    one = drawn("simple")[0]
    first, second = run_drawn(noisy, "wander", "simple", {0: one, 1: one}).poses
    assert torch.equal(first[0], second[0])
    assert not torch.equal(first[-1], second[-1])
