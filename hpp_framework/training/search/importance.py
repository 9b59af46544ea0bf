"""Which parameters the score hung on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import spearmanr

from hpp_framework.training.search.space import Phase, Value

if TYPE_CHECKING:
    from optuna import Study

FEWEST = 4
"""Finished trials before anything is said."""


def rank_correlations(
    phase: Phase, trials: Sequence[tuple[Mapping[str, Value], float]]
) -> dict[str, float | None]:
    """Return Spearman's rank correlation of each parameter of a phase with the score.

    Choices are ranked in the order in which they are declared.

    Args:
        phase: whose parameters.
        trials: settings and score of each finished trial.

    Returns:
        By parameter; None where there are fewer than four trials, or nothing that differs.
    """
    scores = np.array([score for _, score in trials])
    found: dict[str, float | None] = {}
    for name, parameter in phase.parameters.items():
        places = np.array([parameter.place(settings[name]) for settings, _ in trials])
        told = len(trials) >= FEWEST and np.ptp(places) > 0 and np.ptp(scores) > 0
        # the first of (correlation, p-value)
        found[name] = float(np.asarray(spearmanr(places, scores))[0]) if told else None
    return found


def fanova(study: Study) -> dict[str, float] | None:
    """Return each parameter's share of the score's variance (fANOVA, Hutter, Hoos, Leyton-Brown 2014).

    Args:
        study: of a phase.

    Returns:
        By parameter; None without scikit-learn, which fits the forest, or with fewer than four trials.
    """
    from optuna.importance import FanovaImportanceEvaluator, get_param_importances
    from optuna.trial import TrialState

    finished = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    scores = [trial.value for trial in finished]
    if find_spec("sklearn") is None or len(finished) < FEWEST or len(set(scores)) < 2:
        return None
    shares = get_param_importances(study, evaluator=FanovaImportanceEvaluator(seed=0))
    return {name: float(share) for name, share in shares.items()}
