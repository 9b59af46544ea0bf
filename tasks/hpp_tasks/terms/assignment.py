"""Who takes which place: the roles with the least sum of squared distances, for many teams at once."""

from __future__ import annotations

from functools import cache
from itertools import permutations

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment
from torch import Tensor

MOST_TRIED = 5
"""Robots up to which all orders are tried at once; beyond, teams are solved one by one."""
MOST_TURNED = 4
"""Robots whose roles are worked out where the shape may be turned: all orders are tried."""


def nearest_roles(positions: Float[Tensor, "*b n 2"], offsets: Float[Tensor, "n 2"]) -> Int[Tensor, "*b n"]:
    """Return the index of the place that each robot takes.

    Least squares ask for the greatest sum of products of positions and places.

    Args:
        positions: of the robots.
        offsets: places.
    """
    count = len(offsets)
    gain = positions @ offsets.T
    if count <= MOST_TRIED:
        orders, chosen = _orders(count)
        return orders[(gain.flatten(-2) @ chosen.to(gain)).argmax(-1)]
    each = gain.reshape(-1, count, count).cpu().numpy()
    roles = np.stack([linear_sum_assignment(team, maximize=True)[1] for team in each])
    return torch.from_numpy(roles).reshape(positions.shape[:-1])


def turned_roles(positions: Float[Tensor, "*b n 2"], offsets: Float[Tensor, "n 2"]) -> Int[Tensor, "*b n"]:
    """Return the index of the place that each robot takes if the places may be turned about the origin.

    For given roles the best turn leaves the sum of squares lower the greater the length of the sum of
    products of positions and places as complex numbers.

    Args:
        positions: of the robots.
        offsets: places.
    """
    orders, _ = _orders(len(offsets))
    places = torch.view_as_complex(offsets.contiguous())[orders]
    fit = (torch.view_as_complex(positions.contiguous()) @ places.conj().T).abs()
    return orders[fit.argmax(-1)]


@cache
def _orders(count: int) -> tuple[Int[Tensor, "o n"], Float[Tensor, "k o"]]:
    """Return all orders, and which of all pairs of robot and place belong to each."""
    orders = torch.tensor(list(permutations(range(count))))
    chosen = torch.nn.functional.one_hot(orders, count).float()
    return orders, chosen.flatten(1).T.contiguous()
