"""Trains the point-to-point policy in random worlds, from open rooms to clutter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from time import time
from typing import Any

import torch
from stable_baselines3 import PPO

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.skill import SkillTraining, as_pairs
from hpp_framework.envs.point_to_point import PointToPointVectorEnv
from hpp_framework.evaluation.competence import competence_card
from hpp_framework.evaluation.skill import evaluate_skill, skill_episodes
from hpp_framework.evaluation.skill_score import SkillRow
from hpp_framework.evaluation.trial import Trial
from hpp_framework.plugins.registry import hub
from hpp_framework.plugins.weights import file_digest, load_checkpoint, load_into, portable, save_checkpoint
from hpp_framework.training.curve import draw_learning_curve
from hpp_framework.training.ppo import actor_modules, train_ppo
from hpp_framework.training.snapshots import remove_snapshot
from hpp_framework.utils.errors import unknown_name
from hpp_framework.utils.seeding import child_seed
from hpp_framework.worlds.pool import build_training_pool
from hpp_skills.p2p.network import Encoder, NetworkShape, PolicyNetwork
from hpp_skills.p2p.recipe import GOING_ON, Recipe, Rooms
from hpp_skills.p2p.skill import PointToPoint as PointToPointSkill
from hpp_skills.p2p.skill import expected_metadata, find

JUDGED: dict[str, dict[str, Any]] = {
    name: {"world": name, "clearance": clearance, "episodes": 200}
    for name, clearance in (
        ("training", 0.15), ("rooms", 0.05), ("passages", 0.05), ("legs", 0.15), ("barn", 0.05)
    )
}  # fmt: skip
"""Worlds that a finished policy is judged in, and the gap to obstacles that its paths can keep."""


def train(config: SkillTraining) -> Path:
    """Train and write ``ROBOT.safetensors`` with its card into ``config.out``; returns the file.

    Raises:
        ConfigError: if the snapshot in ``config.out`` is damaged or of another training, or a setting wrong.
        CheckpointError: if the weights to start from do not fit, or nothing can be written.
        UnknownNameError: if there are none of the name.
    """
    torch.set_num_threads(config.threads)
    robot: RobotSpec = hub().robots.create(config.robot)
    recipe = Recipe().altered(GOING_ON if config.init else {}).altered(config.settings)
    # wrong weights to start from are found before the minute it takes to build the worlds
    init = _weights(config.init) if config.init else None
    initial = _initial(init, robot, recipe) if init else None
    started = time()
    model = train_ppo(
        _env(recipe, robot, config),
        partial(Encoder, recipe.network, robot.lidar.beams, robot.drive),
        recipe.network.features,
        out=config.out,
        steps=config.steps,
        seed=config.seed,
        config=replace(recipe.ppo, hidden=(recipe.network.hidden,)),
        share=partial(_share, recipe.rooms),
        initial=initial,
        run={
            "skill": "p2p", "robot": robot.name, "init": file_digest(init), "recipe": asdict(recipe)
        },
    )  # fmt: skip
    file = config.out / f"{robot.name}.safetensors"
    network = export(model, robot, recipe.network)
    stage = {
        "command": _command(config),
        "steps": model.num_timesteps,
        "minutes": round((time() - started) / 60, 1),
    }
    earlier = load_checkpoint(init, {})[1].get("stages", []) if init else []
    metadata = {**_card(config, robot, recipe), "stages": [*earlier, stage]}
    if config.judge:
        seed = child_seed(config.seed, "unseen worlds")
        metadata |= judged(PointToPointSkill(network), robot, seed)
    save_checkpoint(file, network.state_dict(), metadata)
    draw_learning_curve(config.out)
    remove_snapshot(config.out)
    return file


def judged(skill: PointToPointSkill, robot: RobotSpec, seed: int) -> dict[str, object]:
    """Return how well a policy drives in unseen worlds, for its card.

    Args:
        skill: the policy.
        robot: what it drives.
        seed: of the worlds.

    Returns:
        ``unseen_worlds``: scores by world of goals 5 to 10 m away; ``competence``: the map of where it may be
        trusted, over all those worlds.
    """
    scores = {name: evaluate_skill(skill, robot, seed=seed, **trial) for name, trial in JUDGED.items()}
    rows: list[SkillRow] = []
    for name in JUDGED:
        trial = Trial(
            world=name, episodes=120, goal_distance=(1.0, 15.0), clearance=0.05, draw="even", seed=seed
        )
        rows += skill_episodes(skill, robot, trial)
    return {
        "unseen_worlds": {name: asdict(score) for name, score in scores.items()},
        "competence": competence_card(rows),
    }


def _env(recipe: Recipe, robot: RobotSpec, config: SkillTraining) -> PointToPointVectorEnv:
    rooms = recipe.rooms
    robot = replace(robot, footprint_radius=robot.footprint_radius + rooms.margin)
    # a training has no use for more worlds than it has episodes
    count = max(1, min(rooms.count, config.steps // recipe.reward.max_steps))
    pool = build_training_pool(
        rooms.world, count, [robot], seed=config.seed, clearance=rooms.clearance, goals=rooms.goals,
        comfort=rooms.comfort,
    )  # fmt: skip
    return PointToPointVectorEnv(
        rooms.robots, robot=robot, pool=pool, robots_per_world=rooms.robots_per_world,
        problem=recipe.reward, randomisation=recipe.randomisation, seed=config.seed,
    )  # fmt: skip


def _share(rooms: Rooms, done: float) -> float:
    """Return the part of the worlds, the easiest, that training uses when a part of the training is done."""
    return min(1.0, rooms.first_share + (1 - rooms.first_share) * done / max(rooms.all_from, 1e-9))


def _card(config: SkillTraining, robot: RobotSpec, recipe: Recipe) -> dict[str, object]:
    """Return what weights must say of themselves, and how they were made."""
    return {
        **expected_metadata(robot),
        "network": asdict(recipe.network),
        "seed": config.seed,
        "recipe": asdict(recipe),
    }


def _command(config: SkillTraining) -> str:
    """Return the command line that repeats a training."""
    return (
        f"hpp train skill p2p --robot {config.robot} --steps {config.steps} --seed {config.seed} "
        f"--threads {config.threads}"
        + (f" --init {portable(config.init)}" if config.init else "")
        + (" --set " + " ".join(as_pairs(config.settings)) if config.settings else "")
    )


def export(model: PPO, robot: RobotSpec, shape: NetworkShape) -> PolicyNetwork:
    """Return the actor of a trained model as a plain network."""
    network = PolicyNetwork(robot, shape)
    encoder, hidden, action = actor_modules(model)
    network.encoder.load_state_dict(encoder.state_dict())
    network.hidden.load_state_dict(hidden[0].state_dict())
    network.action.load_state_dict(action.state_dict())
    return network


def _weights(init: Path) -> Path:
    """Return the file to start from: itself, or that of the robot it names.

    Raises:
        UnknownNameError: if it is neither, and does not look like a file.
    """
    robots = hub().robots
    if init.is_file():
        return init
    if str(init) in robots:
        return find(robots.create(str(init)))
    if not init.suffix:
        raise unknown_name("weights file or robot", str(init), (entry.name for entry in robots))
    return init


def _initial(file: Path, robot: RobotSpec, recipe: Recipe) -> Callable[[PPO], None]:
    """Read another robot's policy with the same lidar; returns what gives it to a model."""
    weights, _ = load_checkpoint(file, {"skill": "p2p", "beams": robot.lidar.beams})
    network = PolicyNetwork(robot, recipe.network)
    load_into(network, weights, file)
    return partial(_start_from, network)


def _start_from(network: PolicyNetwork, model: PPO) -> None:
    encoder, hidden, action = actor_modules(model)
    encoder.load_state_dict(network.encoder.state_dict())
    hidden[0].load_state_dict(network.hidden.state_dict())
    action.load_state_dict(network.action.state_dict())
