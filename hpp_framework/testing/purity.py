"""What every function that the framework calls must keep: shapes, numbers, and no effects on the side."""

from __future__ import annotations

import random
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hpp_framework.testing.report import Report, Rule

SHAPE = Rule(
    name="shape",
    why="all episodes run side by side in one tensor; a wrong shape broadcasts into wrong numbers or "
    "an error.",
    fix="an answer with one row per episode, in the shape named above; keep leading dimensions as they come.",
)
DTYPE = Rule(
    name="dtype",
    why="the framework computes in float32 (and bool); anything else spreads, doubles memory or raises "
    "later.",
    fix="torch operations on the tensors you are given, new ones by x.new_tensor(...) or "
    "torch.zeros_like(x); "
    "numpy's float64 needs .float() on the way back.",
)
NOT_FINITE = Rule(
    name="not-finite",
    why="NaN and infinity spread through plans and commands; the simulators refuse them.",
    fix="guards against dividing by zero, sqrt and acos at the edge, and log of zero: clamp before you "
    "divide.",
)
MUTATES = Rule(
    name="mutates-input",
    why="others hold the same tensors (histories, other agents); all of them see what you change there.",
    fix="out-of-place operations (x = x + 1, not x += 1 or x.add_(1)), or x = x.clone() first.",
)
SHARES = Rule(
    name="shares-memory",
    why="histories are overwritten in place later, and an answer that lies in them changes afterwards.",
    fix=".clone() on what you return if it may be a view of an input.",
)
REUSES = Rule(
    name="reuses-memory",
    why="the caller keeps the answer; the next call overwrites it.",
    fix="a new tensor at each call, not a buffer of the object.",
)
GLOBAL_RNG = Rule(
    name="global-rng",
    why="a run is repeated from one seed; what reads a global generator differs each time, and between "
    "processes.",
    fix="the generator that is passed in: torch.rand(..., generator=rng), rng.uniform(...); else none "
    "at all.",
)
NOT_REPEATABLE = Rule(
    name="not-repeatable",
    why="episodes run side by side and in any order; an object that remembers mixes them up, and no "
    "run repeats.",
    fix="a function of the arguments alone: histories are in the observation, memory of a planner in "
    "its belief.",
)
BATCH = Rule(
    name="batch",
    why="an episode must not depend on which others run beside it, nor on their order.",
    fix="operations along the last dimensions only: no mean, max, sort or normalisation over the "
    "episodes, no [0].",
)
RULES = (SHAPE, DTYPE, NOT_FINITE, MUTATES, SHARES, REUSES, GLOBAL_RNG, NOT_REPEATABLE, BATCH)

SEED = 7


def tensors(value: Any) -> Iterator[Tensor]:
    """Yield every tensor in nested tuples, lists, mappings and dataclasses."""
    if isinstance(value, Tensor):
        yield value
    elif isinstance(value, Mapping):
        yield from tensors(list(value.values()))
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for item in value:
            yield from tensors(item)
    elif is_dataclass(value) and not isinstance(value, type):
        yield from tensors([getattr(value, each.name) for each in fields(value)])


def copies(value: Any) -> list[Tensor]:
    """Return a copy of every tensor in a nested value."""
    return [tensor.clone() for tensor in tensors(value)]


def gap(one: Sequence[Tensor], other: Sequence[Tensor]) -> float:
    """Return the largest difference between two lists of tensors; infinite if they are no match."""
    if [each.shape for each in one] != [each.shape for each in other]:
        return float("inf")
    largest = 0.0
    for a, b in zip(one, other, strict=True):
        a, b = a.detach().double(), b.detach().double()
        both = (a == b) | (a.isnan() & b.isnan())
        apart = (a - b).abs().masked_fill(both, 0.0).nan_to_num(nan=float("inf"))
        largest = max(largest, float(apart.max()) if apart.numel() else 0.0)
    return largest


def check_tensor(
    report: Report,
    of: str,
    value: Any,
    shape: tuple[int, ...],
    meaning: str,
    *,
    dtype: torch.dtype = torch.float32,
    finite: bool = True,
) -> bool:
    """Check shape, type and finiteness of an answer; return whether others may compute with it.

    Args:
        report: of the check.
        of: where the answer comes from.
        value: the answer.
        shape: that it must have.
        meaning: of the shape, e.g. ``"(episodes, [v, omega])"``.
        dtype: that it must have.
        finite: whether it must be finite.
    """
    if not isinstance(value, Tensor):
        report.add(SHAPE, of, f"returned {type(value).__name__}, not a tensor of shape {shape}, {meaning}.")
        return False
    fine = report.require(
        tuple(value.shape) == shape, SHAPE, of, f"has shape {tuple(value.shape)}, not {shape}, {meaning}."
    )
    fine &= report.require(value.dtype == dtype, DTYPE, of, f"has type {value.dtype}, not {dtype}.")
    if finite and value.is_floating_point():
        bad = int((~torch.isfinite(value)).sum())
        fine &= report.require(
            bad == 0, NOT_FINITE, of, f"has {bad} of {value.numel()} numbers that are NaN or infinite."
        )
    return fine


def check_pure(
    report: Report,
    of: str,
    ask: Callable[[], Any],
    inputs: Any,
    between: Callable[[], Any] | None = None,
    *,
    lent: Any = (),
) -> Any:
    """Ask a question, another one, and the first again, and look for effects on the side.

    Args:
        report: of the check.
        of: the function that is asked.
        ask: asks it.
        inputs: whatever it is given, which must stay as it is, and in whose memory no answer may lie.
        between: asks it something else.
        lent: what else it is given, which must stay as it is, but may be given back.

    Returns:
        The first answer, None if asking failed.
    """
    before = copies((inputs, lent))
    answer: Any = None
    failed = len(report.findings)
    with restored_generators():
        states = global_states()
        with report.guarded(of):
            answer = ask()
        if len(report.findings) > failed or answer is None:
            return answer
        drew = drawn_since(states)
        if drew:
            report.add(GLOBAL_RNG, of, f"drew from the global generator of {' and '.join(drew)}.")
        _check_memory(report, of, answer, inputs, gap(before, list(tensors((inputs, lent)))))
        kept = copies(answer)
        if between is not None:
            with report.guarded(of, "asked something else"):
                between()
        _check_kept(report, of, answer, kept)
        _check_again(report, of, ask, kept, drew=bool(drew))
    return answer


def check_rows(
    report: Report, of: str, together: Any, alone: Callable[[int], Any], rows: Sequence[int], tolerance: float
) -> None:
    """Check that episodes get the same answer alone as in a batch.

    Args:
        report: of the check.
        of: the function that is asked.
        together: its answer for all episodes; tensors with the episodes first.
        alone: asks for one episode.
        rows: episodes to ask for alone.
        tolerance: largest difference, in units of the answer.
    """
    for row in rows:
        single: Any = None
        failed = len(report.findings)
        with restored_generators(), report.guarded(of, "for one episode alone"):
            single = alone(row)
        if len(report.findings) > failed:
            return
        expected = [tensor[row : row + 1] for tensor in tensors(together)]
        apart = gap(expected, list(tensors(single)))
        if apart > tolerance:
            report.add(
                BATCH,
                of,
                f"answers episode {row} of a batch otherwise than the same episode alone: by up to "
                f"{apart:.3g}.",
            )
            return


@contextmanager
def restored_generators() -> Generator[None]:
    """Leave the global generators of torch, numpy and random as they were before the context."""
    states = torch.get_rng_state(), np.random.get_state(), random.getstate()  # noqa: NPY002  # it is what we guard
    try:
        yield
    finally:
        torch.set_rng_state(states[0])
        np.random.set_state(states[1])  # noqa: NPY002  # as above
        random.setstate(states[2])


def global_states() -> dict[str, Any]:
    """Return the states of the global generators of torch and numpy."""
    state: Any = np.random.get_state(legacy=False)  # noqa: NPY002  # it is what we guard
    # Python's own is told by the answers: checkers of types draw from it, too
    return {
        "torch": torch.get_rng_state().numpy(),
        "numpy": np.append(state["state"]["key"], state["state"]["pos"]),
    }


def drawn_since(states: dict[str, Any]) -> list[str]:
    """Return the names of the global generators that were drawn from since their states were taken."""
    return [name for name, state in global_states().items() if not np.array_equal(state, states[name])]


def seed_all(seed: int) -> None:
    """Seed the global generators of torch, numpy and random."""
    torch.manual_seed(seed)
    np.random.seed(seed)  # noqa: NPY002  # it is what we guard
    random.seed(seed)


def _check_memory(report: Report, of: str, answer: Any, inputs: Any, changed: float) -> None:
    report.require(changed == 0, MUTATES, of, f"changed what it was given, by up to {changed:.3g}.")
    given = {each.untyped_storage().data_ptr() for each in tensors(inputs) if each.numel()}
    shared = [each for each in tensors(answer) if each.numel() and each.untyped_storage().data_ptr() in given]
    if shared:
        report.add(
            SHARES, of, f"returned a tensor of shape {tuple(shared[0].shape)} that lies in an input's memory."
        )


def _check_kept(report: Report, of: str, answer: Any, kept: list[Tensor]) -> None:
    apart = gap(kept, list(tensors(answer)))
    report.require(
        apart == 0, REUSES, of, f"changed its first answer at the second call, by up to {apart:.3g}."
    )


def _check_again(report: Report, of: str, ask: Callable[[], Any], kept: list[Tensor], *, drew: bool) -> None:
    again: list[list[Tensor]] = []
    for seed in (SEED, SEED + 1):
        seed_all(seed)
        with report.guarded(of, "asked the same again"):
            again.append(copies(ask()))
    if len(again) < 2 or drew:
        return
    apart = max(gap(kept, answer) for answer in again)
    if apart <= 1e-5:
        return
    seed_all(SEED)
    if gap(again[0], copies(ask())) == 0 < gap(again[0], again[1]):
        report.add(GLOBAL_RNG, of, "answers by the seed of Python's global generator, random.")
    else:
        report.add(NOT_REPEATABLE, of, f"answers the same question otherwise later, by up to {apart:.3g}.")
