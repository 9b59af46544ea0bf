"""Compares predictors on the same fresh trajectories, beside two models that have learnt nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from hpp_framework.config.sensing_choice import make_estimators, parse_disturbances
from hpp_framework.core.predictor import Predictor, PredictorRequest
from hpp_framework.core.team import Team
from hpp_framework.evaluation import folder
from hpp_framework.evaluation.predictor_figures import (
    plot_calibration,
    plot_horizons,
    plot_losses,
    plot_worlds,
)
from hpp_framework.evaluation.predictor_report import report
from hpp_framework.evaluation.predictor_score import (
    ALL,
    ALL_WORLDS,
    CalibrationRow,
    ErrorRow,
    calibration_rows,
    error_rows,
    pool,
)
from hpp_framework.evaluation.predictor_trials import Misses, draw_questions, misses
from hpp_framework.evaluation.table import write_rows
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.builtin import DEFAULT_SKILL, DEFAULT_TEAM, DEFAULT_WORLD, UNDISTURBED
from hpp_framework.plugins.registry import hub
from hpp_framework.prediction.library import find_cards
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.progress import Progress
from hpp_framework.utils.run_folder import write_json, write_text
from hpp_framework.utils.validation import Several, validated
from hpp_framework.worlds.loader import resolve_world

BASELINES = ("constant-velocity", "empty-world")
ERRORS, CALIBRATION = "errors.csv", "calibration.csv"
REPORT = "report.md"
HORIZONS, WORLDS, CALIBRATION_PICTURE, LOSSES = "horizons.png", "worlds.png", "calibration.png", "losses.png"
ROLES = ("self", "other")
TABLE_SECONDS = (1.0, 2.0, 5.0, 10.0)
"""Horizons that ``summary.json`` and the printed table show."""
Cells = dict[tuple[str, str, int, int], Misses]
"""By predictor, world, and the places of agent and subject in the team."""


@validated
class PredictorStudy:
    """What is judged; written into the run folder.

    Attributes:
        predictors: registered predictors; those of :data:`BASELINES` that are missing come last.
        team: as on the command line.
        skill: registered skill of all robots.
        worlds: registered worlds or world files.
        trajectories: a world.
        seconds: ahead, at most.
        weights: extra folders searched for weights.
        disturbances: of sensing and acting: a profile, with settings or without.
        estimator: registered estimator, with settings or without.
        seed: of worlds, starts, goals and disturbances.
        judged: tells the folder from one that compares planners or skills.
    """

    predictors: tuple[str, ...]
    team: str = DEFAULT_TEAM
    skill: str = DEFAULT_SKILL
    worlds: tuple[str, ...] = (DEFAULT_WORLD,)
    trajectories: Several = 200
    seconds: Annotated[
        float, Field(strict=True, ge=0.2, le=60, allow_inf_nan=False, description="It is from 0.2 to 60 s.")
    ] = 12.0
    weights: tuple[str, ...] = ()
    disturbances: str = UNDISTURBED
    estimator: str = "none"
    seed: int = 0
    judged: str = "predictors"

    def __post_init__(self) -> None:
        if not self.predictors or not self.worlds:
            raise ConfigError("name at least one predictor and one world.")

    @property
    def compared(self) -> tuple[str, ...]:
        """Return all predictors, the baselines among them."""
        return (*self.predictors, *(name for name in BASELINES if name not in self.predictors))

    def request(self, team: Team, agent: int) -> PredictorRequest:
        """Return what the factory of an agent's predictor is told."""
        return PredictorRequest(team=team, agent=agent, folders=tuple(Path(w) for w in self.weights))


def run_study(
    study: PredictorStudy, out: Path, *, progress: Progress = lambda *_: None
) -> list[dict[str, Any]]:
    """Ask every predictor of every robot in every world, and write tables and pictures.

    Args:
        study: what is judged.
        out: run folder; created, or written anew if it holds the same study.
        progress: called with (what is under way, steps done, steps in all).

    Returns:
        What ``summary.json`` holds: the mean errors of each predictor, world and role.

    Raises:
        HppError: if the study names something wrong or misses weights (nothing is written then), or ``out``
            holds something else or cannot be written.
    """
    team = parse_team(study.team, skill=study.skill)
    for world in study.worlds:
        resolve_world(world)
    errors = [parse_disturbances(study.disturbances)] * len(team)
    make_estimators(study.estimator, team.robots, errors)
    models = _models(study, team)
    folder.open_evaluation(out, folder.record(folder.EVALUATE, asdict(study), {}))
    cells: Cells = {}
    for world in study.worlds:
        cells |= _ask_all(study, team, models, world, progress)
    errors, calibration = list(_errors(study, team, cells)), list(_calibrations(study, cells))
    write_rows(out / ERRORS, errors, ErrorRow)
    write_rows(out / CALIBRATION, calibration, CalibrationRow)
    summary = _summary(study, errors, calibration)
    write_json(out / folder.SUMMARY, summary)
    write_text(out / REPORT, report(summary, _draw(study, team, out, errors, cells)))
    return summary


def _draw(study: PredictorStudy, team: Team, out: Path, errors: list[ErrorRow], cells: Cells) -> list[str]:
    """Draw what there is to draw; returns the pictures' names."""
    title = f"{study.team}, {study.trajectories} trajectories per world, seed {study.seed}"
    plot_horizons(out / HORIZONS, errors, title=title)
    plot_worlds(out / WORLDS, errors, title=title)
    drawn = [HORIZONS, WORLDS]
    if any(found.std is not None for found in cells.values()):
        plot_calibration(out / CALIBRATION_PICTURE, dict(_pooled(study, cells)), title=title)
        drawn.append(CALIBRATION_PICTURE)
    cards = {name: _cards(study, team, name) for name in study.predictors}
    if plot_losses(out / LOSSES, {name: found for name, found in cards.items() if found}):
        drawn.append(LOSSES)
    return drawn


def _cards(study: PredictorStudy, team: Team, name: str) -> dict[str, dict[str, Any]]:
    """Return the cards of all models of a team, by file name."""
    found: dict[str, dict[str, Any]] = {}
    for agent in range(len(team)):
        found |= find_cards(name, study.request(team, agent))
    return found


def _models(study: PredictorStudy, team: Team) -> dict[str, list[Predictor]]:
    """Return the predictors of all agents, by name."""
    return {
        name: [hub().predictors.create(name, _for(study, name, team, agent)) for agent in range(len(team))]
        for name in study.compared
    }


def _for(study: PredictorStudy, name: str, team: Team, agent: int) -> PredictorRequest:
    request = study.request(team, agent)
    # folders hold weights of some kinds only, and baselines have none
    holding = tuple(each for each in request.folders if (each / name).is_dir())
    return (
        request if name == study.predictors[0] else PredictorRequest(team=team, agent=agent, folders=holding)
    )


def _ask_all(
    study: PredictorStudy, team: Team, models: Mapping[str, list[Predictor]], world: str, progress: Progress
) -> Cells:
    progress(world, 0, len(models) + 1)
    questions = draw_questions(
        team,
        world,
        trajectories=study.trajectories,
        seconds=study.seconds,
        seed=study.seed,
        disturbances=study.disturbances,
        estimator=study.estimator,
    )
    found: Cells = {}
    for done, (name, predictors) in enumerate(models.items()):
        progress(world, done + 1, len(models) + 1)
        for agent, predictor in enumerate(predictors):
            for subject, miss in enumerate(misses(predictor, agent, questions)):
                found[name, world, agent, subject] = miss
    progress(world, len(models) + 1, len(models) + 1)
    return found


def _pooled(study: PredictorStudy, cells: Cells) -> Iterator[tuple[tuple[str, str, str], Misses]]:
    """Give the misses of each predictor, world (and all of them) and role."""
    for name in study.compared:
        for world in (*study.worlds, *((ALL_WORLDS,) if len(study.worlds) > 1 else ())):
            for role in ROLES:
                parts = [
                    miss
                    for (predictor, place, agent, subject), miss in cells.items()
                    if predictor == name
                    and world in (place, ALL_WORLDS)
                    and (agent == subject) == (role == "self")
                ]
                if parts:
                    yield (name, world, role), pool(parts)


def _errors(study: PredictorStudy, team: Team, cells: Cells) -> Iterator[ErrorRow]:
    for (name, world, role), found in _pooled(study, cells):
        yield from error_rows(found, predictor=name, world=world, role=role)
    for (name, world, agent, subject), found in cells.items():
        yield from error_rows(
            found, predictor=name, world=world, role=ROLES[agent != subject], agent=team.ids[agent],
            subject=team.ids[subject],
        )  # fmt: skip


def _calibrations(study: PredictorStudy, cells: Cells) -> Iterator[CalibrationRow]:
    for (name, world, role), found in _pooled(study, cells):
        yield from calibration_rows(found, predictor=name, world=world, role=role)


def _summary(
    study: PredictorStudy, errors: list[ErrorRow], calibration: list[CalibrationRow]
) -> list[dict[str, Any]]:
    """Return what each predictor, world and role comes to."""
    out: dict[tuple[str, str, str], dict[str, Any]] = {}
    for row in errors:
        if row.agent == ALL:
            cell = out.setdefault(
                (row.predictor, row.world, row.role),
                {"predictor": row.predictor, "world": row.world, "role": row.role, "team": study.team,
                 "seed": study.seed, "trajectories": study.trajectories, "errors": []},
            )  # fmt: skip
            if row.seconds in TABLE_SECONDS:
                cell["errors"].append(
                    {k: v for k, v in asdict(row).items() if k.endswith("_m") or k in ("seconds", "count")}
                )
    for row in calibration:
        if row.seconds == 0:
            kept = {k: v for k, v in asdict(row).items() if k.startswith(("coverage", "nll", "std"))}
            out[row.predictor, row.world, row.role]["calibration"] = kept
    return list(out.values())
