"""Judging predictors: what they are asked, errors, calibration, and ``hpp evaluate predictor``."""

from __future__ import annotations

import json
import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hpp_framework.cli.main import main
from hpp_framework.core.predictor import Predictor
from hpp_framework.core.types import Trajectories
from hpp_framework.evaluation.predictor_score import (
    ALL,
    CalibrationRow,
    ErrorRow,
    calibration_rows,
    coverage,
    error_rows,
    pool,
)
from hpp_framework.evaluation.predictor_study import BASELINES, CALIBRATION_PICTURE
from hpp_framework.evaluation.predictor_trials import MOMENTS, Misses, draw_questions, misses
from hpp_framework.evaluation.table import read_rows
from hpp_framework.plugins.build import parse_team
from hpp_framework.utils.errors import ConfigError

PERIOD = 0.2


class Oracle(Predictor):
    """Knows the future of the questions; is a known distance beside it, and knows how far."""

    def __init__(self, questions, *, steps=(5, 10, 15), beside=0.0, std=None, longest=None):
        self.questions = questions
        self.steps = torch.tensor(steps)
        self.beside = beside
        self.std = std
        self.longest = longest or len(steps)

    def rollout(self, observation, goals, horizon):
        if horizon > self.longest:
            raise ConfigError("too far")
        poses = observation.poses
        count = len(poses)
        future = next(
            q.future[:count]
            for q in self.questions
            if torch.equal(q.observations[observation.agent].poses[:count], poses)
        )
        steps = self.steps[:horizon]
        xy = future[:, (steps - 1).clamp(max=future.shape[1] - 1)] + torch.tensor([self.beside, 0.0])
        out = torch.cat([xy, torch.full_like(xy[..., :1], math.nan)], -1)[:, None]
        std = None if self.std is None else torch.full(out.shape[:-1], self.std)
        return Trajectories(out, steps * PERIOD, std)


@pytest.fixture(scope="module")
def questions():
    team = parse_team("fetch,freight", skill="pure-pursuit")
    return draw_questions(
        team, "simple", trajectories=6, seconds=3.0, seed=5001, disturbances="ideal", estimator="none"
    )


def test_questions_are_moments_of_trajectories_and_what_followed(questions):
    assert len(questions) == len(MOMENTS)
    early, late = questions[0], questions[1]
    assert early.future.shape == (6, 15, 2, 2)
    # MOMENTS[1] is as many steps after MOMENTS[0] as the future is long
    assert torch.allclose(early.future[:, MOMENTS[1] - 1], late.observations[0].team_poses[..., :2])
    assert torch.equal(early.goals, late.goals)
    assert (early.observations[0].velocity == 0).all()
    assert (late.observations[0].velocity != 0).any()
    assert (late.observations[1].velocity != late.observations[0].velocity).any()


def test_questions_depend_on_the_seed_only(questions):
    team = parse_team("fetch,freight", skill="pure-pursuit")
    again, other = (
        draw_questions(
            team, "simple", trajectories=6, seconds=3.0, seed=seed, disturbances="ideal", estimator="none"
        )
        for seed in (5001, 5002)
    )
    assert torch.equal(again[1].future, questions[1].future)
    assert not torch.equal(other[1].future, questions[1].future)


def test_who_knows_the_future_is_never_off(questions):
    for found in misses(Oracle(questions), 1, questions):
        assert found.times.tolist() == pytest.approx([1, 2, 3])
        assert found.distance.shape == (18, 3)
        assert found.distance.max() == 0
        assert found.std is None


def test_errors_are_distances(questions):
    found = misses(Oracle(questions, beside=0.25, std=0.1), 0, questions)[1]
    assert torch.allclose(found.distance, torch.tensor(0.25), atol=1e-6)
    assert found.std is not None
    assert (found.std == 0.1).all()


def test_a_predictor_is_asked_as_far_as_it_looks_and_the_truth_is_known(questions):
    near = Oracle(questions, longest=2)
    assert misses(near, 0, questions)[0].times.tolist() == pytest.approx([1, 2])
    # steps that grow: only the first two lie within the three seconds
    growing = Oracle(questions, steps=(5, 10, 40))
    assert misses(growing, 0, questions)[0].times.tolist() == pytest.approx([1, 2])


def test_a_predictor_that_only_looks_farther_is_refused(questions):
    with pytest.raises(ConfigError, match="first step is 4 s long; ask for more --seconds"):
        misses(Oracle(questions, steps=(20,)), 0, questions)


def gaussian(std, claimed, *, count=4000, seed=0):
    generator = torch.Generator().manual_seed(seed)
    distance = (std * torch.randn(count, 2, 2, generator=generator)).norm(dim=-1)
    return Misses(
        torch.tensor([1.0, 2.0]), distance, torch.full((count, 2), claimed), torch.arange(float(count))
    )


@pytest.mark.parametrize("level", [0.5, 0.8, 0.9, 0.95])
def test_a_gaussian_that_knows_its_deviation_is_calibrated(level):
    assert coverage(gaussian(0.3, 0.3), level) == pytest.approx([level, level], abs=0.02)


@given(std=st.floats(0.05, 2.0), factor=st.floats(0.3, 3.0))
def test_who_claims_too_much_is_covered_too_rarely_and_the_best_deviation_is_the_likeliest(std, factor):
    rows = calibration_rows(gaussian(std, std * factor), predictor="p", world="w", role="self")
    every = rows[0]
    assert [row.seconds for row in rows] == [0, 1, 2]
    expected = 1 - (1 - 0.9) ** (factor**2)
    assert every.coverage_90 == pytest.approx(expected, abs=0.03)
    assert every.nll >= every.nll_constant - 1e-4
    assert every.nll_constant == pytest.approx(math.log(2 * math.pi * std**2) + 1, abs=0.06)


def test_there_is_no_calibration_without_deviations():
    found = gaussian(0.3, 0.3)
    silent = Misses(found.times, found.distance, None, found.trajectory)
    assert calibration_rows(silent, predictor="p", world="w", role="self") == []
    with pytest.raises(ValueError, match="no coverage"):
        coverage(silent, 0.5)


def test_rows_of_errors_and_their_intervals():
    found = gaussian(1.0, 1.0)
    first = error_rows(found, predictor="p", world="w", role="self")[0]
    assert (first.agent, first.subject, first.count) == (ALL, ALL, 4000)
    assert first.mean_low_m < math.sqrt(math.pi / 2) < first.mean_high_m
    assert first.median_m == pytest.approx(math.sqrt(2 * math.log(2)), abs=0.05)
    assert first.p90_m == pytest.approx(math.sqrt(2 * math.log(10)), abs=0.07)
    # the same predictions three times over, of the same trajectories, say no more than once
    again = Misses(found.times, found.distance.repeat(3, 1), None, found.trajectory.repeat(3))
    repeated = error_rows(again, predictor="p", world="w", role="self")[0]
    assert repeated.mean_low_m == pytest.approx(first.mean_low_m, abs=1e-4)


def test_trajectories_of_different_cells_stay_apart():
    one, two = gaussian(1.0, 1.0, count=5), gaussian(1.0, 1.0, count=7, seed=1)
    both = pool([one, two, one])
    assert len(both.trajectory.unique()) == 17
    assert both.distance.shape == (17, 2)
    assert both.std is not None
    assert pool([one, Misses(two.times, two.distance, None, two.trajectory)]).std is None


COMMAND = "evaluate predictor constant-velocity --skill pure-pursuit --seconds 2 --trajectories 4 --seed 5001"


def test_the_command_writes_tables_and_pictures(tmp_path, capsys):
    main([*COMMAND.split(), "--worlds", "simple,wall", "--out", str(tmp_path)])
    shown = capsys.readouterr().out
    assert "empty-world" in shown
    rows = read_rows(tmp_path / "errors.csv", ErrorRow)
    assert {row.predictor for row in rows} == set(BASELINES)
    assert {row.world for row in rows} == {"simple", "wall", "all worlds"}
    assert {(row.agent, row.subject) for row in rows if row.role == "other"} == {
        ("fetch", "freight"), ("freight", "fetch"), (ALL, ALL),
    }  # fmt: skip
    assert max(row.seconds for row in rows) == 2.0
    assert read_rows(tmp_path / "calibration.csv", CalibrationRow) == []
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert len(summary) == len(BASELINES) * 3 * 2
    assert [each["seconds"] for each in summary[0]["errors"]] == [1.0, 2.0]
    assert sorted(p.name for p in tmp_path.glob("*.png")) == ["horizons.png", "worlds.png"]
    text = (tmp_path / "report.md").read_text()
    assert "![horizons](horizons.png)" in text
    assert "| self | `empty-world` |" in text
    before = (tmp_path / "errors.csv").read_bytes()
    main([*COMMAND.split(), "--worlds", "simple,wall", "--out", str(tmp_path)])
    assert (tmp_path / "errors.csv").read_bytes() == before


def test_a_predictor_that_knows_its_deviation_gets_a_calibration(tmp_path, register, capsys):
    class Unsure(Predictor):
        def rollout(self, observation, goals, horizon):
            poses = observation.team_poses[:, None, None].expand(-1, goals.shape[1], horizon, -1, -1)
            times = torch.arange(1, horizon + 1) * 1.0
            return Trajectories(poses, times, torch.ones(poses.shape[:-1]))

    register("predictors", "unsure", lambda request: Unsure())
    main([*COMMAND.replace("constant-velocity", "unsure").split(), "--out", str(tmp_path)])
    assert "share of true positions" in capsys.readouterr().out
    rows = read_rows(tmp_path / "calibration.csv", CalibrationRow)
    assert {row.predictor for row in rows} == {"unsure"}
    assert (tmp_path / CALIBRATION_PICTURE).stat().st_size > 10_000


def test_one_robot_alone_predicts_itself(tmp_path):
    main([*COMMAND.split(), "--team", "fetch", "--out", str(tmp_path)])
    assert {row.role for row in read_rows(tmp_path / "errors.csv", ErrorRow)} == {"self"}


# (arguments, what the message must contain)
MISTAKES = [
    ("evaluate predictor delta-pose-lida", ["'delta-pose-lidar'"]),
    ("evaluate predictor constant-velocity --worlds trainin", ["'training'"]),
    ("evaluate predictor constant-velocity --compare constant-velocity", ["'constant-velocity' twice"]),
    ("evaluate predictor constant-velocity --trajectories 1", ["'trajectories' must be at least 2"]),
    (
        "evaluate predictor constant-velocity --seconds 0.1",
        ["'seconds' must be at least 0.2", "from 0.2 to 60 s"],
    ),
    ("evaluate predictor constant-velocity --disturbances ideal:position_std=-1", ["position_std"]),
    ("evaluate predictor delta-pose-lidar --skill dwa", ["agent_skill", "'dwa'"]),
    ("evaluate predictor delta-pose-lidar --weights nowhere", ["--weights 'nowhere'"]),
    ("evaluate --episodes 3 predictor constant-velocity", ["come after", "--episodes"]),
]


@pytest.mark.parametrize(("command", "expected"), MISTAKES, ids=[m[0] for m in MISTAKES])
def test_a_mistake_gets_a_clear_message(command, expected, refused):
    refused(command, expected)
