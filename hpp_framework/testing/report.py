"""What a check says: findings, each with what is wrong, why it matters and what to write instead."""

from __future__ import annotations

import traceback
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from hpp_framework.utils.errors import HppError


@dataclass(frozen=True, kw_only=True)
class Rule:
    """One thing that a plugin may get wrong.

    Attributes:
        name: short, in messages and in ``docs/plugins.md``.
        why: why it matters.
        fix: what to write instead.
    """

    name: str
    why: str
    fix: str


@dataclass(frozen=True)
class Finding:
    """One thing that a plugin gets wrong.

    Attributes:
        rule: that it breaks.
        of: the function or attribute, e.g. ``"act()"``.
        what: is wrong, with the numbers seen.
    """

    rule: Rule
    of: str
    what: str

    def __str__(self) -> str:
        return (
            f"[{self.rule.name}] {self.of} {self.what}\n"
            f"    Why it matters: {self.rule.why}\n"
            f"    What to write: {self.rule.fix}"
        )


class CheckError(HppError):
    """A plugin does not keep its promises.

    Attributes:
        subject: what was checked, e.g. ``"skill 'p2p'"``.
        findings: everything that was found.
    """

    def __init__(self, subject: str, findings: tuple[Finding, ...]) -> None:
        things = "one thing" if len(findings) == 1 else f"{len(findings)} things"
        super().__init__("\n".join([f"{subject}: {things} to mend.", *(f"  {each}" for each in findings)]))
        self.subject = subject
        self.findings = findings


RAISES = Rule(
    name="raises",
    why="it is called in every state of many episodes side by side; one error ends the whole run.",
    fix="code that answers any finite input, any number of episodes (1 too) and any team that it was "
    "built for.",
)


class Report:
    """Collects findings about one subject.

    Args:
        subject: what is checked, e.g. ``"skill 'p2p'"``.
    """

    def __init__(self, subject: str) -> None:
        self.subject = subject
        self.findings: list[Finding] = []

    def add(self, rule: Rule, of: str, what: str) -> None:
        """Add a finding, unless the rule was already broken there."""
        if all((known.rule.name, known.of) != (rule.name, of) for known in self.findings):
            self.findings.append(Finding(rule, of, what))

    def require(self, fine: bool, rule: Rule, of: str, what: str) -> bool:  # reads as assert
        """Add a finding unless all is fine; return whether it is."""
        if not fine:
            self.add(rule, of, what)
        return fine

    @contextmanager
    def guarded(self, of: str, when: str = "", rule: Rule = RAISES) -> Generator[None]:
        """Turn an error within the context into a finding.

        Args:
            of: the function that runs.
            when: what it was asked, for the message.
            rule: that an error breaks.
        """
        try:
            yield
        except Exception as error:
            self.add(rule, of, f"raised {describe(error)}{f' {when}' if when else ''}.")

    def finish(self) -> None:
        """Raise :class:`CheckError` if anything was found."""
        if self.findings:
            raise CheckError(self.subject, tuple(self.findings))


def describe(error: BaseException) -> str:
    """Return an error with the place where it was raised."""
    text = f"{type(error).__name__}: {error}".splitlines()[0][:300]
    frames = traceback.extract_tb(error.__traceback__)
    return f"{text} ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else text
