"""What a search found: a report to read, a picture, and the winner's settings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from hpp_framework.core.skill import as_pairs
from hpp_framework.plugins.weights import portable
from hpp_framework.training.search.config import SearchConfig
from hpp_framework.training.search.figure import draw_search
from hpp_framework.training.search.importance import rank_correlations
from hpp_framework.training.search.space import SCORE, Phase, SkillSearch, Value
from hpp_framework.training.search.study import PhaseStudy, TrialRow
from hpp_framework.utils.run_folder import write_json, write_text

REPORT, PICTURE, BEST = "report.md", "report.png", "best.json"


def write_report(config: SearchConfig, search: SkillSearch, studies: Sequence[PhaseStudy]) -> None:
    """Write ``report.md``, ``report.png`` and ``best.json``; nothing before the baseline has finished.

    Args:
        config: of the search; ``out`` is written to.
        search: what was config.
        studies: of the phases that have begun.
    """
    judged = [[row for row in study.rows() if row.score is not None] for study in studies]
    if not judged or not judged[0] or judged[0][0].number != 0:
        return
    baseline = judged[0][0]
    # of equals the first of the last phase: it has settings for all that was searched
    best = max((row for rows in reversed(judged) for row in rows), key=lambda row: row.metrics[SCORE])
    start = {**search.start, **config.settings}
    lines = [
        f"# Search of the skill {config.skill} for {config.robot}",
        "",
        *_introduction(config, studies),
        "",
        *_comparison(baseline, best),
        *_changes(start, best),
        *_training(config, best),
    ]
    for study in studies:
        lines += _phase(study, start)
    write_text(config.out / REPORT, "\n".join(lines) + "\n")
    write_json(config.out / BEST, _summary(baseline, best))
    draw_search(config.out / PICTURE, [(study.phase, study.rows()) for study in studies], start)


def train_command(config: SearchConfig, settings: Mapping[str, Value]) -> str:
    """Return the command line that trains with a trial's settings, for the usual number of steps."""
    chosen = ["--set", *as_pairs(settings)] if settings else []
    start = ["--init", portable(config.init)] if config.init else []
    return " ".join(["hpp train skill", config.skill, "--robot", config.robot, *start, *chosen])


def _introduction(config: SearchConfig, studies: Sequence[PhaseStudy]) -> list[str]:
    counts = [
        f"{study.phase.name}: " + ", ".join(_counted(study.rows(), state) for state in _states(study.rows()))
        for study in studies
    ]
    lines = [
        f"Each trial trained for {config.steps:,} control steps and was then judged by the task itself. "
        f"Seed {config.seed}: all trials train and are judged in the same worlds. Trials by phase: "
        f"{'; '.join(counts)}.",
    ]
    if config.rungs:
        lines += [
            "",
            f"After {', '.join(f'{share:g}' for share in config.rungs)} of its steps a training was stopped "
            "if the best that its learning curve had reached was below the median of the phase's finished "
            "trials at that step; never the baseline, and not before four trials had finished.",
        ]
    return lines


def _states(rows: Iterable[TrialRow]) -> list[str]:
    return list(dict.fromkeys(row.state for row in rows))


def _counted(rows: Sequence[TrialRow], state: str) -> str:
    return f"{sum(row.state == state for row in rows)} {state}"


def _comparison(baseline: TrialRow, best: TrialRow) -> list[str]:
    """Return the best trial's metrics beside the baseline's."""
    lines = [
        f"## Best: trial {best.number} of {best.phase}",
        "",
        "The best of several noisy scores flatters: judge the winner again with another seed.",
        "",
        *_table_head(["", "baseline", "best", "difference"]),
    ]
    for name, value in baseline.metrics.items():
        new = best.metrics.get(name, float("nan"))
        lines.append(_table_row([name, _short(value), _short(new), f"{new - value:+.4f}"]))
    return [*lines, ""]


def _short(value: float) -> str:
    return f"{round(value, 4):g}"


def _changes(start: Mapping[str, Value], best: TrialRow) -> list[str]:
    changed = {name: value for name, value in best.settings.items() if start.get(name) != value}
    if not changed:
        return ["Nothing that was tried was better than the settings that the search began with.", ""]
    lines = _table_head(["setting", "before", "now"])
    lines += [_table_row([f"`{name}`", start.get(name, ""), value]) for name, value in changed.items()]
    return [*lines, ""]


def _training(config: SearchConfig, best: TrialRow) -> list[str]:
    return ["To train it at full length:", "", "```bash", train_command(config, best.settings), "```", ""]


def _phase(study: PhaseStudy, start: Mapping[str, Value]) -> list[str]:
    phase, rows = study.phase, study.rows()
    ranked = sorted(rows, key=lambda row: (row.score is None, -(row.score or 0), row.number))
    lines = [
        f"## Phase {phase.name}",
        "",
        *_table_head(["trial", "state", SCORE, *phase.parameters]),
        *(_trial(row, phase) for row in ranked),
        "",
        *(f"Trial {row.number} failed: {row.failure}\n" for row in rows if row.failure),
    ]
    return [*lines, *_importances(study, start), ""]


def _trial(row: TrialRow, phase: Phase) -> str:
    score = "" if row.score is None else f"{row.score:.4f}"
    number = f"{row.number} (baseline)" if row.number == 0 else row.number
    return _table_row([number, row.state, score, *(row.settings.get(name, "") for name in phase.parameters)])


def _importances(study: PhaseStudy, start: Mapping[str, Value]) -> list[str]:
    """Return what the phase searched, and what the score hung on."""
    finished = [(row.settings, row.score) for row in study.rows() if row.score is not None]
    ranks, shares = rank_correlations(study.phase, finished), study.importances()
    head = ["parameter", "searched", "started from", "rank correlation with the score"]
    lines = _table_head([*head, "fANOVA"] if shares else head)
    for name, parameter in study.phase.parameters.items():
        rank = ranks[name]
        cells = [f"`{name}`", str(parameter), start[name], "" if rank is None else f"{rank:+.2f}"]
        lines.append(_table_row([*cells, f"{shares.get(name, 0):.2f}"] if shares else cells))
    return lines


def _table_head(cells: Sequence[str]) -> list[str]:
    return [_table_row(cells), _table_row(["---"] * len(cells))]


def _table_row(cells: Iterable[object]) -> str:
    return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"


def _summary(baseline: TrialRow, best: TrialRow) -> dict[str, Any]:
    return {
        "settings": dict(best.settings),
        "phase": best.phase,
        "trial": best.number,
        "folder": best.folder,
        "metrics": dict(best.metrics),
        "baseline_metrics": dict(baseline.metrics),
    }
