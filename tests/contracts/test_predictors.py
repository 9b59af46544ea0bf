"""What every registered predictor promises; and that learned ones refuse what they were not trained for."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import pytest
import torch

from hpp_framework.core.predictor import PredictorRequest, PredictorTraining
from hpp_framework.core.team import Team
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.plugins.weights import load_checkpoint, save_checkpoint
from hpp_framework.prediction import library
from hpp_framework.prediction.collect import Collection, collect
from hpp_framework.utils.errors import CheckpointError

KINDS = sorted(entry.name for entry in hub().predictor_trainers)
PREDICTORS = sorted(entry.name for entry in hub().predictors)
TINY = Collection(trajectories=8, chunk=4, steps=80, worlds=1, seed=4)


@pytest.fixture(scope="module")
def team():
    return parse_team("fetch,freight")


@pytest.fixture(scope="module")
def weights(team, tmp_path_factory):
    """Return a folder with weights of every kind that Fetch needs in this team, hardly trained."""
    folder = tmp_path_factory.mktemp("predictors")
    list(collect(team, TINY, folder / "data"))
    for kind in KINDS:
        for subject in (0, 1):
            config = PredictorTraining(
                data=folder / "data", out=folder / "weights", agent=0, subject=subject, steps=1, batch=4,
                report=lambda _: None,
            )  # fmt: skip
            hub().predictor_trainers.create(kind, config)
    return folder / "weights"


def ask(kind, team, folder):
    return hub().predictors.create(kind, PredictorRequest(team=team, agent=0, folders=(folder,)))


def changed(team, place, **changes):
    """Return the team with another robot or skill at a place."""
    members = list(team.members)
    members[place] = replace(members[place], **changes)
    return Team(tuple(members))


@pytest.mark.parametrize("kind", KINDS)
def test_what_it_was_trained_for_is_taken(kind, team, weights):
    ask(kind, team, weights)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("beams", [40, 111, 223])
def test_another_lidar_is_refused(kind, team, weights, beams):
    robot = team.members[0].robot
    other = replace(robot, lidar=replace(robot.lidar, beams=beams))
    with pytest.raises(CheckpointError, match=rf"was made for beams = 222, but {beams} is needed"):
        ask(kind, changed(team, 0, robot=other), weights)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("history", [1, 4, 7])
def test_another_history_is_refused(kind, team, weights, history, monkeypatch):
    monkeypatch.setattr(library, "HISTORY", history)
    with pytest.raises(CheckpointError, match=rf"was made for history = 5, but {history} is needed"):
        ask(kind, team, weights)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("place", "role"), [(0, "agent"), (1, "subject")])
def test_another_skill_is_refused(kind, team, weights, place, role):
    with pytest.raises(CheckpointError, match=rf"was made for {role}_skill = 'p2p', but 'dwa' is needed"):
        ask(kind, changed(team, place, skill="dwa"), weights)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("place", [0, 1])
def test_there_are_no_weights_for_another_robot(kind, team, weights, place):
    robot = replace(team.members[place].robot, name="rover")
    with pytest.raises(CheckpointError, match=r"no weights '.*rover.safetensors' .* hpp onboard p2p --with"):
        ask(kind, changed(team, place, robot=robot), weights)


@pytest.mark.parametrize("kind", KINDS)
def test_renamed_weights_of_another_robot_are_refused(kind, team, weights, tmp_path):
    shutil.copytree(weights, tmp_path / "w")
    for suffix in ("safetensors", "json"):
        (tmp_path / "w" / kind / f"other-fetch-freight.{suffix}").rename(
            tmp_path / "w" / kind / f"other-fetch-rover.{suffix}"
        )
    robot = replace(team.members[1].robot, name="rover")
    with pytest.raises(CheckpointError, match="was made for subject = 'freight', but 'rover' is needed"):
        ask(kind, changed(team, 1, robot=robot), tmp_path / "w")


@pytest.mark.parametrize("kind", KINDS)
def test_weights_for_itself_do_not_serve_for_others(kind, team, weights, tmp_path):
    (tmp_path / kind).mkdir()
    for name in ("self-fetch", "other-fetch-freight"):
        shutil.copy(weights / kind / "self-fetch.safetensors", tmp_path / kind / f"{name}.safetensors")
    with pytest.raises(CheckpointError, match="was made for role = 'self', but 'other' is needed"):
        ask(kind, team, tmp_path)


@pytest.mark.parametrize("kind", KINDS)
def test_weights_of_another_kind_are_refused(kind, team, weights, tmp_path):
    foreign = KINDS[KINDS.index(kind) - 1]
    shutil.copytree(weights / foreign, tmp_path / kind)
    with pytest.raises(
        CheckpointError, match=f"was made for predictor = '{foreign}', but '{kind}' is needed"
    ):
        ask(kind, team, tmp_path)


@pytest.mark.parametrize("kind", KINDS)
def test_weights_that_do_not_say_what_they_are_for_are_refused(kind, team, weights, tmp_path):
    file = tmp_path / kind / "self-fetch.safetensors"
    file.parent.mkdir()
    save_checkpoint(file, load_checkpoint(weights / kind / file.name, {})[0], {})
    assert "predictor" not in json.loads(file.with_suffix(".json").read_text())
    with pytest.raises(CheckpointError, match=f"was made for predictor = None, but '{kind}' is needed"):
        ask(kind, team, tmp_path)


@pytest.mark.parametrize("name", PREDICTORS)
@torch.no_grad()
def test_rollouts_keep_their_promises(name, team, weights):
    """Shapes, times, goal by goal and episode by episode, and the same answer twice."""
    from hpp_framework.evaluation.predictor_trials import draw_questions

    folders = (weights,) if name in KINDS else ()
    model = hub().predictors.create(name, PredictorRequest(team=team, agent=0, folders=folders))
    asked = draw_questions(
        team, "simple", trajectories=3, seconds=0.2, seed=1, disturbances="ideal", estimator="none"
    )[1]
    seen, goals = asked.observations[0], torch.randn(3, 4, 2, generator=torch.Generator().manual_seed(0))
    out = model.rollout(seen, goals, 3)
    assert out.poses.shape == (3, 4, 3, 2, 3)
    assert (out.times.diff() > 0).all()
    assert torch.isfinite(out.poses[..., :2]).all()
    if out.std is not None:
        assert out.std.shape == out.poses.shape[:-1]
        assert (out.std > 0).all()
    first = out.poses[..., :2].clone()
    again = model.condition(seen, 3)(goals).poses[..., :2]
    assert torch.allclose(first, again, atol=1e-4)
    alone = model.rollout(seen.episodes(slice(1, 2)), goals[1:2, 2:3], 3).poses[..., :2]
    assert torch.allclose(first[1:2, 2:3], alone, atol=1e-3)
