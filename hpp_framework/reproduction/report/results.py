"""What a reproduction has left in its folder, read for the report; pieces that are missing are None."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from hpp_framework.evaluation import folder
from hpp_framework.evaluation.distances import BANDS
from hpp_framework.reproduction.judge import CLAIMS
from hpp_framework.reproduction.plan import PLAN, PLANNERS
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.run_folder import read_json

VERDICTS = ("holds", "holds partly", "does not hold", "undecided", "not measured")

Row = Mapping[str, Any]
Curve = Float[np.ndarray, "..."]


class Band(NamedTuple):
    """A curve, and the band around it if it has one."""

    x: Curve
    y: Curve
    low: Curve | None = None
    high: Curve | None = None


@dataclass(frozen=True, kw_only=True)
class Ran:
    """An experiment of the plan and what came of it; name to command are those of ``plan.json``.

    Attributes:
        folder: where its files are.
        summary: its ``summary.json``, None if it has not run to its end.
        config: its ``config.json``, None likewise.
    """

    name: str
    title: str
    kind: str
    figure: str
    command: str
    folder: Path
    summary: Any | None
    config: Mapping[str, Any] | None

    def rows(self, part: str, **where: str) -> list[Row]:
        """Return the rows of a part of a summary of planners in which all of ``where`` is true."""
        found: Sequence[Row] = self.summary.get(part, ()) if isinstance(self.summary, dict) else ()
        return [row for row in found if all(row[key] == value for key, value in where.items())]

    def row(self, part: str, **where: str) -> Row:
        """Return the first of such rows, an empty one if there is none."""
        return next(iter(self.rows(part, **where)), {})

    @property
    def worlds(self) -> list[str]:
        """The worlds in which anything has run, in order."""
        return list(dict.fromkeys(str(row["world"]) for row in self.rows("cells")))

    @property
    def planners(self) -> list[str]:
        """The planners that have run, in order."""
        return list(dict.fromkeys(str(row["planner"]) for row in self.rows("cells")))

    @property
    def strata(self) -> list[str]:
        """What aggregates are of: each world, and all together if there are several."""
        return [*self.worlds, "all"] if len(self.worlds) > 1 else self.worlds

    @property
    def preset(self) -> str:
        """The preset of planners that name none."""
        return str((self.config or {}).get("preset", "best"))

    @property
    def figures(self) -> set[int]:
        """The numbers of the paper's figures that it belongs to."""
        return set(map(int, re.findall(r"\d+", self.figure))) if self.figure.startswith("figure") else set()

    def counts(self, planner: str) -> tuple[int, int]:
        """Return how many episodes succeeded, and how many there were, over all worlds."""
        cells = self.rows("cells", planner=planner)
        met = sum(round(cell["success"] * cell["episodes"]) for cell in cells)
        return met, sum(cell["episodes"] for cell in cells)

    def distances(self) -> dict[tuple[str, str], Band]:
        """Return the distance between robots over time by world and planner: mean and quartiles, metres."""
        file = self.folder / BANDS
        if self.summary is None or not file.exists():
            return {}
        with np.load(file, allow_pickle=False) as found:
            kept = {name: found[name] for name in found.files}
        quartiles = [int(np.flatnonzero(np.isclose(kept["levels"], level))[0]) for level in (0.25, 0.75)]
        return {
            (str(world), str(planner)): Band(
                kept["seconds"], kept["mean"][w, p], *kept["quantiles"][w, p, quartiles]
            )
            for w, world in enumerate(kept["worlds"])
            for p, planner in enumerate(kept["planners"])
            if kept["episodes"][w, p]
        }


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """A folder that ``hpp reproduce`` wrote: what ``plan.json`` says, and the claims if they are judged."""

    scale: str
    seed: int
    versions: Mapping[str, str]
    experiments: Sequence[Ran]
    claims: Sequence[Row]

    @property
    def main(self) -> Ran | None:
        """The comparison of most planners, None if it has not run."""
        compared = [ran for ran in self.experiments if ran.kind == PLANNERS]
        named = [ran for ran in compared if ran.name == "main"]
        found = named or sorted(compared, key=lambda ran: -len(ran.planners))
        return found[0] if found and found[0].rows("cells") else None

    @property
    def tally(self) -> list[tuple[str, int]]:
        """How often each verdict was given, the best first."""
        counts = Counter(str(claim.get("verdict", "")) for claim in self.claims)
        return sorted(counts.items(), key=lambda pair: [*VERDICTS, pair[0]].index(pair[0]))


def read_reproduction(out: Path) -> Reproduction:
    """Read what a reproduction has left so far.

    Raises:
        ConfigError: if there is no plan, or a file is damaged.
    """
    plan, claims = read_json(out / PLAN), _read(out / CLAIMS) or []
    try:
        return Reproduction(
            scale=plan["scale"], seed=plan["seed"], versions=plan["versions"], claims=claims,
            experiments=[_ran(each, out / each["folder"]) for each in plan["experiments"]],
        )  # fmt: skip
    except (KeyError, TypeError) as error:
        raise ConfigError(
            f"'{out / PLAN}' is damaged ({error!r}). Repeat `hpp reproduce` with this folder."
        ) from error


def _ran(planned: Row, place: Path) -> Ran:
    return Ran(
        name=planned["name"], title=planned["title"], kind=planned["kind"], command=planned["command"],
        figure=planned["figure"] or "", folder=place, summary=_read(place / folder.SUMMARY),
        config=_read(place / folder.CONFIG),
    )  # fmt: skip


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
