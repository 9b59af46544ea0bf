"""What a reproduction has left in its folder, read for the report; pieces that are missing are None."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from hpp_framework.evaluation import folder
from hpp_framework.evaluation.distances import BANDS
from hpp_framework.evaluation.rows import EpisodeRow
from hpp_framework.evaluation.table import read_rows
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.run_folder import read_json

PLAN, CLAIMS, EXPERIMENTS, REPORT = "plan.json", "claims.json", "experiments", "report"
PLANNERS, PREDICTOR, CURVE = "planners", "predictor", "curve"

Row = Mapping[str, Any]
Curve = Float[np.ndarray, "_"]


@dataclass(frozen=True)
class Band:
    """A curve with a band around it.

    Attributes:
        x: where.
        middle: the curve.
        low: lower edge of the band.
        high: upper edge.
    """

    x: Curve
    middle: Curve
    low: Curve
    high: Curve


@dataclass(frozen=True, kw_only=True)
class Ran:
    """An experiment of the plan and what came of it.

    Attributes:
        name: of its folder.
        title: what it asks.
        kind: ``"planners"``, ``"predictor"`` or ``"curve"``.
        figure: of the paper, in words; empty for none.
        folder: where its files are.
        command: that does it alone.
        summary: its ``summary.json``, None if it has not run to its end.
        config: its ``config.json``, None likewise.
    """

    name: str
    title: str
    kind: str
    figure: str
    folder: Path
    command: str
    summary: Any | None
    config: dict[str, Any] | None

    def rows(self, part: str) -> Sequence[Row]:
        """Return the rows of a part of a summary of planners, none if it has not run."""
        return self.summary.get(part, ()) if isinstance(self.summary, dict) else ()

    @property
    def worlds(self) -> list[str]:
        """Return the worlds in which anything has run, in order."""
        return list(dict.fromkeys(str(row["world"]) for row in self.rows("cells")))

    @property
    def planners(self) -> list[str]:
        """Return the planners that have run, in order."""
        return list(dict.fromkeys(str(row["planner"]) for row in self.rows("cells")))

    def cell(self, world: str, planner: str) -> Row | None:
        """Return what the summary says of one planner in one world."""
        found = (row for row in self.rows("cells") if (row["world"], row["planner"]) == (world, planner))
        return next(found, None)

    def distances(self) -> dict[tuple[str, str], Band]:
        """Return the distance between robots over time by world and planner: mean and quartiles, metres."""
        file = self.folder / BANDS
        if self.summary is None or not file.exists():
            return {}
        with np.load(file, allow_pickle=False) as found:
            kept = {name: found[name] for name in found.files}
        low, high = (int(np.flatnonzero(np.isclose(kept["levels"], level))[0]) for level in (0.25, 0.75))
        return {
            (str(world), str(planner)): Band(
                kept["seconds"], kept["mean"][w, p], kept["quantiles"][w, p, low],
                kept["quantiles"][w, p, high],
            )
            for w, world in enumerate(kept["worlds"])
            for p, planner in enumerate(kept["planners"])
            if kept["episodes"][w, p]
        }  # fmt: skip

    def episodes(self) -> list[EpisodeRow]:
        """Return its episodes, a row each."""
        return read_rows(self.folder / folder.EPISODES, EpisodeRow)

    def figures(self) -> set[int]:
        """Return the numbers of the paper's figures that it belongs to."""
        named = self.figure if self.figure.startswith("figure") else ""
        return {int(each) for each in re.findall(r"\d+", named)}


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """A folder that ``hpp reproduce`` wrote.

    Attributes:
        out: the folder.
        scale: smoke, standard or full.
        seed: of everything.
        versions: of the packages that numbers may depend on.
        experiments: in the order of the plan.
        claims: as judged; empty if they have not been yet.
    """

    out: Path
    scale: str
    seed: int
    versions: Mapping[str, str]
    experiments: tuple[Ran, ...]
    claims: Sequence[Row]

    @property
    def main(self) -> Ran | None:
        """Return the comparison of most planners."""
        compared = [ran for ran in self.experiments if ran.kind == PLANNERS]
        named = [ran for ran in compared if ran.name == "main"]
        return (named or sorted(compared, key=lambda ran: -len(ran.planners)) or [None])[0]


def read_reproduction(out: Path) -> Reproduction:
    """Read what a reproduction has left so far.

    Args:
        out: its folder.

    Raises:
        ConfigError: if there is no plan, or a file is damaged.
    """
    plan = read_json(out / PLAN)
    try:
        return Reproduction(
            out=out, scale=str(plan["scale"]), seed=int(plan["seed"]), versions=dict(plan["versions"]),
            experiments=tuple(_ran(out, each) for each in plan["experiments"]),
            claims=_claims(out / CLAIMS),
        )  # fmt: skip
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(
            f"'{out / PLAN}' is damaged ({error!r}). Repeat `hpp reproduce` with this folder."
        ) from error


def _ran(out: Path, planned: Row) -> Ran:
    name = str(planned["name"])
    place = out / str(planned.get("folder") or f"{EXPERIMENTS}/{name}")
    command: Any = planned.get("command", "")
    config = place / folder.CONFIG
    return Ran(
        name=name, title=str(planned.get("title", name)), kind=str(planned["kind"]),
        figure=str(planned.get("figure") or ""), folder=place,
        command=command if isinstance(command, str) else " ".join(map(str, command)),
        summary=_read(place / folder.SUMMARY), config=read_json(config) if config.exists() else None,
    )  # fmt: skip


def _claims(file: Path) -> Sequence[Row]:
    found = _read(file)
    return [each for each in found if isinstance(each, dict)] if isinstance(found, list) else []


def _read(file: Path) -> Any | None:
    """Return a JSON file, None if it is missing."""
    if not file.exists():
        return None
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"'{file}' is damaged: {error}. Repeat `hpp reproduce` with this folder."
        ) from error
