"""The report of a reproduction: one page that needs nothing but itself, whatever is missing."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import asdict
from html import unescape
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from hpp_framework.evaluation import distances
from hpp_framework.evaluation.experiment import Experiment
from hpp_framework.evaluation.predictor_score import ErrorRow
from hpp_framework.evaluation.rows import EpisodeRow
from hpp_framework.evaluation.summary import Results, summarise
from hpp_framework.evaluation.table import write_rows
from hpp_framework.reproduction.report import write_report
from hpp_framework.reproduction.report.charts import HEIGHT, LEADING, Chart, Line
from hpp_framework.reproduction.report.films import ranked
from hpp_framework.reproduction.report.names import colors
from hpp_framework.reproduction.report.results import Band
from hpp_framework.utils.errors import ConfigError

WORLDS, PLANNERS, EPISODES = ("wall", "navigation"), ("hpp", "hpp:preset=paper", "centralized-mp"), 4
EVIL = "<script>alert('x')</script> & more"
VOID = {"meta", "link", "img", "input", "br", "source"}


def episode(world, planner, number, time_s):
    met = time_s is not None
    return EpisodeRow(
        world=world, planner=planner, episode=number, success=int(met), time_s=time_s if met else np.nan,
        first_contact=int(met), first_contact_s=time_s if met else np.nan, collided=0, touched_obstacle=0,
        touched_robot=0, final_distance_m=1.0 if met else 4.0 + number, steps=100, plan_ms=1.0, bound_s=4.0,
        rpl=4.0 / time_s if met else 0.0, goal_gap_m=0.1, agreement_s=1.0, side_flips=0, chase=0.0,
    )  # fmt: skip


def write_comparison(place: Path, worlds=WORLDS, planners=PLANNERS) -> None:
    rows = [
        episode(world, planner, number, None if planner == "centralized-mp" and number else 6.0 + number)
        for world in worlds
        for planner in planners
        for number in range(EPISODES)
    ]
    about = {"team": "fetch,freight", "backend": "batch", "seed": 0}
    place.mkdir(parents=True)
    summary = summarise(Results(worlds=worlds, planners=planners, rows=rows, about=about, preset="best"))
    (place / "summary.json").write_text(json.dumps(summary))
    config = asdict(Experiment(worlds=worlds, planners=planners, episodes=EPISODES))
    (place / "config.json").write_text(json.dumps({**config, "command": "evaluate", "world_files": {}}))
    write_rows(place / "episodes.csv", rows, EpisodeRow)
    falling = np.linspace(5, 1, 101)[None].repeat(EPISODES, 0) * np.linspace(0.8, 1.2, EPISODES)[:, None]
    for world in range(len(worlds)):
        for planner in range(len(planners)):
            distances.write_curves(distances.curve_file(place, world, planner, 0), falling)
    distances.write_bands(place, worlds, planners, [0])


def planned(name, kind="planners", figure=None, title=None):
    return {"name": name, "title": title or name, "kind": kind, "figure": figure, "arguments": {},
            "folder": f"experiments/{name}", "command": f"hpp evaluate --out 'out/{name}'"}  # fmt: skip


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """A reproduction of which some has run and some has not; not to be changed."""
    tmp_path = tmp_path_factory.mktemp("reproduction")
    plan = [
        planned("main", figure="figures 4, 5 and 7", title=EVIL),
        planned("frequency", figure="figure 10"), planned("horizon", figure="figure 11"),
        planned("switches", title="Preset best without its parts"),
        planned("noise-1", title="Worse knowledge: some"), planned("noise-2", title="Worse knowledge: much"),
        planned("predictors", "predictor", "appendix C.3"), planned("losses", "curve", "figure 12"),
        planned("maddpg-training", "curve", "figure 8"),
    ]  # fmt: skip
    (tmp_path / "plan.json").write_text(json.dumps(
        {"scale": "smoke", "seed": 3, "versions": {"hpp-framework": "0.1", "torch": "2"}, "experiments": plan}
    ))  # fmt: skip
    place = tmp_path / "experiments"
    write_comparison(place / "main")
    write_comparison(place / "frequency", ("wall",), ("hpp:plan_every=5", "hpp:plan_every=10"))
    write_comparison(place / "noise-1", ("wall",), ("hpp",))
    errors = {"median_m": 0.1, "p90_m": 0.3, "count": 9}
    errors_found = [{"predictor": "far-sighted", "world": "wall", "role": role, "team": "a,b", "seed": 0,
              "trajectories": 2, "errors": [{"seconds": 1.0, "mean_m": 0.2, **errors}]}
             for role in ("self", "other")]  # fmt: skip
    (place / "predictors").mkdir()
    (place / "predictors" / "summary.json").write_text(json.dumps(errors_found))
    write_rows(place / "predictors" / "errors.csv", [], ErrorRow)
    curve = [{"steps": steps, "judged_return": -9.0, "success": 0.5} for steps in (1000, 2000)]
    card = {"curves": {"0": curve, "4": curve}, "run": {"seed": 4}, "judged": curve[1]}
    (place / "maddpg-training").mkdir()
    (place / "maddpg-training" / "summary.json").write_text(json.dumps(card))
    (place / "losses").mkdir()
    (place / "losses" / "summary.json").write_text(
        json.dumps({"losses": {"far-sighted": {"self": [[500, 1.0], [1000, 0.5]]}, "other-kind": {}}})
    )
    claim = {
        "claim": EVIL, "where": EVIL, "verdict": "holds partly", "evidence": EVIL,
        "numbers": {EVIL: [0.5, 0.25, 0.75], "n": [0.1, None, None]}, "experiments": ["main", "gone"],
    }  # fmt: skip
    (tmp_path / "claims.json").write_text(json.dumps([claim, {"claim": "bare"}]))
    return tmp_path


@pytest.fixture(scope="module")
def text(found):
    return read(found)


@pytest.fixture
def out(found, tmp_path):
    """A copy to damage."""
    return shutil.copytree(found, tmp_path / "copy")


class Page(HTMLParser):
    """Collects what a page names and refers to, and checks that its elements are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids, self.links, self.sources, self.open, self.scripts = [], [], [], [], 0
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.ids += [given["id"]] if "id" in given else []
        for name in ("href", "xlink:href"):
            self.links += [given[name]] if name in given else []
        self.sources += [given[name] for name in ("src", "poster") if name in given]
        self.scripts += tag == "script"
        if tag == "img":
            assert given.get("alt")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def read(out: Path) -> str:
    file = write_report(out, films=False)
    assert file == out / "report" / "index.html"
    return file.read_text(encoding="utf-8")


def visible(text: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"<style>.*?</style>", "", text, flags=re.S)))


def test_page_stands_alone_and_all_links_lead_somewhere(text):
    page = Page(text)
    assert not page.open
    assert len(page.ids) == len(set(page.ids))
    for link in page.links:
        assert link == "data:," or link[1:] in page.ids, link
    assert all(source.startswith("data:") for source in page.sources)
    assert not re.findall(r"(?:src|href)=\"(?:https?:)?//", text)
    assert not re.findall(r"url\((?!#)", text)


def test_text_from_files_is_escaped(text, found):
    assert Page(text).scripts == 0
    assert text.count("&lt;script&gt;") >= 5
    assert str(found) not in text


def test_says_the_numbers(text):
    words = visible(text)
    assert "meets in 100 % of all episodes with HPP" in words
    # one of four episodes per world
    assert "Centralized MP, meets in 25 %" in words
    assert "1 holds partly" in words
    assert "0.50 0.25 to 0.75" in words
    assert "hpp reproduce --scale smoke --seed 3" in words
    assert "Not run." in words


def test_figures_of_the_paper_stand_where_they_belong(text):
    parts = dict(re.findall(r'<section id="(figure-\d+)">(.*?)</section>', text, flags=re.S))
    assert list(parts) == [f"figure-{n}" for n in (4, 5, 7, 8, 9, 10, 11, 12)]
    assert "Centralized MP" in parts["figure-4"]
    assert "Centralized MP" not in parts["figure-5"]
    assert "plan_every=10" in parts["figure-10"]
    assert "seed 4, the best" in parts["figure-8"]
    assert "far-sighted" in parts["figure-12"]
    for missing in ("figure-7", "figure-9", "figure-11"):
        assert "Not run." in parts[missing]


def test_like_experiments_stand_together_beside_the_undisturbed_one(text):
    (part,) = re.findall(r'<section id="ablation-noise-1">(.*?)</section>', text, flags=re.S)
    assert all(label in part for label in ("undisturbed", ">some<"))


def test_same_folder_same_bytes(text, found):
    assert read(found) == text


def test_a_plan_of_which_nothing_has_run(tmp_path, found):
    bare = tmp_path / "bare"
    bare.mkdir()
    (bare / "plan.json").write_text((found / "plan.json").read_text())
    page = Page(read(bare))
    assert {"answer", "claims", "comparison", "paper", "ablations", "predictors", "appendix"} <= set(page.ids)


def test_missing_bands_and_cells_are_left_out(out):
    main = out / "experiments" / "main"
    (main / "distance.npz").unlink()
    summary = json.loads((main / "summary.json").read_text())
    summary["cells"] = [c for c in summary["cells"] if (c["world"], c["planner"]) != ("wall", "hpp")]
    (main / "summary.json").write_text(json.dumps(summary))
    (main / "config.json").unlink()
    Page(read(out))


def test_damaged_files_are_named(out):
    (out / "claims.json").write_text("[")
    with pytest.raises(ConfigError, match=r"claims\.json' is damaged"):
        write_report(out, films=False)
    (out / "plan.json").unlink()
    with pytest.raises(ConfigError, match=r"plan\.json"):
        write_report(out, films=False)


def test_best_median_and_worst_episode():
    times = {0: 9.0, 1: None, 2: 5.0, 3: None, 4: 7.0}
    rows = [episode("wall", "hpp", number, time) for number, time in times.items()]
    # of the failures, number 3 ended farther apart
    assert ranked(rows) == {"best": 2, "median": 0, "worst": 3}
    assert ranked(rows[:1]) == {"best": 0}


def test_tables_scroll_in_a_box_of_their_own(text):
    tables = len(re.findall(r'<table class="words\d">', text))
    boxes = re.findall(r'<div class="scroll" tabindex="0" role="region" aria-label="([^"]+)">\s*<table', text)
    assert len(boxes) == tables > 4
    assert "all planners in wall" in boxes


def test_claims_come_after_figures_one_line_each(text):
    parts = re.findall(r'<section id="(\w+)">\n<h2>', text)
    assert parts == [
        "answer",
        "comparison",
        "paper",
        "episodes",
        "ablations",
        "predictors",
        "claims",
        "appendix",
    ]
    lines = re.findall(r'<details class="claim"><summary>(.*?)</summary>', text)
    assert [unescape(visible(line)).strip() for line in lines] == [f"holds partly {EVIL}", "open bare"]


def test_smoke_scale_is_said_to_judge_nothing(text, out):
    assert "too few episodes to judge anything" in text
    plan = json.loads((out / "plan.json").read_text())
    (out / "plan.json").write_text(json.dumps({**plan, "scale": "full"}))
    assert "too few episodes" not in read(out)


def test_forest_plots_show_intervals_where_they_are(text):
    (panel,) = re.findall(r"<b>wall</b> success, 95 % interval</figcaption>(.*?)</table>", text, flags=re.S)[
        :1
    ]
    (row,) = re.findall(r"<tr.*?Centralized MP.*?</tr>", panel.split("HPP, paper")[1], flags=re.S)
    low, width, value = (float(each) for each in re.findall(r"(?:left|width):([\d.]+)%", row)[1:])
    # one of four, by Wilson
    assert (low, low + width, value) == pytest.approx((4.6, 69.9, 25.0), abs=0.11)


def test_curves_are_where_they_should_be_and_labels_apart():
    x = np.array([0.0, 10.0])
    ends = (1.0, 1.01, 4.0, np.nan)
    lines = [Line(f"planner {i}", Band(x, np.array([2.0, end]))) for i, end in enumerate(ends)]
    chart = Chart("t", "x", "y", lines)
    assert chart.path(lines[2]) == f"M{chart.left:.1f},{chart.at(0, 2)[1]} {chart.right},{chart.at(10, 4)[1]}"
    assert chart.path(lines[3]).count(",") == 1
    assert chart.at(0, 0) == [chart.left, chart.bottom]
    places = sorted(label.y for label in chart.labels())
    assert all(b - a >= LEADING - 0.2 for a, b in pairwise(places))
    assert 0 < places[0] < places[-1] < HEIGHT
    one = Chart("t", "x", "y", [Line("", Band(x[:1], np.array([0.5])))], logarithmic=True)
    assert np.isfinite(one.at(0, 0.5)).all()


def test_planners_look_the_same_everywhere_and_never_alike():
    planners = ["hpp", "hpp:preset=paper", "centralized-mp", "rrt-mp", "rrt-cem", "hpp:plan_every=5"]
    found = colors(planners)
    assert len(set(found.values())) == len(planners)
    assert 0 not in found.values()
    assert colors(["maddpg", "hpp"])["hpp"] == found["hpp"]
    # of too many, all but the first are grey, and told apart by their labels
    assert list(colors([*planners, "a", "b", "c"]).values()) == [1] + [0] * 8
