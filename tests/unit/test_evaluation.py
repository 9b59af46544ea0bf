"""Episodes, experiments and their statistics."""

from __future__ import annotations

import copy
import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from rich.console import Console

from hpp_framework.agents.build import AgentConfig, build_agents
from hpp_framework.cli.evaluate_tables import aggregate_table, summary_table
from hpp_framework.evaluation.experiment import Experiment, draw_episode, run_experiment
from hpp_framework.evaluation.rows import EpisodeRow, to_rows
from hpp_framework.evaluation.summary import Results, summarise
from hpp_framework.evaluation.table import read_rows
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import EpisodeRng, child_seed
from hpp_framework.worlds.loader import resolve_world

SMALL = Experiment(
    worlds=("simple", "wall"), planners=("centralized-mp", "centralized-rp"), episodes=3, seed=7,
    control="stop-on-success,safety-filter", disturbances="ideal", estimator="none",
)  # fmt: skip

COLUMNS = {
    "world", "planner", "preset", "team", "backend", "episodes", "seed", "success", "success_low",
    "success_high", "first_contact", "time_median_s", "bound_median_s", "time_over_bound_median", "rpl",
    "price_median", "collision_episodes", "obstacle_episodes", "robot_episodes", "person_episodes", "people",
    "final_distance_mean_m", "goal_gap_median_m", "agreed", "control", "estimator", "disturbances",
    "agreement_median_s", "side_flips_mean", "chase_mean", "plan_ms_median",
}  # fmt: skip


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The folder and the summary of the small experiment."""
    folder = tmp_path_factory.mktemp("small")
    return folder, run_experiment(SMALL, folder)


def test_experiment_resumes_and_ends_with_the_same_results(small, tmp_path):
    folder, summary = small
    summary = copy.deepcopy(summary)
    assert [set(row) for row in summary["cells"]] == [COLUMNS] * 4
    assert [row["world"] for row in summary["aggregates"]] == [
        w for w in ("simple", "wall", "all") for _ in "ab"
    ]
    assert [row["world"] for row in summary["comparisons"]] == ["simple", "wall", "all"]
    assert summary["blame"] == []
    rows = list(csv.DictReader((folder / "episodes.csv").open()))
    assert len(rows) == 12
    # cut off after one cell
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "config.json").write_text((folder / "config.json").read_text())
    with (tmp_path / "b" / "episodes.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows[:3])
    again = run_experiment(SMALL, tmp_path / "b")
    for cell in (*again["cells"], *summary["cells"]):
        assert cell.pop("plan_ms_median") is not None
    assert again == summary
    rows = list(csv.DictReader((tmp_path / "b" / "episodes.csv").open()))
    assert all(float(row["bound_s"]) <= float(row["time_s"]) for row in rows if row["success"] == "1")


def test_distances_over_time_are_kept_and_summed_up(small):
    folder, _ = small
    bands = np.load(folder / "distance.npz", allow_pickle=False)
    assert bands["worlds"].tolist() == list(SMALL.worlds)
    assert bands["planners"].tolist() == list(SMALL.planners)
    assert bands["seconds"][[0, 1, -1]].tolist() == [0.0, 0.2, 20.0]
    assert bands["mean"].shape == (2, 2, 101)
    assert bands["mean"][..., 0] == pytest.approx(5.0, abs=1e-4)  # starts
    with (folder / "episodes.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    for w, world in enumerate(SMALL.worlds):
        for p, planner in enumerate(SMALL.planners):
            final = [
                float(r["final_distance_m"]) for r in rows if (r["world"], r["planner"]) == (world, planner)
            ]
            curves = np.load(folder / "distances" / f"{w:02d}-{p:02d}-00000.npy", allow_pickle=False)
            assert curves[:, -1] == pytest.approx(final, abs=1e-4)
            assert bands["mean"][w, p] == pytest.approx(curves.mean(0))
            assert bands["quantiles"][w, p, 2] == pytest.approx(np.median(curves, 0))
    assert (bands["episodes"] == 3).all()


def test_the_summary_is_written(small):
    folder, summary = small
    assert json.loads((folder / "summary.json").read_text()) == summary


def test_results_are_written_for_marl_eval(small):
    """Environment, task, algorithm, run: as many runs everywhere, each with a step and absolute metrics."""
    folder, summary = small
    layout = json.loads((folder / "marl_eval.json").read_text())
    assert list(layout) == ["rendezvous"]
    assert list(layout["rendezvous"]) == ["simple", "wall"]
    for cell in summary["cells"]:
        runs = layout["rendezvous"][cell["world"]][cell["planner"]]
        assert list(runs) == ["episode_0", "episode_1", "episode_2"]
        for run in runs.values():
            assert run["step_1"] == {"step_count": 0, **run["absolute_metrics"]}
        for metric in ("success", "rpl"):
            values = [run["absolute_metrics"][metric] for run in runs.values()]
            assert np.mean(values) == pytest.approx(cell[metric], abs=1e-4)


def test_without_a_bound_nothing_is_said_of_rpl_not_even_of_failures(play):
    team = parse_team("fetch,freight")
    task = hub().tasks.create("rendezvous", team.robots)
    world, start = draw_episode(SMALL, "simple", resolve_world("simple"), 0)
    # one step is too short to meet
    episodes = play(team, task, [world], torch.from_numpy(start).float()[None], steps=1)
    rows = [
        *to_rows("simple", "centralized-mp", [0], episodes, np.array([np.nan])),
        *to_rows("wall", "centralized-mp", [0], episodes, np.array([4.0])),
    ]
    assert [row.success for row in rows] == [0, 0]
    assert np.isnan(rows[0].rpl)
    assert rows[1].rpl == 0.0
    summary = summarise(
        Results(worlds=("simple", "wall"), planners=("centralized-mp",), rows=rows, about={}, preset="best")
    )
    assert [cell["rpl"] for cell in summary["cells"]] == [None, 0.0]
    console = Console(width=200, file=io.StringIO())
    console.print(summary_table(summary["cells"]), aggregate_table(summary["aggregates"]))
    shown = console.file.getvalue()
    assert "None" not in shown
    assert "nan" not in shown


def test_episodes_are_paired_across_planners():
    factory = resolve_world("training")
    first, start = draw_episode(SMALL, "training", factory, 1)
    second, again = draw_episode(SMALL, "training", factory, 1)
    other, elsewhere = draw_episode(SMALL, "training", factory, 2)
    assert first == second
    assert np.array_equal(start, again)
    assert first != other
    assert not np.array_equal(start, elsewhere)
    assert np.linalg.norm(start[0, :2] - start[1, :2]) == pytest.approx(5.0)


def test_people_belong_to_the_episode_and_old_tables_know_none(tmp_path):
    factory = resolve_world("navigation")
    with_people = replace(SMALL, people=3)
    world, start = draw_episode(with_people, "navigation", factory, 1)
    bare, same_start = draw_episode(SMALL, "navigation", factory, 1)
    other, _ = draw_episode(with_people, "navigation", factory, 2)
    again, _ = draw_episode(replace(with_people, backend="sapien"), "navigation", factory, 1)
    assert len(world.people) == 3
    assert world == again != other
    assert world.at_rest() == bare
    np.testing.assert_array_equal(start, same_start)
    one = replace(with_people, worlds=("crowd:people=2",), planners=("centralized-mp",), episodes=2)
    summary = run_experiment(one, tmp_path)
    assert summary["cells"][0]["people"] == 3
    file = tmp_path / "episodes.csv"
    kept = file.read_text()
    assert kept.splitlines()[0].endswith(",touched_person")
    file.write_text("".join(line.rpartition(",")[0] + "\n" for line in kept.splitlines()))
    assert [row.touched_person for row in read_rows(file, EpisodeRow)] == [0, 0]
    file.write_text("".join(",".join(line.split(",")[:-2]) + "\n" for line in kept.splitlines()))
    with pytest.raises(ConfigError, match="columns"):
        read_rows(file, EpisodeRow)
    with pytest.raises(ConfigError, match="people must be"):
        replace(SMALL, people=-1)


def test_one_agent_alone_and_three_together(play):
    """Team size is not built in anywhere."""
    for text in ("fetch", "fetch,freight,fetch"):
        team = parse_team(text)
        task = hub().tasks.create("rendezvous", team.robots)
        world, start = draw_episode(
            Experiment(worlds=("simple",), planners=("centralized-mp",), team=text),
            "simple",
            resolve_world("simple"),
            0,
        )
        episodes = play(team, task, [world], torch.from_numpy(start).float()[None], steps=10)
        assert episodes.poses.shape[2] == len(team)


def test_success_needs_rest():
    """Rushing past each other is contact, not success."""
    team = parse_team("fetch,freight")
    task = hub().tasks.create("rendezvous", team.robots)
    poses = torch.tensor([[[0.0, 0.0, 0.0], [0.8, 0.0, 0.0]]])
    assert bool(task.success(poses)[0])
    assert not bool(task.success(poses, torch.tensor([[[0.5, 0.0], [0.0, 0.0]]]))[0])
    assert bool(task.success(poses, torch.tensor([[[0.5, 0.0], [0.5, 0.0]]]))[0])


def test_timing_plans_from_beliefs_and_leaves_agents_alone(play):
    """What a plan costs includes what a belief adds to it; agents start their episode as if never timed."""
    team = parse_team("fetch,freight")
    task = hub().tasks.create("rendezvous", team.robots)
    agents = build_agents(team, task, AgentConfig(planner="centralized-rp"), (-10, -10, 10, 10))
    world, start = draw_episode(SMALL, "simple", resolve_world("simple"), 0)
    calls: list[tuple[bool, EpisodeRng]] = []
    plan = agents[0].planner.plan

    def watched(observation, belief, rng):
        calls.append((belief is None, rng))
        return plan(observation, belief, rng)

    agents[0].planner.plan = watched
    episodes = play(team, task, [world], torch.from_numpy(start).float()[None], agents, steps=1)
    timed = [first for first, rng in calls if rng is not agents[0].rng]
    assert timed == [True] + [False] * (len(episodes.plan_seconds) // 2)
    assert [first for first, rng in calls if rng is agents[0].rng] == [True]
    untouched = EpisodeRng([child_seed(0, "agents")])
    untouched.uniform(2)  # the point that the one plan drew
    assert torch.equal(agents[0].rng.uniform(), untouched.uniform())
