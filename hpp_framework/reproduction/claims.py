"""Claims, the parts that each is checked by, and how a verdict comes from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from hpp_framework.evaluation.statistics import Estimate

Outcome = Literal["yes", "no", "open"]
Verdict = Literal["holds", "holds partly", "does not hold", "undecided", "not measured"]

LISTED = 8
"""Parts that the evidence lists at most; of more it lists those that do not speak for the claim."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """One comparison that a claim implies.

    Attributes:
        about: what is compared, in words.
        found: the number and its 95 % interval.
        outcome: ``"yes"``: the interval lies where the claim says; ``"no"``: it excludes that;
            ``"open"``: it allows both.
        detail: of the numbers behind it, in words.
        preset: of HPP that it judges; empty where it judges no HPP of the main comparison.
    """

    about: str
    found: Estimate
    outcome: Outcome
    detail: str = ""
    preset: str = ""

    def __str__(self) -> str:
        value, low, high = (f"{each:.2f}" for each in (self.found.value, self.found.low, self.found.high))
        detail = f"{self.detail}: " if self.detail else ""
        return f"{self.about}: {detail}{value} ({low} to {high}), {self.outcome}"


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A statement of the paper and what was found.

    Attributes:
        claim: the statement, in our words.
        where: in the paper.
        rule: what counts as a yes.
        parts: the comparisons that could be made.
        experiments: that they rest on.
        missing: how many comparisons were not run.
        remark: why there can be none.
    """

    claim: str
    where: str
    rule: str
    parts: Sequence[Part]
    experiments: Sequence[str]
    missing: int = 0
    remark: str = ""

    def as_row(self) -> dict[str, Any]:
        """Return the claim as ``claims.json`` holds it."""
        return {
            "claim": self.claim,
            "where": self.where,
            "verdict": verdict(self.parts),
            "presets": self.by_preset(),
            "evidence": self.evidence(),
            "numbers": {part.about: part.found.as_list() for part in self.parts},
            "experiments": list(self.experiments),
        }

    def by_preset(self) -> dict[str, Verdict]:
        """Return the verdict for each preset of HPP alone; empty if only one or none is judged."""
        presets = list(dict.fromkeys(part.preset for part in self.parts if part.preset))
        if len(presets) < 2:
            return {}
        return {each: verdict([part for part in self.parts if part.preset == each]) for each in presets}

    def evidence(self) -> str:
        """Return the numbers in words."""
        if not self.parts:
            return self.remark or "What would show it was not run."
        spoke = sum(part.outcome == "yes" for part in self.parts)
        text = f"{self.rule} {spoke} of {len(self.parts)} do."
        if len(self.parts) <= LISTED:
            text += f" {'; '.join(map(str, self.parts))}."
        elif against := sorted((p for p in self.parts if p.outcome != "yes"), key=lambda p: p.outcome):
            more = len(against) - LISTED
            text += f" The others: {'; '.join(map(str, against[:LISTED]))}"
            text += f"; and {more} more, among the numbers." if more > 0 else "."
        was = "was" if self.missing == 1 else "were"
        return text + (f" {self.missing} more {was} not run." if self.missing else "")


def verdict(parts: Sequence[Part]) -> Verdict:
    """Return what the parts of a claim come to.

    - *holds*: every part says yes.
    - *holds partly*: some do.
    - *does not hold*: none does, and at least one says no.
    - *undecided*: every interval allows both, so that more episodes are needed.
    - *not measured*: nothing was run.
    """
    if not parts:
        return "not measured"
    outcomes = {part.outcome for part in parts}
    if "yes" in outcomes:
        return "holds" if outcomes == {"yes"} else "holds partly"
    return "does not hold" if "no" in outcomes else "undecided"


def side(low: float, high: float, border: float) -> Outcome:
    """Return yes for an interval above a border, no for one below, open for one that holds it."""
    if low > border:
        return "yes"
    return "no" if high < border else "open"
