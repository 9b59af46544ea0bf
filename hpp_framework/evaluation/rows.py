"""Results of single episodes and the table ``episodes.csv`` that keeps them."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import torch

from hpp_framework.errors import ConfigError
from hpp_framework.evaluation.rollout import Episodes, median_ms
from hpp_framework.files import replacing
from hpp_framework.sim.simulator import CONTROL_PERIOD


@dataclass(frozen=True, kw_only=True)
class EpisodeRow:
    """One line of ``episodes.csv``; times are NaN where the event never came."""

    world: str
    planner: str
    episode: int
    success: int
    time_s: float
    first_contact: int
    first_contact_s: float
    collided: int
    final_distance_m: float
    steps: int
    plan_ms: float


COLUMNS = [field.name for field in fields(EpisodeRow)]


def to_rows(world: str, planner: str, numbers: Sequence[int], episodes: Episodes) -> list[EpisodeRow]:
    """Return one row an episode.

    Args:
        world: as the user named it.
        planner: registered meta-planner.
        numbers: of the episodes, in the order of the batch.
        episodes: what happened in them.
    """
    last = episodes.last_step()
    final = episodes.spread()[torch.arange(len(last)), last]
    plan_ms = median_ms(episodes.plan_seconds)
    done, contact = episodes.done_step.tolist(), episodes.contact_step.tolist()

    def seconds(step: int) -> float:
        return round(step * CONTROL_PERIOD, 3) if step >= 0 else math.nan

    return [
        EpisodeRow(
            world=world, planner=planner, episode=number,
            success=int(done[i] >= 0), time_s=seconds(done[i]),
            first_contact=int(contact[i] >= 0), first_contact_s=seconds(contact[i]),
            collided=int(episodes.collided[i]), final_distance_m=round(float(final[i]), 4),
            steps=int(last[i]), plan_ms=round(plan_ms, 4),
        )
        for i, number in enumerate(numbers)
    ]  # fmt: skip


def read_rows(file: Path) -> list[EpisodeRow]:
    """Return the rows of a table, none if there is no such file.

    Raises:
        ConfigError: if the file cannot be read or is damaged.
    """
    if not file.exists():
        return []
    types: dict[str, Any] = {
        f.name: {"str": str, "int": int, "float": float}[str(f.type)] for f in fields(EpisodeRow)
    }
    remedy = "Move it away to start over."
    try:
        with file.open(newline="", encoding="utf-8") as stream:
            table = csv.DictReader(stream)
            if table.fieldnames != COLUMNS:
                raise ConfigError(f"'{file}' is damaged, its columns are not {', '.join(COLUMNS)}. {remedy}")
            return [EpisodeRow(**{k: types[k](v) for k, v in row.items()}) for row in table]
    except OSError as error:
        raise ConfigError(f"cannot read '{file}': {error.strerror}. Choose another --out.") from error
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise ConfigError(f"'{file}' is damaged ({error!r}). {remedy}") from error


def write_rows(file: Path, rows: Sequence[EpisodeRow]) -> None:
    """Write all rows, completely or not at all: an interruption loses at most one chunk.

    Raises:
        ConfigError: if the file cannot be written.
    """
    try:
        with replacing(file) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, COLUMNS)
            writer.writeheader()
            writer.writerows(asdict(row) for row in rows)
    except OSError as error:
        raise ConfigError(
            f"cannot write '{file}': {error.strerror}. Finished episodes are kept; resume later."
        ) from error
