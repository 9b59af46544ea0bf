"""Skill training by proximal policy optimisation (Schulman et al. 2017), Stable-Baselines3's."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from rich.progress import Progress
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import MultiInputActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from hpp_framework.envs.point_to_point import PointToPointVectorEnv
from hpp_framework.plugins.weights import RESUMES
from hpp_framework.training.adapter import Sb3Adapter
from hpp_framework.training.snapshots import load_snapshot, save_snapshot
from hpp_framework.utils.errors import CheckpointError, reason
from hpp_framework.utils.run_folder import RunFolder

CURVE = "curve.jsonl"


@dataclass(frozen=True, kw_only=True)
class PpoConfig:
    """Hyper-parameters; names as in Stable-Baselines3.

    Attributes:
        n_steps: control steps of every robot between two updates.
        batch_size: samples a gradient step.
        n_epochs: passes over the samples of an update.
        learning_rate: of Adam at the start; it falls linearly.
        final_learning_rate: of Adam at the end.
        gamma: discount a control step.
        gae_lambda: lambda of generalised advantage estimation, between bias (0) and variance (1).
        ent_coef: weight of the entropy in the loss.
        log_std_init: logarithm of the actions' standard deviation at the start, actions in [-1, 1]; it falls
            linearly, since left to itself it stays too large to pass narrow places.
        log_std_final: that at the end.
        hidden: units of the hidden layers, of actor and critic each.
    """

    n_steps: int = 32
    batch_size: int = 4096
    n_epochs: int = 4
    learning_rate: float = 4e-4
    final_learning_rate: float = 5e-5
    gamma: float = 0.99
    gae_lambda: float = 0.95
    ent_coef: float = 0.0
    log_std_init: float = -0.3
    log_std_final: float = -1.6
    hidden: tuple[int, ...] = (128,)


class _Extractor(BaseFeaturesExtractor):
    """Puts a skill's own encoder where Stable-Baselines3 wants an extractor; privileged entries come last."""

    def __init__(
        self, observation_space: spaces.Space[Any], encoder: Callable[[], nn.Module], width: int
    ) -> None:
        assert isinstance(observation_space, spaces.Dict)
        extra = observation_space.spaces.get("privileged")
        super().__init__(observation_space, width + (extra.shape[0] if extra and extra.shape else 0))
        self.encoder = encoder()

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        seen = self.encoder(observations["scan"], observations["goal"], observations["velocity"])
        return torch.cat([seen, observations["privileged"]], 1) if "privileged" in observations else seen


class _Heads(nn.Module):
    """Hidden layers of the actor, who sees the first ``width`` features, and of the critic, who sees all."""

    def __init__(self, features: int, width: int, hidden: Sequence[int]) -> None:
        super().__init__()
        self.width = width
        self.policy_net, self.latent_dim_pi = _layers(width, hidden)
        self.value_net, self.latent_dim_vf = _layers(features, hidden)

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        return self.policy_net(features[:, : self.width])

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        return self.value_net(features)


def _layers(width: int, hidden: Sequence[int]) -> tuple[nn.Sequential, int]:
    layers: list[nn.Module] = []
    for units in hidden:
        layers += [nn.Linear(width, units), nn.ReLU()]
        width = units
    return nn.Sequential(*layers), width


class _Policy(MultiInputActorCriticPolicy):
    """An actor that sees what the robot sees, beside a critic that sees more (Pinto et al. 2018)."""

    def _build_mlp_extractor(self) -> None:
        width: int = self.features_extractor_kwargs["width"]
        hidden: Any = self.net_arch
        self.mlp_extractor: Any = _Heads(self.features_dim, width, hidden)


class _Progress(BaseCallback):
    """Progress bar, learning curve on disk, resumable snapshots, clean interruption."""

    def __init__(
        self,
        out: Path,
        total: int,
        config: PpoConfig,
        share: Callable[[float], float],
        run: Mapping[str, Any],
        progress: Progress,
    ) -> None:
        super().__init__()
        self.out, self.total, self.progress, self.share = out, total, progress, share
        self.config, self.run = config, run
        self.interrupted = False
        self._began = perf_counter()
        self._task = progress.add_task("training", total=total)

    def _on_step(self) -> bool:
        return not self.interrupted

    def _on_rollout_start(self) -> None:
        assert isinstance(self.training_env, Sb3Adapter)
        done = self.num_timesteps / self.total
        self.training_env.env.tasks.share = self.share(done)
        log_std: Any = self.model.policy.log_std
        log_std.requires_grad_(requires_grad=False)
        log_std.fill_(self.config.log_std_init * (1 - done) + self.config.log_std_final * done)

    def _on_rollout_end(self) -> None:
        assert isinstance(self.training_env, Sb3Adapter)
        recent = self.training_env.recent
        success = float(np.mean(recent)) if recent else 0.0
        row = {
            "steps": self.num_timesteps,
            "success": success,
            "touch_share": float(np.mean(self.training_env.touch_share)),
            "worlds": round(self.training_env.env.tasks.share, 4),
            # since this process began or resumed the training; `hpp bench` reads speed off it
            "seconds": round(perf_counter() - self._began, 4),
        }
        for name in ("success", "touch_share", "worlds"):
            self.logger.record(f"training/{name}", row[name])
        curve = self.out / CURVE
        try:
            with curve.open("a") as stream:
                stream.write(json.dumps(row) + "\n")
        except OSError as error:
            raise CheckpointError(f"cannot write '{curve}': {reason(error)}. {RESUMES}") from error
        self.progress.update(
            self._task, completed=self.num_timesteps, description=f"training, success {success:.3f}"
        )
        assert isinstance(self.model, PPO)
        if (self.num_timesteps // self.model.n_steps // self.training_env.num_envs) % 20 == 0:
            save_snapshot(self.model, self.out, self.run)


def train_ppo(
    env: PointToPointVectorEnv,
    encoder: Callable[[], nn.Module],
    width: int,
    *,
    out: Path,
    steps: int,
    seed: int,
    config: PpoConfig | None = None,
    share: Callable[[float], float] = lambda _: 1.0,
    initial: Callable[[PPO], None] | None = None,
    run: Mapping[str, Any] | None = None,
) -> PPO:
    """Train, showing progress; resumes from the snapshot in ``out`` if it is there.

    Args:
        env: robots to train on.
        encoder: builds the module that maps (scan, goal, velocity) to features of ``width``.
        width: number of features.
        out: folder for the learning curve and snapshots.
        steps: control steps in all.
        seed: of network, worlds and noise; 0 to 2**32 - 1.
        config: hyper-parameters.
        share: part of the pool's worlds, the easiest, that training uses when a part of it is done.
        initial: called with the fresh model to load weights to start from.
        run: further options (JSON-compatible) that a snapshot must share to be resumed from.

    Raises:
        ConfigError: if the snapshot is damaged or of another training.
        CheckpointError: if a snapshot or the curve cannot be written.
        KeyboardInterrupt: after an interruption, once a snapshot is written.
    """
    config = config or PpoConfig()
    described = {**(run or {}), "seed": seed, "steps": steps, "ppo": asdict(config)}
    RunFolder(out).check()
    adapter = Sb3Adapter(env, seed)
    model = _fresh(adapter, encoder, width, out, seed, config)
    if not load_snapshot(model, out, described) and initial:
        initial(model)
    _learn(model, out, steps, config, share, described)
    return model


def _learning_rate(config: PpoConfig, left: float) -> float:
    """Return the learning rate when a share ``left`` of the training remains."""
    return config.final_learning_rate + (config.learning_rate - config.final_learning_rate) * left


def _fresh(
    adapter: Sb3Adapter,
    encoder: Callable[[], nn.Module],
    width: int,
    out: Path,
    seed: int,
    config: PpoConfig,
) -> PPO:
    return PPO(
        _Policy, adapter, seed=seed, device="cpu",
        n_steps=config.n_steps, batch_size=config.batch_size, n_epochs=config.n_epochs,
        learning_rate=partial(_learning_rate, config), gamma=config.gamma, gae_lambda=config.gae_lambda,
        ent_coef=config.ent_coef, tensorboard_log=_tensorboard(out),
        policy_kwargs={
            "features_extractor_class": _Extractor,
            "features_extractor_kwargs": {"encoder": encoder, "width": width},
            "net_arch": list(config.hidden),
            "log_std_init": config.log_std_init,
        },
    )  # fmt: skip


@torch.no_grad()
def _discounted_value(model: PPO, observations: dict[str, torch.Tensor]) -> torch.Tensor:
    policy: Any = model.policy
    return model.gamma * policy.predict_values(observations)


def _tensorboard(out: Path) -> str | None:
    """Return the folder of TensorBoard's logs, or None where it is not installed (extra ``logging``)."""
    return str(out / "tensorboard") if find_spec("tensorboard") else None


def _learn(
    model: PPO,
    out: Path,
    steps: int,
    config: PpoConfig,
    share: Callable[[float], float],
    run: Mapping[str, Any],
) -> None:
    """Train up to ``steps`` in all; an interruption ends the update, saves and raises KeyboardInterrupt."""
    left = steps - model.num_timesteps
    adapter = model.get_env()
    assert isinstance(adapter, Sb3Adapter)
    with Progress() as progress:
        callback = _Progress(out, steps, config, share, run, progress)
        previous = signal.signal(signal.SIGINT, lambda *_: setattr(callback, "interrupted", True))
        try:
            if left > 0:
                adapter.critic = partial(_discounted_value, model)
                model.learn(left, callback=callback, reset_num_timesteps=False)
        finally:
            signal.signal(signal.SIGINT, previous)
    if callback.interrupted:
        save_snapshot(model, out, run)
        raise KeyboardInterrupt


def actor_modules(model: PPO) -> tuple[nn.Module, Sequence[nn.Module], nn.Module]:
    """Return (encoder, hidden layers of the actor, action layer) of a trained model."""
    policy: Any = model.policy
    return policy.features_extractor.encoder, list(policy.mlp_extractor.policy_net), policy.action_net
