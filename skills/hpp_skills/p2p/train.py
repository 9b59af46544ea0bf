"""Trains the point-to-point policy on random furnished rooms."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from functools import partial
from pathlib import Path
from time import time

import torch
from stable_baselines3 import PPO
from torch import Tensor

from hpp_framework.checkpoints import load_checkpoint, load_into, portable, save_checkpoint
from hpp_framework.envs.point_to_point import PointToPoint, PointToPointVectorEnv
from hpp_framework.evaluation.skill import evaluate_skill
from hpp_framework.registry import hub
from hpp_framework.robot import RobotSpec
from hpp_framework.seeding import child_seed
from hpp_framework.sensing import NoiseModel
from hpp_framework.skill import SkillTraining
from hpp_framework.training.ppo import PpoConfig, actor_modules, train_ppo
from hpp_framework.training.snapshots import remove_snapshot
from hpp_skills.p2p.network import FEATURES, HIDDEN, Encoder, PolicyNetwork
from hpp_skills.p2p.skill import PointToPoint as PointToPointSkill
from hpp_skills.p2p.skill import expected_metadata

ROBOTS = 512
ROBOTS_PER_WORLD = 2
WORLDS = 1000
NOISE = NoiseModel(position_std=0.02, heading_std=0.02, scan_std=0.02, dropout=0.01)


def train(config: SkillTraining) -> Path:
    """Train and write ``ROBOT.safetensors`` with its card into ``config.out``; returns the file.

    Raises:
        ConfigError: if the snapshot in ``config.out`` is damaged or of another training.
        CheckpointError: if the weights to start from do not fit, or nothing can be written.
    """
    torch.set_num_threads(config.threads)
    robot: RobotSpec = hub().robots.create(config.robot)
    # wrong weights to start from are found before the minute it takes to build the worlds
    initial = None
    if config.init:
        initial = partial(_start_from, config.init, _initial_weights(config.init, robot), robot)
    ppo = _ppo_config(fresh=initial is None)
    started = time()
    env = PointToPointVectorEnv(
        ROBOTS,
        robot=robot,
        pool_size=WORLDS,
        robots_per_world=ROBOTS_PER_WORLD,
        noise=NOISE,
        seed=config.seed,
    )
    model = train_ppo(
        env,
        partial(Encoder, robot.lidar.beams, robot.drive),
        FEATURES,
        out=config.out,
        steps=config.steps,
        seed=config.seed,
        config=ppo,
        initial=initial,
        run={"skill": "p2p", "robot": robot.name, "init": _digest(config.init)},
    )
    file = config.out / f"{robot.name}.safetensors"
    network = export(model, robot)
    metadata = {
        **_card(config, robot, network, ppo),
        "steps": model.num_timesteps,
        "minutes": round((time() - started) / 60, 1),
    }
    save_checkpoint(file, network.state_dict(), metadata)
    remove_snapshot(config.out)
    return file


def _ppo_config(*, fresh: bool) -> PpoConfig:
    if fresh:
        return PpoConfig(hidden=(HIDDEN,))
    # small steps and little exploration keep what the other robot's policy knows
    return PpoConfig(hidden=(HIDDEN,), learning_rate=1e-4, log_std_init=-1.2)


def _card(
    config: SkillTraining, robot: RobotSpec, network: PolicyNetwork, ppo: PpoConfig
) -> dict[str, object]:
    """Return what weights must say of themselves, how they were made, and how well they drive."""
    score = evaluate_skill(PointToPointSkill(network), robot, seed=child_seed(config.seed, "unseen worlds"))
    return {
        **expected_metadata(robot),
        "command": _command(config),
        "init": config.init.name if config.init else None,
        "seed": config.seed,
        "worlds": f"{WORLDS} x training, {ROBOTS_PER_WORLD} robots each",
        "noise": asdict(NOISE),
        "problem": asdict(PointToPoint()),
        "ppo": asdict(ppo),
        "unseen_worlds": asdict(score),
    }


def _command(config: SkillTraining) -> str:
    """Return the command line that repeats a training."""
    return (
        f"hpp train skill p2p --robot {config.robot} --steps {config.steps} --seed {config.seed} "
        f"--threads {config.threads}" + (f" --init {portable(config.init)}" if config.init else "")
    )


def _digest(file: Path | None) -> str | None:
    """Return what tells weights to start from apart, whatever their name."""
    return hashlib.sha256(file.read_bytes()).hexdigest() if file else None


def export(model: PPO, robot: RobotSpec) -> PolicyNetwork:
    """Return the actor of a trained model as a plain network."""
    network = PolicyNetwork(robot)
    encoder, hidden, action = actor_modules(model)
    network.encoder.load_state_dict(encoder.state_dict())
    network.hidden.load_state_dict(hidden[0].state_dict())
    network.action.load_state_dict(action.state_dict())
    return network


def _initial_weights(file: Path, robot: RobotSpec) -> dict[str, Tensor]:
    """Read another robot's policy with the same lidar."""
    return load_checkpoint(file, {"skill": "p2p", "beams": robot.lidar.beams})[0]


def _start_from(file: Path, weights: dict[str, Tensor], robot: RobotSpec, model: PPO) -> None:
    """Begin from another robot's policy."""
    network = PolicyNetwork(robot)
    load_into(network, weights, file)
    encoder, hidden, action = actor_modules(model)
    encoder.load_state_dict(network.encoder.state_dict())
    hidden[0].load_state_dict(network.hidden.state_dict())
    action.load_state_dict(network.action.state_dict())
