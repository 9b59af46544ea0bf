"""Rolls the one-step models of a whole team out together (Algorithm 1), fast enough to plan without a pause.

What is the same for every goal is computed once an observation: how the real lidar enters the first layer.
The imagined lidar is never written down. It is a linear function of a last layer, or a sum of those, and it
enters a first layer linearly, so one matrix per number of steps in between carries it from one to the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.predictor import Imagine, Predictor, PredictorRequest
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation, Trajectories
from hpp_framework.perception.sensing import HISTORY
from hpp_framework.prediction import one_step_kernels as kernels
from hpp_framework.prediction.library import load_models
from hpp_framework.prediction.one_step import RANGE_CAP, Form, OneStepNetwork, build
from hpp_framework.utils.blocks import in_blocks
from hpp_framework.utils.kernels import wp

BLOCK = 8
"""Episodes whose observations are prepared at a time, so that none depends on how many there are."""
_ALWAYS = 1 << 30


class OneStep(Predictor):
    """Imagines a team step by step; every model keeps a lidar imagination of its own.

    Args:
        form: of all models.
        models: one per robot, in team order; that of the agent is its self-predictor.
        agent: index of the predicting agent.
    """

    def __init__(self, form: Form, models: Sequence[OneStepNetwork], agent: int) -> None:
        self.agent = agent
        self._weights = _Weights(form, models, agent)

    @torch.no_grad()
    def condition(self, observation: Observation, horizon: int) -> Imagine:
        """Prepare to imagine ``horizon`` control steps; each call overwrites the trajectories of the last."""
        return _Conditioned(self._weights, self.agent, observation, horizon)

    def rollout(self, observation: Observation, goals: Float[Tensor, "b g 2"], horizon: int) -> Trajectories:
        """Imagine ``horizon`` control steps."""
        return self.condition(observation, horizon)(goals)


class _Weights:
    """Weights of a team's models in the order in which the kernel reads them.

    Attributes:
        models: for the kernel.
        scans: first layers of the capped lidar history (entry and beam, robot and unit).
        bias: of the first layers.
        drift: what the constant part of an imagined lidar adds to a first layer 1, 2, ... steps later, and
            what it adds after even more.
    """

    def __init__(self, form: Form, models: Sequence[OneStepNetwork], agent: int) -> None:
        self._form = form
        layers = [[m for m in model.layers if isinstance(m, torch.nn.Linear)] for model in models]
        with torch.no_grad():
            first = torch.stack([own[0].weight.T for own in layers])  # inputs: poses, scans, goal
            poses, scans, goals = first.split([3 * HISTORY, first.shape[1] - 3 * HISTORY - 2, 2], 1)
            scans = scans.unflatten(1, (HISTORY, -1)) / RANGE_CAP
            # the entry of the history that is so many steps old, or all that are at most
            recent = scans.flip(1).cumsum(1) if form.scan_changes else scans.flip(1)
            heads = torch.stack([torch.cat([m.output.weight.T, m.output.bias[None]]) for m in models])
            scales = torch.stack([form.pose_scale(own=robot == agent) for robot in range(len(models))])
            change, seen = heads[..., :3] * scales[:, None], heads[..., 3:] * form.scan_scale
            lags = torch.einsum("nwk,nlkv->nlwv", seen, recent)
            self.scans = scans.permute(1, 2, 0, 3).flatten(2).flatten(0, 1).contiguous()
            self.bias = torch.stack([own[0].bias for own in layers])
            later = lags[:, -1:, -1] if form.scan_changes else torch.zeros_like(lags[:, -1:, -1])
            self.drift = torch.cat([lags[:, :, -1], later], 1)
            hidden = [
                torch.stack([torch.cat([own[i].weight.T, own[i].bias[None]]) for own in layers])
                for i in (1, 2, 3)
            ]
            self._packed = (torch.cat([poses, goals / RANGE_CAP], 1), lags, *hidden, change)
        self.models: Any = kernels.Models()
        self.models.in_world, self.models.pose_changes = int(form.in_world), int(form.pose_changes)
        self.models.reach = _ALWAYS if form.scan_changes else HISTORY
        names = ("near", "lags", "second", "third", "last", "change")
        kinds = (kernels.First, kernels.First, kernels.Second, kernels.Third, kernels.Last, wp.vec3)
        for name, kind, tensor in zip(names, kinds, self._packed, strict=True):
            setattr(self.models, name, wp.from_torch(tensor.contiguous(), dtype=kind))
        self._offsets: dict[int, Tensor] = {}

    def base(self, scans: Float[Tensor, "b h k"], horizon: int) -> Float[Tensor, "b t n w"]:
        """Return what bias, real lidar and the constant part of the imagined one add to the first layers."""
        capped = scans.clamp(max=RANGE_CAP)
        # imagined changes come on top of the newest scan, imagined scans take its place
        rest = capped[:, -1:] if self._form.scan_changes else torch.zeros_like(capped[:, -1:])
        longest = torch.cat([capped, rest.expand(-1, horizon - 1, -1)], 1)
        windows = longest.unfold(1, HISTORY, 1).transpose(2, 3).reshape(-1, len(self.scans))
        out = (windows @ self.scans).unflatten(0, (-1, horizon)).unflatten(2, self.bias.shape)
        return out.add_(self._offset(horizon))

    def _offset(self, horizon: int) -> Float[Tensor, "t n w"]:
        """Return bias and drift by step."""
        if horizon not in self._offsets:
            steps = torch.arange(-1, horizon - 1).clamp(max=HISTORY)
            drift = self.drift[:, steps]
            drift[:, 0] = 0
            self._offsets[horizon] = (self.bias[:, None] + drift.cumsum(1)).transpose(0, 1).contiguous()
        return self._offsets[horizon]


class _Conditioned:
    """Imagines the team after one observation, for any goals."""

    def __init__(self, weights: _Weights, agent: int, observation: Observation, horizon: int) -> None:
        self._weights = weights
        self._agent = agent
        self._horizon = horizon
        self._history = observation.poses.contiguous()
        self._base = in_blocks(lambda scans: weights.base(scans, horizon), observation.scans, rows=BLOCK)
        times = torch.arange(1, horizon + 1, device=self._base.device, dtype=self._base.dtype)
        self._times = times * CONTROL_PERIOD
        self._goals = self._history.new_empty(0, 0, 2)
        self._launches: list[Any] = []

    def __call__(self, goals: Float[Tensor, "b g 2"]) -> Trajectories:
        if goals.shape != self._goals.shape:
            self._prepare(goals)
        self._goals.copy_(goals)
        for launch in self._launches:
            launch.launch()
        return Trajectories(self._poses, self._times)

    def _prepare(self, goals: Tensor) -> None:
        """Make room for so many goals and record the launches: the agent first, then the others."""
        episodes, candidates = goals.shape[:2]
        robots, width = self._base.shape[2:]
        self._goals = torch.empty_like(goals, memory_format=torch.contiguous_format)
        self._poses = self._base.new_empty(episodes, candidates, self._horizon, robots, 3)
        self._hidden = self._base.new_empty(episodes, candidates, robots, self._horizon, width)
        others = [robot for robot in range(robots) if robot != self._agent]
        wrap = wp.from_torch
        arrays = [
            wrap(self._base, dtype=kernels.First), wrap(self._history, dtype=wp.vec3),
            wrap(self._goals, dtype=wp.vec2), wrap(self._hidden, dtype=kernels.Last),
            wrap(self._poses, dtype=wp.vec3),
        ]  # fmt: skip
        device = wp.device_from_torch(goals.device)
        self._launches = [
            wp.launch(
                kernels.imagine,
                dim=(episodes, (candidates + 1) // 2, len(order)),
                inputs=[self._weights.models, self._agent, order, *arrays],
                device=device,
                record_cmd=True,
            )
            for order in (wp.array(robots, dtype=int, device=device) for robots in ([self._agent], others))
            if len(order)
        ]


def create_form(form: Form, request: PredictorRequest) -> OneStep:
    """Load the models of a team (see :func:`hpp_framework.prediction.library.load_models` for the errors)."""
    models = load_models(form.kind, request, build)
    return OneStep(form, cast("list[OneStepNetwork]", models), request.agent)
