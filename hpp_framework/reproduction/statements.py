"""The paper's statements that can be checked, in our words, each with the comparisons that decide it."""

from __future__ import annotations

from pathlib import Path

from hpp_framework.reproduction.claims import Claim
from hpp_framework.reproduction.experiments import FREQUENCIES, HORIZONS, KINDS, SAMPLING, SIMULATED
from hpp_framework.reproduction.main_statements import (
    HPP,
    centralised_statements,
    real_room_statements,
    rendezvous_time_statements,
)
from hpp_framework.reproduction.measures import Arm, Measures
from hpp_framework.reproduction.model_measures import ModelMeasures
from hpp_framework.reproduction.statement import ALIKE, FASTER, arms, each, statement


def claims(out: Path) -> list[Claim]:
    """Check every statement by what a reproduction has measured so far.

    Args:
        out: its folder.
    """
    measures, models = Measures(out), ModelMeasures(out)
    return [
        *centralised_statements(measures), *rendezvous_time_statements(measures),
        *real_room_statements(measures), *_planning(measures),
        *_prediction(measures, models), *_training(models), *_beyond(),
    ]  # fmt: skip


def _planning(of: Measures) -> list[Claim]:
    often, *seldom = arms("frequency", FREQUENCIES)
    five, *horizons = arms("horizon", HORIZONS)
    base, *sampled = arms("sampling", SAMPLING)
    accumulated = Arm("accumulated", "hpp")
    return [
        statement(
            "Planning every 5 steps completes the task sooner than every 10 or 15.",
            "appendix C.1, figure 10", FASTER, each(of.better, [often], seldom, SIMULATED), ["frequency"],
        ),
        statement(
            "How often is planned makes more difference in harder worlds.", "section 5.4, appendix C.1",
            "The advantage of every 5 steps over every 15 counts as larger if both intervals are apart:",
            [of.larger(often, seldom[-1], world, "simple") for world in SIMULATED[1:]], ["frequency"],
        ),
        statement(
            "Looking farther ahead makes more difference in harder worlds.", "section 5.4",
            "The advantage of 20 steps over 5 counts as larger if both intervals are apart:",
            [of.larger(horizons[-1], five, world, "simple") for world in SIMULATED[1:]], ["horizon"],
        ),
        statement(
            "The horizon matters less than how often is planned: 5 steps do about as well as others.",
            "appendix C.1, figure 11", ALIKE, each(of.alike, horizons, [five], SIMULATED), ["horizon"],
        ),
        statement(
            "HPP does not depend much on the iterations, samples and elites of CEM.", "appendix C.1", ALIKE,
            each(of.alike, sampled, [base], SIMULATED), ["sampling"],
        ),
        statement(
            "The reward of the end beats the reward accumulated along the path.", "appendix A", FASTER,
            each(of.better, HPP[:1], [accumulated], SIMULATED[1:]), ["main", "accumulated"],
        ),
    ]  # fmt: skip


def _prediction(of: Measures, models: ModelMeasures) -> list[Claim]:
    own, absolute, seen = (Arm("prediction", f"hpp:predictor={kind}") for kind in KINDS)
    lower = "An error counts as smaller if the intervals of both mean errors are apart:"
    worlds, ahead = ("training", *SIMULATED), (0.2, 1.0, 5.0)
    return [
        statement(
            "At the wall delta-pose-lidar performs best of the three motion models.",
            "appendix D.2, figure 9", FASTER,
            each(of.better, [own], [absolute, seen], ["wall"]), ["prediction"],
        ),
        statement(
            "At the wall the other two perform equally well.", "appendix D.2, figure 9", ALIKE,
            each(of.alike, [absolute], [seen], ["wall"]), ["prediction"],
        ),
        statement(
            "Predicting changes of pose, as seen by the predicting robot, makes better models.",
            "section 5.4", lower,
            [
                models.smaller_error((KINDS[0], role), (other, role), world, 1.0)
                for other in KINDS[1:] for role in ("self", "other") for world in worlds
            ],
            ["predictors"],
        ),
        statement(
            "A robot's own motion is easier to predict than another's.", "appendix C.3", lower,
            [
                models.smaller_error((kind, "self"), (kind, "other"), world, seconds)
                for kind in KINDS for world in worlds for seconds in ahead
            ],
            ["predictors"],
        ),
    ]  # fmt: skip


def _training(models: ModelMeasures) -> list[Claim]:
    return [
        statement(
            "The motion models converge.", "appendix C.3, figure 12",
            "A model counts as converged if its loss fell by no more than 2 % over the last tenth:",
            [part for kind in KINDS for part in models.levelled_off(kind)], ["losses"],
        ),
        statement(
            "MADDPG is unstable: some seeds (3 of 10 in the paper) do not converge.",
            "appendix C.2, figure 8",
            "A seed counts as failed if its last success is below half of the best seed's:",
            [models.failed_seeds()], ["maddpg-training"],
        ),
    ]  # fmt: skip


def _beyond() -> list[Claim]:
    return [
        Claim(
            claim="The models transfer to real robots without fine-tuning.", where="section 5.3, appendix E",
            rule="", parts=[], experiments=[],
            remark="No real robot was driven; scans of rooms stand in for it.",
        ),
        Claim(
            claim="Collecting data and training take about 3 hours.", where="appendix C.3", rule="", parts=[],
            experiments=[], remark="Nothing is trained here: the shipped weights are used.",
        ),
    ]  # fmt: skip
