"""What is run to reproduce the paper, and the command that repeats each part alone."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from hpp_framework.evaluation.experiment import Experiment
from hpp_framework.evaluation.folder import CONFIG
from hpp_framework.evaluation.predictor_study import PredictorStudy
from hpp_framework.utils.errors import unknown_name
from hpp_framework.utils.run_folder import RunFolder, differ
from hpp_framework.utils.versions import installed_versions

PLAN, EXPERIMENTS = "plan.json", "experiments"
PLANNERS, PREDICTOR, CURVE = "planners", "predictor", "curve"


@dataclass(frozen=True, kw_only=True)
class Curves:
    """Training curves, which the cards of the shipped weights hold: nothing is trained.

    Attributes:
        source: ``"maddpg"``: return by steps and seed; ``"predictors"``: losses by kind and model.
        team: whose weights.
        predictors: registered kinds, if those are asked for.
        weights: extra folders searched for weights.
    """

    source: Literal["maddpg", "predictors"]
    team: str = "fetch,freight"
    predictors: tuple[str, ...] = ()
    weights: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Planned:
    """One experiment of a reproduction.

    Attributes:
        name: of its folder.
        title: what it asks.
        figure: what of the paper it answers, in words; None for what the paper does not ask.
        work: what is run.
    """

    name: str
    title: str
    figure: str | None
    work: Experiment | PredictorStudy | Curves

    @property
    def kind(self) -> str:
        """Return ``"planners"``, ``"predictor"`` or ``"curve"``."""
        return {Experiment: PLANNERS, PredictorStudy: PREDICTOR, Curves: CURVE}[type(self.work)]

    @property
    def cells(self) -> int:
        """Return how many parts its progress counts."""
        if isinstance(self.work, Experiment):
            return len(self.work.worlds) * len(self.work.planners)
        return len(self.work.worlds) if isinstance(self.work, PredictorStudy) else 1

    def folder(self, out: Path) -> Path:
        """Return where its results lie."""
        return out / EXPERIMENTS / self.name

    def command(self) -> str:
        """Return the command that does this alone, in the folder of the reproduction."""
        work = self.work
        if isinstance(work, Experiment) and work.members:  # no option says as much
            words = ["evaluate", "--config", f"{EXPERIMENTS}/{self.name}/{CONFIG}"]
        elif isinstance(work, Experiment):
            words = ["evaluate", *_evaluate_options(work)]
        elif isinstance(work, PredictorStudy):
            words = ["evaluate", "predictor", *_study_options(work)]
        elif work.source == "maddpg":
            words = ["train", "maddpg", "--team", work.team]
        else:  # it draws the losses of all that it asks
            first, *others = work.predictors
            words = ["evaluate", "predictor", first, "--compare", ",".join(others)]
        return shlex.join(["hpp", *words, "--out", f"out/{self.name}"])


def _evaluate_options(work: Experiment) -> list[str]:
    default = Experiment(worlds=work.worlds, planners=work.planners)
    options = [
        "--worlds", ",".join(work.worlds), "--planners", ",".join(work.planners),
        "--episodes", str(work.episodes), "--seed", str(work.seed),
    ]  # fmt: skip
    for name in ("team", "preset", "backend", "task", "skill", "control", "disturbances", "estimator"):
        if getattr(work, name) != getattr(default, name):
            options += [f"--{name}", str(getattr(work, name))]
    if work.weights:
        options += ["--weights", ",".join(work.weights)]
    for name, value in work.settings.items():
        options += ["--set", f"{name}={value}"]
    return options


def _study_options(work: PredictorStudy) -> list[str]:
    first, *others = work.predictors
    options = [
        first, "--team", work.team, "--worlds", ",".join(work.worlds),
        "--trajectories", str(work.trajectories), "--seconds", f"{work.seconds:g}", "--seed", str(work.seed),
    ]  # fmt: skip
    if others:
        options += ["--compare", ",".join(others)]
    if work.weights:
        options += ["--weights", ",".join(work.weights)]
    return [*options, "--disturbances", work.disturbances, "--estimator", work.estimator]


def choose(planned: Sequence[Planned], only: Sequence[str]) -> list[Planned]:
    """Return the experiments of some names, all if none is given.

    Raises:
        UnknownNameError: if there is no experiment of a name.
    """
    known = [each.name for each in planned]
    for name in only:
        if name not in known:
            raise unknown_name("experiment", name, known)
    return [each for each in planned if not only or each.name in only]


def _asked(plan: Mapping[str, Any]) -> dict[str, Any]:
    """Return what of a plan must be the same to resume: titles and wordings need not."""
    listed = plan.get("experiments")
    experiments: Any = listed if isinstance(listed, list) else []
    asked = [(each.get("name"), each.get("arguments")) for each in experiments if isinstance(each, dict)]
    return {"scale": plan.get("scale"), "seed": plan.get("seed"), "experiments": asked}


def _differences(found: Mapping[str, Any], wanted: Mapping[str, Any]) -> str:
    return differ(key for key, value in _asked(wanted).items() if _asked(found)[key] != value)


def write_plan(out: Path, scale: str, seed: int, planned: Sequence[Planned]) -> None:
    """Write ``plan.json``, or check that the folder holds the same reproduction.

    Args:
        out: folder of the reproduction.
        scale: its name.
        seed: of worlds, starts and agents.
        planned: all experiments of the scale.

    Raises:
        ConfigError: if the folder holds another reproduction, is damaged, or cannot be written.
    """
    content = {
        "scale": scale, "seed": seed, "versions": installed_versions(),
        "experiments": [
            {"name": each.name, "title": each.title, "kind": each.kind, "figure": each.figure,
             "folder": f"{EXPERIMENTS}/{each.name}", "command": each.command(),
             "arguments": asdict(each.work)}
            for each in planned
        ],
    }  # fmt: skip
    RunFolder(out).claim(
        PLAN, content, what="reproduction", compare=_differences,
        remedy="Choose another --out, or repeat the same options to resume it.",
    )  # fmt: skip
