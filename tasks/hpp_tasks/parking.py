"""Where the robots of a large team stop around a goal that they share.

Two robots that make for one point meet. Of eight, the first stands on it, and those who come next stand
around the first, too far out: nobody makes room. So each gets a spot of its own.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.utils.kernels import vectors, wp
from hpp_tasks import parking_kernels


def spots(
    goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"], radius: float, apart: float
) -> Float[Tensor, "*c n 2"]:
    """Return a spot around a goal for each robot; the same whoever asks.

    The team is drawn to the goal from where it stands, and who is too near another makes room. So robots keep
    the places that they have among each other, nobody has to pass anybody, and who stands well stays.

    Args:
        goals: world frame, metres.
        poses: of the team.
        radius: from the goal within which all spots are to lie, metres.
        apart: metres from spot to spot, about; robots have room within ``radius`` at that distance.
    """
    goals = goals[..., None, :]
    offsets = poses[..., :2] - goals
    flat = offsets.reshape(-1, *offsets.shape[-2:])
    here = torch.empty_like(flat, memory_format=torch.contiguous_format)
    wp.launch(
        parking_kernels.settle,
        dim=len(flat),
        inputs=[vectors(flat), radius, apart, vectors(here), vectors(torch.empty_like(here))],
        device=wp.device_from_torch(flat.device),
    )
    return goals + here.reshape(offsets.shape)
