"""The stages of an onboarding: each is skipped where its result is there, and resumes where it stopped."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from hpp_framework.core.predictor import PredictorRequest, PredictorTraining
from hpp_framework.core.skill import SkillTraining
from hpp_framework.evaluation.experiment import Experiment, run_experiment
from hpp_framework.evaluation.folder import SUMMARY
from hpp_framework.evaluation.predictor_study import PredictorStudy
from hpp_framework.evaluation.predictor_study import run_study as run_predictor_study
from hpp_framework.evaluation.skill_study import SkillStudy
from hpp_framework.evaluation.skill_study import run_study as run_skill_study
from hpp_framework.onboarding.config import Onboarding
from hpp_framework.onboarding.scale import RATES
from hpp_framework.plugins.registry import hub
from hpp_framework.plugins.weights import weight_folders
from hpp_framework.prediction.collect import collect
from hpp_framework.prediction.library import find_model, model_pairs
from hpp_framework.training.predictors import train_predictors
from hpp_framework.utils.errors import CheckpointError, ConfigError
from hpp_framework.utils.progress import Progress
from hpp_framework.utils.run_folder import read_json

WEIGHTS = "weights"


@dataclass(frozen=True)
class Stage:
    """One step of an onboarding.

    Attributes:
        title: in a few words.
        seconds: that it takes on two cores, about.
        done: whether its result is there.
        run: does what is missing.
        draws: whether it shows its progress itself.
        unit: that its progress is counted in, in words.
    """

    title: str
    seconds: float
    done: Callable[[], bool]
    run: Callable[[Progress], object]
    draws: bool = False
    unit: str = "episodes"


def make_stages(onboarding: Onboarding, out: Path, *, workers: int) -> list[Stage]:
    """Return what is to be done, in order; call it without the weights of ``out`` in the environment.

    Args:
        onboarding: whose.
        out: folder of everything.
        workers: processes that collect and train side by side.

    Raises:
        ConfigError: if the skill has neither weights for a robot nor a trainer.
    """
    stages = [
        *_skills(onboarding, out, workers),
        *(_collection(onboarding, out, pair, workers) for pair in onboarding.pairs()),
        *_models(onboarding, out, workers),
        *(_skill_study(onboarding, out, robot) for robot in _judged(onboarding)),
    ]
    for pair in onboarding.pairs():
        stages += [_predictor_study(onboarding, out, pair), _meeting(onboarding, out, pair)]
    return stages


def _folder(out: Path, kind: str, *names: str) -> Path:
    """Return the folder of one stage; names of packages are no folders."""
    return out / kind / ",".join(name.replace("/", ".") for name in names)


def _judged(onboarding: Onboarding) -> tuple[str, ...]:
    return onboarding.robots[:1] if onboarding.is_robot else onboarding.robots


def _skills(onboarding: Onboarding, out: Path, workers: int) -> Iterator[Stage]:
    """Give the trainings of robots without weights of the skill; those of a smaller scale do not count."""
    for name in onboarding.robots:
        robot = hub().robots.create(name)
        init = _init(onboarding, name)
        steps = onboarding.scale.further_steps if init else onboarding.scale.skill_steps
        kind = hub().skills.entry(onboarding.skill).name
        had = _steps_of_skill(kind, robot.name) if onboarding.newcomer in (name, onboarding.skill) else None
        try:
            hub().skills.create(onboarding.skill, robot)
        except CheckpointError as error:
            if onboarding.skill not in hub().skill_trainers:
                raise ConfigError(f"{error} Skill '{onboarding.skill}' has no trainer.") from error
        else:
            if had is None or had >= steps:
                continue
        file = out / WEIGHTS / kind / f"{robot.name}.safetensors"
        training = SkillTraining(
            robot=name, out=_folder(out, "skill-training", name), seed=onboarding.seed, steps=steps,
            init=Path(init) if init else None, threads=workers, judge=False,
        )  # fmt: skip
        yield Stage(
            f"train {onboarding.skill} for {name}, {steps:,} steps from {init or 'nothing'}{_instead(had)}",
            steps / RATES.skill_steps + min(2000, steps / 200) / RATES.rooms + RATES.start,
            file.is_file,
            partial(_train_skill, onboarding.skill, training, file),
            draws=True,
        )


def _steps_of_skill(kind: str, robot: str) -> int | None:
    """Return the steps of the last training of the weights that are found for a robot; None if unsaid."""
    for folder in weight_folders(()):
        card = folder / kind / f"{robot}.json"
        if card.is_file():
            stages = read_json(card).get("stages") or [{}]
            return stages[-1].get("steps")
    return None


def _instead(steps: int | None) -> str:
    return "" if steps is None else f" (instead of those found, of {steps:,} steps)"


def _init(onboarding: Onboarding, robot: str) -> str | None:
    """Return the robot whose weights a training starts from: one that sees with as many beams."""
    if onboarding.init != "auto":
        return None if onboarding.init == "none" else onboarding.init
    beams = hub().robots.create(robot).lidar.beams
    for other in (*onboarding.teammates, *(entry.name for entry in hub().robots)):
        spec = hub().robots.create(other)
        if other == robot or spec.lidar.beams != beams:
            continue
        try:
            hub().skills.create(onboarding.skill, spec)
        except CheckpointError:
            continue
        return other
    return None


def _train_skill(skill: str, training: SkillTraining, file: Path, report: Progress) -> None:
    del report
    trained: Path = hub().skill_trainers.create(skill, training)
    file.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(trained.with_suffix(".json"), file.with_suffix(".json"))
    # the weights come last: they say that the stage is done
    shutil.copy(trained, file)


def _collection(onboarding: Onboarding, out: Path, pair: tuple[str, str], workers: int) -> Stage:
    config, folder = onboarding.scale.collection(onboarding.seed), _folder(out, "data", *pair)
    total = config.chunks * config.chunk
    label = f"collect {total:,} trajectories of {' and '.join(pair)}"

    def run(report: Progress) -> None:
        for done in collect(onboarding.team(*pair), config, folder, workers=workers):
            report(label, done, total)

    return Stage(
        label,
        total * config.steps / RATES.trajectory_steps + RATES.start,
        lambda: len(list(folder.glob("chunk-?????"))) >= config.chunks,
        run,
        unit="trajectories",
    )


def _models(onboarding: Onboarding, out: Path, workers: int) -> Iterator[Stage]:
    """Give one stage that trains all models that are missing, side by side."""
    if onboarding.predictor not in hub().predictor_trainers:
        return
    missing: dict[str, PredictorTraining] = {}
    for pair in onboarding.pairs():
        for name, (agent, subject) in model_pairs(onboarding.team(*pair)).items():
            if name not in missing and not _has_model(onboarding, pair, agent, subject):
                missing[name] = PredictorTraining(
                    data=_folder(out, "data", *pair), out=out / WEIGHTS, agent=agent, subject=subject,
                    seed=onboarding.seed, steps=onboarding.scale.predictor_steps,
                    batch=onboarding.scale.batch,
                )  # fmt: skip
    if not missing:
        return
    steps = onboarding.scale.predictor_steps
    folder = out / WEIGHTS / onboarding.predictor

    def run(report: Progress) -> None:
        for progress in train_predictors(onboarding.predictor, list(missing.values()), workers=workers):
            report(progress.model, progress.step, steps)

    side_by_side = -(-len(missing) // workers)
    yield Stage(
        f"train {len(missing)} models, {steps:,} steps each: {', '.join(missing)}",
        side_by_side * steps * onboarding.scale.batch / 500 / RATES.predictor_steps
        + RATES.start * len(missing),
        lambda: all((folder / f"{name}.safetensors").is_file() for name in missing),
        run,
        unit="steps",
    )


def _has_model(onboarding: Onboarding, pair: tuple[str, str], agent: int, subject: int) -> bool:
    """Return whether there is a model; one of a newcomer that a smaller scale trained does not count."""
    request = PredictorRequest(team=onboarding.team(*pair), agent=agent)
    try:
        file = find_model(onboarding.predictor, request, subject)
    except CheckpointError:
        return False
    if onboarding.newcomer not in (onboarding.skill, pair[agent], pair[subject]):
        return True
    card = file.with_suffix(".json")
    steps = read_json(card).get("steps") if card.is_file() else None
    return steps is None or steps >= onboarding.scale.predictor_steps


def _skill_study(onboarding: Onboarding, out: Path, robot: str) -> Stage:
    folder, scale = _folder(out, "skill", robot), onboarding.scale
    study = SkillStudy(
        skills=(onboarding.skill,), robot=robot, worlds=("training",), episodes=scale.navigation_tasks,
        seed=onboarding.seed,
    )  # fmt: skip
    return Stage(
        f"judge {onboarding.skill} of {robot} by {scale.navigation_tasks} navigation tasks",
        scale.navigation_tasks / RATES.navigation_tasks + RATES.start,
        (folder / SUMMARY).is_file,
        lambda report: run_skill_study(study, folder, progress=report),
    )


def _predictor_study(onboarding: Onboarding, out: Path, pair: tuple[str, str]) -> Stage:
    folder, scale = _folder(out, "predictors", *pair), onboarding.scale
    study = PredictorStudy(
        predictors=(onboarding.predictor,), team=",".join(pair), skill=onboarding.skill,
        trajectories=scale.asked, seed=onboarding.seed,
    )  # fmt: skip
    return Stage(
        f"judge what {' and '.join(pair)} foresee, {scale.asked} trajectories",
        scale.asked / RATES.navigation_tasks + RATES.start,
        (folder / SUMMARY).is_file,
        lambda report: run_predictor_study(study, folder, progress=report),
    )


def _meeting(onboarding: Onboarding, out: Path, pair: tuple[str, str]) -> Stage:
    folder, scale = _folder(out, "rendezvous", *pair), onboarding.scale
    experiment = Experiment(
        worlds=scale.worlds, planners=(f"hpp:predictor={onboarding.predictor}",), team=",".join(pair),
        skill=onboarding.skill, episodes=scale.episodes, seed=onboarding.seed,
    )  # fmt: skip
    return Stage(
        f"let {' and '.join(pair)} meet in {' and '.join(scale.worlds)}, {scale.episodes} episodes each",
        scale.episodes * len(scale.worlds) / RATES.episodes + RATES.start,
        (folder / SUMMARY).is_file,
        lambda report: run_experiment(experiment, folder, progress=report),
    )
