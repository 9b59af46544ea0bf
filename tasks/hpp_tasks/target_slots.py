"""Targets of a large team around a shared goal, one per robot.

Two robots that drive to one point meet. Of eight, the first stands on it, and the others stop around the
first, too far out. So each robot gets a target of its own.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.utils.kernels import vectors, wp
from hpp_tasks import target_slots_kernels


def target_slots(
    goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"], radius: float, apart: float
) -> Float[Tensor, "*c n 2"]:
    """Return a target around a goal for each robot; the same for whichever robot it is computed.

    Robots are drawn from their poses to the goal, and pushed apart where two are too near each other. So they
    keep their places relative to each other, none has to pass another, and those in place stay.

    Args:
        goals: world frame, metres.
        poses: of the team.
        radius: from the goal within which all targets must lie, metres.
        apart: metres between neighbouring targets, about; robots have room within ``radius`` at that
            distance.
    """
    goals = goals[..., None, :]
    offsets = poses[..., :2] - goals
    flat = offsets.reshape(-1, *offsets.shape[-2:])
    here = torch.empty_like(flat, memory_format=torch.contiguous_format)
    wp.launch(
        target_slots_kernels.spread_out,
        dim=len(flat),
        inputs=[vectors(flat), radius, apart, vectors(here), vectors(torch.empty_like(here))],
        device=wp.device_from_torch(flat.device),
    )
    return goals + here.reshape(offsets.shape)
