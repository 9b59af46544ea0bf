"""What a search found: a report to read, a picture, and the winner's settings."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from math import nan
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from optuna import Study
from optuna.exceptions import ExperimentalWarning
from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
from optuna.trial import TrialState
from optuna.visualization import matplotlib as plots

from hpp_framework.core.skill import as_pairs
from hpp_framework.plugins.weights import portable
from hpp_framework.training.search.phase import PhaseSearch, TrialRow
from hpp_framework.training.search.space import SCORE, SearchConfig, SkillSearch, Value, describe
from hpp_framework.utils.run_folder import replacing, write_json, write_text

REPORT, PICTURE, BEST = "report.md", "report.png", "best.json"
FEWEST = 4
"""Finished trials before anything is said about parameters."""
COLUMNS = 4
"""Parameters side by side in the picture."""
PANEL = (3.2, 3.2)
"""Inches per panel."""


def write_report(config: SearchConfig, search: SkillSearch, phases: Sequence[PhaseSearch]) -> None:
    """Write ``report.md``, ``report.png`` and ``best.json``; nothing before the baseline has finished.

    Args:
        config: of the search; ``out`` is written to.
        search: what was searched.
        phases: that have begun.
    """
    judged = [[row for row in phase.rows() if row.score is not None] for phase in phases]
    if not judged or not judged[0] or judged[0][0].number != 0:
        return
    baseline = judged[0][0]
    # of equals the first of the last phase: it has settings for all that was searched
    best = max((row for rows in reversed(judged) for row in rows), key=lambda row: row.metrics[SCORE])
    text = _report(config, {**search.start, **config.settings}, phases, baseline, best)
    summary = {
        "settings": best.settings, "phase": best.phase, "trial": best.number, "folder": best.folder,
        "metrics": best.metrics, "baseline_metrics": baseline.metrics,
    }  # fmt: skip
    write_text(config.out / REPORT, text)
    write_json(config.out / BEST, summary)
    draw_search(config.out / PICTURE, [phase.study for phase in phases])


def train_command(config: SearchConfig, settings: Mapping[str, Value]) -> str:
    """Return the command line that trains with a trial's settings, for the usual number of steps."""
    chosen = ["--set", *as_pairs(settings)] if settings else []
    start = ["--init", portable(config.init)] if config.init else []
    return " ".join(["hpp train skill", config.skill, "--robot", config.robot, *start, *chosen])


def importances(study: Study) -> dict[str, float]:
    """Return how much each parameter sets the better quarter of a study's trials apart, in shares of 1.

    PED-ANOVA (Watanabe, Bansal, Hutter 2023). Empty with fewer than four finished trials, or equal scores.
    """
    finished = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    if len(finished) < FEWEST or len({trial.value for trial in finished}) < 2:
        return {}
    return get_param_importances(study, evaluator=_evaluator())


def draw_search(file: Path, studies: Sequence[Study]) -> None:
    """Draw Optuna's plots of all phases one below another.

    The history of the scores comes first, then for each phase the learning curves where trials could be
    stopped, the importances, and the score against each parameter.

    Args:
        file: the picture.
        studies: of the phases.
    """
    style = {"legend.fontsize": "x-small", "figure.constrained_layout.use": True}
    with plt.style.context(["default", style]), warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        # a phase with one trial, or a parameter of one value so far, has no range to show
        warnings.filterwarnings("ignore", "Attempting to set identical low and high")
        rows = [_pixels(plots.plot_optimization_history(studies, target_name=SCORE), "all phases")]
        for study in studies:
            title = f"phase {study.study_name}"
            if any(trial.intermediate_values for trial in study.trials):
                rows.append(_pixels(plots.plot_intermediate_values(study), title))
            if importances(study):
                rows.append(_pixels(plots.plot_param_importances(study, evaluator=_evaluator()), title))
            names = list(study.trials[0].distributions)
            for first in range(0, len(names), COLUMNS):
                shown = names[first : first + COLUMNS]
                rows.append(_pixels(plots.plot_slice(study, shown, target_name=SCORE), title))
        with replacing(file) as temporary:
            plt.imsave(temporary, np.concatenate(rows), format="png")


def _evaluator() -> PedAnovaImportanceEvaluator:
    return PedAnovaImportanceEvaluator(target_quantile=0.25)


def _pixels(axes: Any, title: str) -> np.ndarray:
    """Return what was drawn as an image, as wide as all others, and forget the figure."""
    figure = np.atleast_1d(axes)[0].figure
    figure.set(layout_engine="constrained", size_inches=(PANEL[0] * COLUMNS, PANEL[1]))
    figure.suptitle(title)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    plt.close(figure)
    return np.array(canvas.buffer_rgba())


def _report(
    config: SearchConfig,
    start: Mapping[str, Value],
    phases: Sequence[PhaseSearch],
    baseline: TrialRow,
    best: TrialRow,
) -> str:
    states = {phase.name: Counter(row.state for row in phase.rows()) for phase in phases}
    counts = [
        f"{name}: {', '.join(f'{n} {state}' for state, n in of.items())}" for name, of in states.items()
    ]
    stopping = (
        f"After {', '.join(f'{share:g}' for share in config.rungs)} of its steps a training was stopped "
        "if the best that its learning curve had reached was below the median of the phase's finished "
        "trials at that step; never the baseline, and not before four trials had finished.\n\n"
    )
    metrics = [
        (name, f"{round(old, 4):g}", f"{round(new, 4):g}", f"{new - old:+.4f}")
        for name, old in baseline.metrics.items()
        for new in [best.metrics.get(name, nan)]
    ]
    changed = [
        (f"`{name}`", start.get(name, ""), value)
        for name, value in best.settings.items()
        if start.get(name) != value
    ]
    nothing = "Nothing that was tried was better than the settings that the search began with."
    return f"""# Search of the skill {config.skill} for {config.robot}

Each trial trained for {config.steps:,} control steps and was then judged by the task itself. \
Seed {config.seed}: all trials train and are judged in the same worlds. Trials by phase: {"; ".join(counts)}.

{stopping if config.rungs else ""}## Best: trial {best.number} of {best.phase}

The best of several noisy scores flatters: judge the winner again with another seed.

{_table(("", "baseline", "best", "difference"), metrics)}

{_table(("setting", "before", "now"), changed) if changed else nothing}

To train it at full length:

```bash
{train_command(config, best.settings)}
```

{"".join(_phase(phase, start) for phase in phases)}"""


def _phase(phase: PhaseSearch, start: Mapping[str, Value]) -> str:
    """Return the trials of a phase, what it searched, and what the score hung on."""
    rows, names, shares = phase.rows(), phase.parameters, importances(phase.study)
    trials = [
        (
            "0 (baseline)" if row.number == 0 else row.number,
            row.state,
            "" if row.score is None else f"{row.score:.4f}",
            *(row.settings.get(name, "") for name in names),
        )
        for row in sorted(rows, key=lambda row: (row.score is None, -(row.score or 0), row.number))
    ]
    parameters = [
        (f"`{name}`", describe(each), start[name], f"{shares[name]:.2f}" if shares else "")
        for name, each in names.items()
    ]
    failures = "".join(f"Trial {row.number} failed: {row.failure}\n\n" for row in rows if row.failure)
    return f"""## Phase {phase.name}

{_table(("trial", "state", SCORE, *names), trials)}

{failures}{_table(("parameter", "searched", "started from", "importance (PED-ANOVA)"), parameters)}

"""


def _table(head: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    return "\n".join(
        "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"
        for cells in (head, ["---"] * len(head), *rows)
    )
