"""What may be written into which run folder, and what its config.json is good for."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from hpp_framework.cli.main import main
from hpp_framework.core.planner import Decision, MetaPlanner, certain
from hpp_framework.core.world import World
from hpp_framework.evaluation import showcase as film
from hpp_framework.evaluation.experiment import Experiment, read_experiment, run_experiment
from hpp_framework.evaluation.rollout import EPISODE_STEPS
from hpp_framework.utils.errors import CheckpointError, ConfigError, HppError

TINY = Experiment(worlds=("simple",), planners=("centralized-mp",), episodes=1)
COMMAND = ["evaluate", "--worlds", "simple", "--planners", "centralized-mp", "--episodes", "1", "--out"]

ROOM = "bounds: [-8, -8, 8, 8]\nspawn: {distance: 2.0}\n"
CELL = "bounds: [-1, -1, 1, 1]\n"


def outcome(folder: Path) -> list[dict[str, str]]:
    """Return the rows of a folder without timings."""
    with (folder / "episodes.csv").open() as stream:
        return [{k: v for k, v in row.items() if k != "plan_ms"} for row in csv.DictReader(stream)]


def contents(folder: Path) -> dict[Path, bytes]:
    """Return every file of a folder."""
    return {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@pytest.fixture
def no_film(monkeypatch):
    """Write no video: it takes long and is tested elsewhere."""
    monkeypatch.setattr(film, "write_video", lambda *_: None)


def refused(arguments, capsys) -> str:
    with pytest.raises(SystemExit) as stop:
        main([str(argument) for argument in arguments])
    assert stop.value.code == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    "change",
    [
        {"preset": "bset"},
        {"preset": "bset", "planners": ("hpp",)},
        {"backend": "gazebo"},
        {"task": "rendevous"},
        {"planners": ("centralized-mp", "hp")},
        {"worlds": ("simple", "cell.yaml")},
        {"worlds": ("nowhere.yaml",)},
    ],
    ids=str,
)
@pytest.mark.parametrize("run", [run_experiment, film.showcase])
def test_a_rejected_experiment_leaves_no_folder(run, change, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("cell.yaml").write_text(CELL)
    wrong = replace(TINY, **change)
    if run is film.showcase:
        wrong = replace(wrong, worlds=wrong.worlds[-1:], planners=wrong.planners[-1:])
    with pytest.raises(HppError):
        run(wrong, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_missing_weights_leave_no_folder(tmp_path, register):
    def no_weights(context):
        raise CheckpointError("no weights")

    register("planners", "test-no-weights", no_weights)
    with pytest.raises(CheckpointError):
        run_experiment(replace(TINY, planners=("centralized-mp", "test-no-weights")), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("content", ["{", "[1]", "", "\x00\xff"])
def test_a_damaged_config_is_named(content, tmp_path, capsys):
    (tmp_path / "config.json").write_text(content)
    assert "config.json' is damaged" in refused([*COMMAND, tmp_path], capsys)
    assert "config.json' is damaged" in refused(["evaluate", "--config", tmp_path / "config.json"], capsys)


@pytest.mark.parametrize("content", ["", "a,b\n1,2\n", "\x00", "{header}simple,centralized-mp,0,yes\n"])
def test_damaged_episodes_are_named(content, tmp_path, capsys):
    main([*COMMAND, str(tmp_path)])
    header = (tmp_path / "episodes.csv").read_text().splitlines(keepends=True)[0]
    (tmp_path / "episodes.csv").write_text(content.format(header=header))
    message = refused([*COMMAND, tmp_path], capsys)
    assert "episodes.csv' is damaged" in message
    assert "Move it away" in message


def test_commands_do_not_write_into_each_others_folders(tmp_path, capsys, no_film):
    both = ["--backend", "batch", "--planner", "centralized-mp", "--world", "simple", "--out"]
    main([*COMMAND, str(tmp_path / "a")])
    before = contents(tmp_path / "a")
    assert "`hpp evaluate` wrote" in refused(["run", *both, tmp_path / "a"], capsys)
    assert contents(tmp_path / "a") == before
    main(["run", *both, str(tmp_path / "b")])
    main(["run", *both, str(tmp_path / "b")])  # a film may be made again
    assert "`hpp run` wrote" in refused([*COMMAND, tmp_path / "b"], capsys)


def test_episodes_without_a_config_are_not_resumed(tmp_path, capsys):
    main([*COMMAND, str(tmp_path)])
    (tmp_path / "config.json").unlink()
    assert "no config.json" in refused([*COMMAND, tmp_path], capsys)


def test_an_edited_world_file_is_noticed(tmp_path, capsys):
    room, out = tmp_path / "room.yaml", tmp_path / "out"
    room.write_text(ROOM)
    command = ["evaluate", "--worlds", str(room), *COMMAND[3:], str(out)]
    main(command)
    main(command)
    room.write_text(ROOM + "boxes: [{center: [4, 4], size: [1, 1]}]\n")
    assert "contents of world files differ" in refused(command, capsys)
    repeated = ["evaluate", "--config", out / "config.json", "--out", tmp_path / "again"]
    assert "room.yaml' has changed" in refused(repeated, capsys)


def test_folders_of_older_versions_resume(tmp_path):
    run_experiment(TINY, tmp_path)
    file = tmp_path / "config.json"
    config = json.loads(file.read_text())
    for name in ("command", "world_files", "versions", "planner_configs", "settings"):
        del config[name]
    file.write_text(json.dumps(config))
    run_experiment(TINY, tmp_path)


def test_an_evaluation_is_repeated_from_its_file(tmp_path, capsys):
    options = "--seed 5 --disturbances field:lost_beams=0.05 --team a=fetch,b=freight,c=fetch --preset paper"
    main([*COMMAND, str(tmp_path / "a"), *options.split()])
    main(["evaluate", "--config", str(tmp_path / "a" / "config.json"), "--out", str(tmp_path / "b")])
    assert outcome(tmp_path / "a") == outcome(tmp_path / "b")
    assert (tmp_path / "a" / "config.json").read_text() == (tmp_path / "b" / "config.json").read_text()
    more = ["evaluate", "--config", tmp_path / "a" / "config.json", "--seed", "6", "--estimator", "none"]
    assert "leave out --seed, --estimator" in refused(more, capsys)
    assert "written by `hpp evaluate`" in refused(["run", "--config", tmp_path / "a" / "config.json"], capsys)


def test_a_run_is_repeated_from_its_file(tmp_path, no_film):
    options = "--backend batch --planner centralized-rp --world training --seed 3"
    options += " --disturbances ideal:scan_std=0.02 --out"
    main(["run", *options.split(), str(tmp_path / "a")])
    main(["run", "--config", str(tmp_path / "a" / "config.json"), "--out", str(tmp_path / "b")])
    summaries = [json.loads((tmp_path / name / "summary.json").read_text()) for name in "ab"]
    for summary in summaries:
        del summary["plan_ms_median"]
    assert summaries[0] == summaries[1]
    assert (tmp_path / "a" / "config.json").read_text() == (tmp_path / "b" / "config.json").read_text()


@pytest.mark.parametrize(
    "change",
    [{"seed": "1"}, {"worlds": "wall"}, {"disturbances": {"wind": 1}}, {"team": None}, {"episodes": True}],
)
def test_a_config_that_describes_no_experiment_is_refused(change, tmp_path):
    run_experiment(TINY, tmp_path)
    file = tmp_path / "config.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **change}))
    with pytest.raises(ConfigError, match="describes no experiment"):
        read_experiment(file, "evaluate")


def test_the_config_holds_versions_and_planner_parameters(tmp_path):
    both = replace(TINY, planners=("centralized-mp", "hpp"), disturbances="ideal:scan_std=0.01")
    run_experiment(both, tmp_path)
    config = json.loads((tmp_path / "config.json").read_text())
    assert config["versions"]["torch"] == torch.__version__
    assert config["planner_configs"]["centralized-mp"] == {"plan_every": 10}
    assert config["planner_configs"]["hpp"]["predictor"] == "far-sighted"
    assert read_experiment(tmp_path / "config.json", "evaluate") == both
    config["versions"]["torch"] = "0.1"
    (tmp_path / "config.json").write_text(json.dumps(config))
    run_experiment(both, tmp_path)  # other versions do not forbid resuming


class Centre(MetaPlanner):
    """Sends all robots to the middle of the bounds it was told."""

    def __init__(self, context):
        x_min, y_min, x_max, y_max = context.bounds
        self.goal = torch.tensor([[(x_min + x_max) / 2, (y_min + y_max) / 2]])

    def plan(self, observation, belief, rng):
        goal = self.goal.expand(len(observation.poses), 2)
        return Decision(goal, certain(goal))


def test_planners_are_told_the_bounds_of_their_own_world(tmp_path, register):
    """Rooms 40 m apart in one chunk: a robot told of another episode's room drives off and never meets."""

    def apart(rng):
        x = float(rng.integers(2)) * 40
        return World(name="apart", bounds=(x - 4, -4, x + 4, 4))

    register("worlds", "test-apart", apart)
    register("planners", "test-centre", Centre)
    experiment = Experiment(worlds=("test-apart",), planners=("test-centre",), episodes=4, seed=2)
    (summary,) = run_experiment(experiment, tmp_path)["cells"]
    rows = outcome(tmp_path)
    assert [row["episode"] for row in rows] == ["0", "1", "2", "3"]
    assert summary["first_contact"] == 1.0
    assert all(int(row["steps"]) < EPISODE_STEPS for row in rows)
