"""What a search may change about the point-to-point policy, and what it is judged by."""

from __future__ import annotations

import json
from contextlib import suppress
from functools import reduce
from pathlib import Path

from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

from hpp_framework.core.robot import RobotSpec
from hpp_framework.evaluation.skill import evaluate_skill
from hpp_framework.evaluation.statistics import wilson_interval
from hpp_framework.training.ppo import CURVE
from hpp_framework.training.search.space import Distribution, SkillSearch
from hpp_framework.utils.seeding import child_seed
from hpp_skills.p2p.recipe import Recipe
from hpp_skills.p2p.skill import load

WORLDS = ("training", "rooms", "passages", "legs")
NAVIGATION_TASKS = 125
"""In each world, each in a world of its own."""

REWARD: dict[str, Distribution] = {
    "reward.progress": FloatDistribution(0.5, 2.0),
    "reward.arrival": FloatDistribution(1.0, 10.0, log=True),
    "reward.collision": FloatDistribution(-6.0, -0.5),
    "reward.touch": FloatDistribution(-0.8, -0.05),
    "reward.step": FloatDistribution(-0.06, 0.0),
    "reward.turn": FloatDistribution(-0.02, 0.0),
    "reward.linger": FloatDistribution(0.05, 0.6),
    "rooms.comfort": FloatDistribution(0.1, 0.6),
    "randomisation.end_on_touch": FloatDistribution(0.0, 1.0),
    "ppo.gamma": CategoricalDistribution((0.98, 0.985, 0.99, 0.993)),
}
NETWORK: dict[str, Distribution] = {
    "network.scan": CategoricalDistribution(("conv", "dense")),
    "network.channels": CategoricalDistribution((8, 16, 24)),
    "network.features": IntDistribution(96, 256),
    "network.hidden": IntDistribution(64, 256),
    "ppo.learning_rate": FloatDistribution(1e-4, 1e-3, log=True),
    "ppo.n_epochs": IntDistribution(2, 5),
    "ppo.batch_size": CategoricalDistribution((2048, 4096)),
}


def search() -> SkillSearch:
    """Return the search: first the reward, then the network and how it learns."""
    recipe = Recipe()
    return SkillSearch(
        phases={"reward": REWARD, "network": NETWORK},
        start={name: reduce(getattr, name.split("."), recipe) for name in (*REWARD, *NETWORK)},
        objective=judge,
        curve=training_success,
    )


def judge(weights: Path, robot: RobotSpec, seed: int) -> dict[str, float]:
    """Return how a policy does on navigation tasks in four kinds of unseen worlds.

    The score is the mean over kinds of worlds of the mean of success and clean success, so that half of a
    success is lost by a touch. Shares of all tasks come with their 95 % Wilson bounds.

    Args:
        weights: of the policy.
        robot: that it was trained for.
        seed: of the tasks.
    """
    skill = load(robot, weights)
    judged = {
        world: evaluate_skill(
            skill,
            robot,
            world=world,
            episodes=NAVIGATION_TASKS,
            seed=child_seed(seed, "search", world),
        )
        for world in WORLDS
    }
    found = {"score": sum((each.success + each.clean) / 2 for each in judged.values()) / len(judged)}
    for name in ("success", "clean"):
        shares = [getattr(each, name) for each in judged.values()]
        tasks = NAVIGATION_TASKS * len(judged)
        share = sum(shares) / len(shares)
        low, high = wilson_interval(round(share * tasks), tasks)
        found |= {name: share, f"{name}_low": low, f"{name}_high": high}
        found |= {f"{name}_{world}": value for world, value in zip(judged, shares, strict=True)}
    spl = sum(each.spl for each in judged.values()) / len(judged)
    return {**found, "spl": spl, "navigation_tasks": float(NAVIGATION_TASKS * len(judged))}


def training_success(folder: Path) -> dict[int, float]:
    """Return the success in training by control steps, each over the last 2,000 episodes.

    Touches that end an episode (``randomisation.end_on_touch``) make training harder, so this favours
    lenient settings: it only serves to stop hopeless trainings early.

    Args:
        folder: of a training, which may still go on.
    """
    curve = folder / CURVE
    found: dict[int, float] = {}
    for line in curve.read_text().splitlines() if curve.exists() else []:
        # the last line may be half written; of steps that were gone over twice the last time counts
        with suppress(json.JSONDecodeError):
            row = json.loads(line)
            found[row["steps"]] = row["success"]
    return found
