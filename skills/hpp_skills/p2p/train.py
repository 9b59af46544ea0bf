"""Trains the point-to-point policy on random furnished rooms."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path
from time import time

import torch
from stable_baselines3 import PPO

from hpp_framework.checkpoints import load_checkpoint, load_into, save_checkpoint
from hpp_framework.envs.point_to_point import PointToPoint, PointToPointVectorEnv
from hpp_framework.evaluation.skill import evaluate_skill
from hpp_framework.registry import hub
from hpp_framework.robot import RobotSpec
from hpp_framework.seeding import child_seed
from hpp_framework.sensing import NoiseModel
from hpp_framework.skill import SkillTraining
from hpp_framework.training.ppo import PpoConfig, actor_modules, train_ppo
from hpp_skills.p2p.network import FEATURES, HIDDEN, Encoder, PolicyNetwork
from hpp_skills.p2p.skill import PointToPoint as PointToPointSkill
from hpp_skills.p2p.skill import expected_metadata

ROBOTS = 512
ROBOTS_PER_WORLD = 2
WORLDS = 1000
NOISE = NoiseModel(position_std=0.02, heading_std=0.02, scan_std=0.02, dropout=0.01)


def train(config: SkillTraining) -> Path:
    """Train and write ``ROBOT.safetensors`` with its card into ``config.out``; returns the file."""
    torch.set_num_threads(config.threads)
    robot: RobotSpec = hub().robots.create(config.robot)
    ppo = PpoConfig(hidden=(HIDDEN,), learning_rate=1e-4 if config.init else PpoConfig().learning_rate,
                    log_std_init=-1.2 if config.init else PpoConfig().log_std_init)  # fmt: skip
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
        initial=partial(_start_from, config.init, robot) if config.init else None,
    )
    file = config.out / f"{robot.name}.safetensors"
    network = export(model, robot)
    score = evaluate_skill(PointToPointSkill(network), robot, seed=child_seed(config.seed, "unseen worlds"))
    metadata = {
        **expected_metadata(robot),
        "command": f"hpp train skill p2p --robot {robot.name} --steps {config.steps} --seed {config.seed}",
        "init": config.init.name if config.init else None,
        "seed": config.seed,
        "steps": model.num_timesteps,
        "minutes": round((time() - started) / 60, 1),
        "worlds": f"{WORLDS} x training, {ROBOTS_PER_WORLD} robots each",
        "noise": asdict(NOISE),
        "problem": asdict(PointToPoint()),
        "ppo": asdict(ppo),
        "unseen_worlds": asdict(score),
    }
    save_checkpoint(file, network.state_dict(), metadata)
    (config.out / "resume.zip").unlink(missing_ok=True)
    return file


def export(model: PPO, robot: RobotSpec) -> PolicyNetwork:
    """Return the actor of a trained model as a plain network."""
    network = PolicyNetwork(robot)
    encoder, hidden, action = actor_modules(model)
    network.encoder.load_state_dict(encoder.state_dict())
    network.hidden.load_state_dict(hidden[0].state_dict())
    network.action.load_state_dict(action.state_dict())
    return network


def _start_from(file: Path, robot: RobotSpec, model: PPO) -> None:
    """Begin from another robot's policy with the same lidar."""
    weights, _ = load_checkpoint(file, {"skill": "p2p", "beams": robot.lidar.beams})
    network = PolicyNetwork(robot)
    load_into(network, weights, file)
    encoder, hidden, action = actor_modules(model)
    encoder.load_state_dict(network.encoder.state_dict())
    hidden[0].load_state_dict(network.hidden.state_dict())
    action.load_state_dict(network.action.state_dict())
