"""The cross-entropy method (de Boer et al. 2005), batched; a pure optimiser that knows nothing of robots."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import EpisodeRng
from hpp_framework.utils.validation import Count, NonNegative, validated


@validated
class CemConfig:
    """Parameters of the search; defaults are the paper's (appendix C.1).

    Attributes:
        iterations: at most this many.
        samples: drawn an iteration (N).
        elites: of them kept for the update (M).
        epsilon: a row stops once its largest standard deviation is no more than this.
    """

    iterations: Count = 15
    samples: Count = 15
    elites: Count = 5
    epsilon: NonNegative = 1e-3

    def __post_init__(self) -> None:
        if self.elites > self.samples:
            raise ConfigError(f"CEM needs elites <= samples, got {self}.")


@dataclass(frozen=True)
class CemResult:
    """Outcome of a search; ``samples`` and ``scores`` are those of the last iteration."""

    mean: Float[Tensor, "b d"]
    std: Float[Tensor, "b d"]
    samples: Float[Tensor, "b g d"]
    scores: Float[Tensor, "b g"]


def cross_entropy(
    objective: Callable[[Float[Tensor, "b g d"]], Float[Tensor, "b g"]],
    mean: Float[Tensor, "b d"],
    std: Float[Tensor, "b d"],
    rng: EpisodeRng,
    config: CemConfig,
) -> CemResult:
    """Maximise an objective, each row of the batch by its own Gaussian.

    Args:
        objective: scores of candidates; higher is better. Called once an iteration for all rows.
        mean: of the first Gaussian.
        std: of the first Gaussian, an axis each.
        rng: source of the samples, all drawn at once: a row's result does not depend on when others converge.
        config: parameters.
    """
    samples = mean[:, None]
    scores = mean.new_zeros(len(mean), 1)
    drawn = rng.normal(config.iterations, config.samples, mean.shape[1]).to(mean)
    for noise in drawn.unbind(1):
        active = std.amax(1, keepdim=True) > config.epsilon
        if not bool(active.any()):
            break
        samples = torch.addcmul(mean[:, None], noise, std[:, None])
        scores = objective(samples)
        best = scores.topk(config.elites, dim=1, sorted=False).indices
        elites = samples.gather(1, best[..., None].expand(-1, -1, mean.shape[1]))
        variance, middle = torch.var_mean(elites, 1, correction=0)
        mean = torch.where(active, middle, mean)
        std = torch.where(active, variance.sqrt(), std)
    return CemResult(mean, std, samples, scores)
