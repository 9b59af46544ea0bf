"""Networks whose answer for one row does not depend on how many others there are.

Matrix products round differently for batches of different sizes, so that an episode alone would drift from
the same episode in a batch. In blocks of a fixed size each row is always computed in the same way.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import torch
from torch import Tensor

Answer = TypeVar("Answer", Tensor, tuple[Tensor, ...])


def in_blocks(function: Callable[..., Answer], *inputs: Tensor, rows: int) -> Any:
    """Return what a function answers, asked for a fixed number of rows at a time.

    Args:
        function: row by row, as networks are; answers a tensor or a tuple of tensors.
        inputs: of as many rows each.
        rows: of a block; the last one is filled up with copies of its last row.
    """
    count = len(inputs[0])
    missing = -count % rows
    if missing:
        inputs = tuple(torch.cat([each, each[-1:].expand(missing, *each.shape[1:])]) for each in inputs)
    blocks = zip(*(each.split(rows) for each in inputs), strict=True)
    answers: Any = [function(*block) for block in blocks]
    if isinstance(answers[0], Tensor):
        return torch.cat(answers)[:count]
    return tuple(torch.cat(parts)[:count] for parts in zip(*answers, strict=True))
