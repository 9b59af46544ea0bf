"""The parts of the report, in the order in which they are read."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence

from hpp_framework.reproduction.report_data import CURVE, PLANNERS, PREDICTOR, Ran, Reproduction
from hpp_framework.reproduction.report_episodes import ShownCell
from hpp_framework.reproduction.report_films import films
from hpp_framework.reproduction.report_html import (
    Column,
    Markup,
    anchor,
    details,
    join,
    note,
    section,
    table,
    tag,
)
from hpp_framework.reproduction.report_names import planner_label, world_label
from hpp_framework.reproduction.report_panels import (
    NOT_RUN,
    Variant,
    legend,
    over_time,
    predictor_errors,
    profiles,
    successes,
    training_curves,
    variants,
)
from hpp_framework.reproduction.report_paper import FIGURES, PaperFigure
from hpp_framework.reproduction.report_tables import (
    blame_table,
    claims_table,
    comparison_table,
    overall_table,
    predictor_table,
    verdict,
    world_table,
)


def claims_section(found: Reproduction) -> Markup:
    """Return every sentence of the paper that was checked."""
    if not found.claims:
        return section("claims", "Claims", note("The claims have not been judged yet."))
    counted = Counter(str(claim.get("verdict", "")) for claim in found.claims)
    tally = [tag("li", verdict(text), f" {count}") for text, count in sorted(counted.items())]
    known = [ran.name for ran in found.experiments]
    return section(
        "claims", "Claims",
        tag("p", "Each sentence of the paper that can be checked, and what our episodes say of it."),
        tag("ul", *tally, class_="tally"), claims_table(found.claims, known),
    )  # fmt: skip


def main_section(ran: Ran | None) -> Markup:
    """Return the main comparison: success, tables, profiles, and where success was lost."""
    if ran is None or not ran.rows("cells"):
        return section("comparison", "The comparison", note(NOT_RUN))
    lost = blame_table(ran)
    every = variants(ran)
    tables = [
        details(f"All numbers in {world_label(world)}", world_table(ran, world)) for world in ran.worlds
    ]
    drawn = [profiles(ran, world) for world in _strata(ran)]
    return section(
        "comparison", "The comparison",
        tag("p", "The same worlds, starts and seeds for all. Planners marked ",
            tag("abbr", "told", title="is told what no robot knows"),
            " are told what no robot knows: they are ceilings, not competitors."),
        successes(every, ran.worlds), overall_table(ran), *tables,
        section(
            "profiles", "Performance profiles",
            tag("p", "The share of episodes with an RPL (success times bound over time) above each "
                "threshold: higher is better, and the left end is the success rate."),
            legend(every), tag("div", join(*drawn), class_="panels"), level=3,
        ),
        section(
            "blame", "Where success is lost",
            tag("p", "Differences on the same episodes between HPP, the same planner with communication, and "
                "the same with a perfect model. The three losses add up to what HPP misses."),
            lost, level=3,
        ) if lost else None,
    )  # fmt: skip


def paper_section(found: Reproduction) -> Markup:
    """Return the paper's figures with results, each beside ours."""
    return section(
        "paper", "The paper's figures",
        tag("p", "What the paper's caption and text say of each figure, and the same drawn from our "
            "episodes: means with the band between the quartiles. A distance stays as it was at an episode's "
            "end."),
        *(_figure(each, found) for each in FIGURES),
    )  # fmt: skip


def films_section(cells: Sequence[ShownCell]) -> Markup:
    """Return ways and films of chosen episodes."""
    if not cells:
        return section("episodes", "Episodes", note(NOT_RUN))
    worlds = list(dict.fromkeys(cell.world for cell in cells))
    parts = [
        section(
            f"episodes-{anchor(world)}", world_label(world),
            *(films(cell) for cell in cells if cell.world == world), level=3,
        )
        for world in worlds
    ]  # fmt: skip
    return section(
        "episodes", "Episodes",
        tag("p", "HPP and the best baseline of each world: the ways of many episodes, and films of the best, "
            "the median and the worst one at twice their speed. Crosses are the goals that robots pursue."),
        *parts,
    )  # fmt: skip


def ours_section(found: Reproduction) -> Markup:
    """Return the experiments that belong to no figure of the paper; those with like titles together."""
    numbers = {figure.number for figure in FIGURES}
    groups: dict[str, list[Ran]] = {}
    for ran in found.experiments:
        if ran.kind == PLANNERS and not ran.figures() & numbers and ran is not found.main:
            groups.setdefault(ran.title.split(":")[0], []).append(ran)
    parts = [_group(title, group, found.main) for title, group in groups.items()]
    return section("ablations", "Ablations", *(parts or [note(NOT_RUN)]))


def predictors_section(found: Reproduction) -> Markup:
    """Return how far off the motion models are."""
    studies = [ran for ran in found.experiments if ran.kind == PREDICTOR]
    parts: list[Markup] = []
    for ran in studies:
        body = [predictor_errors(ran), predictor_table(ran)] if ran.summary else [note(NOT_RUN)]
        parts.append(section(f"study-{anchor(ran.name)}", ran.title, *body, level=3))
    return section(
        "predictors", "Predictors",
        tag("p", "Where robots were imagined to be, against where they went, on fresh trajectories. Two "
            "models that have learnt nothing stand beside: constant velocity, and an empty world."),
        *(parts or [note(NOT_RUN)]),
    )  # fmt: skip


def appendix_section(found: Reproduction) -> Markup:
    """Return commands, configuration and versions."""
    versions = [(name, version) for name, version in found.versions.items()]
    columns = (Column("package", number=False), Column("version", number=False))
    return section(
        "appendix", "How to repeat it",
        tag("p", "Seed ", tag("b", str(found.seed)), ", scale ", tag("b", found.scale), ". Everything: ",
            tag("code", f"hpp reproduce --scale {found.scale} --seed {found.seed}"),
            ". Each experiment alone, with the configuration that was in force:"),
        *(_repeat(ran) for ran in found.experiments),
        section("versions", "Versions", table(columns, versions, label="versions of packages"), level=3),
    )  # fmt: skip


def _figure(figure: PaperFigure, found: Reproduction) -> Markup:
    sources = [ran for ran in found.experiments if figure.number in ran.figures()]
    said = tag(
        "aside", tag("h4", f"Figure {figure.number} of the paper"), tag("p", figure.caption),
        tag("p", "It reads from it: ", tag("i", figure.reading)),
    )  # fmt: skip
    ours = [part for ran in sources for part in _sources(ran, figure, alone=len(sources) == 1)]
    body = tag("div", said, tag("div", join(*(ours or [note(NOT_RUN)])), class_="ours"), class_="beside")
    return section(f"figure-{figure.number}", f"{figure.number}. {figure.title}", body, level=3)


def _sources(ran: Ran, figure: PaperFigure, *, alone: bool) -> list[Markup]:
    head = [] if alone else [tag("h4", ran.title)]
    if ran.kind == CURVE:
        return [*head, training_curves(ran)]
    if ran.kind == PREDICTOR:
        return [*head, predictor_errors(ran) if ran.summary else note(NOT_RUN)]
    worlds = [world for world in ran.worlds if not figure.worlds or world in figure.worlds]
    shown = variants(ran, figure.planners)
    if not shown or not worlds:
        return [*head, note(NOT_RUN)]
    if _preset(ran) != "best":
        head.append(note(f"Preset {_preset(ran)}."))
    return [*head, over_time(shown, worlds), details("success with intervals", successes(shown, worlds))]


def _group(title: str, group: Sequence[Ran], main: Ran | None) -> Markup:
    """Return experiments that ask the same; several stand beside the main comparison, undisturbed."""
    said = [f"The paper: {group[0].figure}."] if group[0].figure else []
    said += [f"Preset {_preset(group[0])}."] if _preset(group[0]) != "best" else []
    asked = " ".join(said)
    name = f"ablation-{anchor(group[0].name)}"
    ran = [each for each in group if each.rows("cells")]
    if not ran:
        return section(name, title, tag("p", asked) if asked else None, note(NOT_RUN), level=3)
    worlds = ran[0].worlds
    if len(group) == 1:
        shown, compared = variants(ran[0]), comparison_table(ran[0])
        return section(
            name, title, tag("p", asked) if asked else None, successes(shown, worlds),
            details("distance over time", over_time(shown, worlds)),
            details("paired differences", compared) if compared else None, level=3,
        )  # fmt: skip
    parts: list[Markup] = []
    for planner in ran[0].planners:
        lines = [Variant(_after(each.title), each, planner) for each in ran]
        if main is not None and planner in main.planners:
            lines.insert(0, Variant("undisturbed", main, planner))
        parts += [tag("h4", planner_label(planner)), successes(lines, worlds)]
    return section(name, title, *parts, level=3)


def _repeat(ran: Ran) -> Markup:
    config = tag("pre", json.dumps(ran.config, indent=2)) if ran.config else None
    return tag(
        "div", tag("h4", ran.title), tag("pre", tag("code", ran.command), class_="command"),
        details("configuration", config) if config else None,
        note(NOT_RUN) if ran.summary is None else None, id=f"run-{anchor(ran.name)}", class_="run",
    )  # fmt: skip


def _strata(ran: Ran) -> list[str]:
    return list(dict.fromkeys(str(row["world"]) for row in ran.rows("aggregates")))


def _after(title: str) -> str:
    return title.split(":", 1)[-1].strip()


def _preset(ran: Ran) -> str:
    """Return the preset of planners that name none."""
    return str((ran.config or {}).get("preset", "best"))
