"""Everything that a distribution registers, and the check that suits each thing."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from packaging.utils import canonicalize_name

from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import BrokenPlugin, Entry, Hub, hub
from hpp_framework.testing.build import IMPORT, not_imported
from hpp_framework.testing.layer import check_layer
from hpp_framework.testing.planner import check_planner
from hpp_framework.testing.predictor import check_predictor
from hpp_framework.testing.report import RAISES, CheckError, Finding, Report, Rule, describe
from hpp_framework.testing.robot import check_robot
from hpp_framework.testing.skill import check_skill
from hpp_framework.testing.task import check_task
from hpp_framework.testing.world import check_world
from hpp_framework.utils.errors import PluginError, UnknownNameError, unknown_name

BROKEN = Rule(
    name="plugin",
    why="nothing that it registers can be used; all other plugins go on working.",
    fix="a register(hub) that only adds names, in a module that can be imported, and dependencies that "
    "name the "
    "versions of hpp-framework that it was built for.",
)
CLASH = Rule(
    name="name-clash",
    why="the bare name belongs to neither; users have to write distribution/name.",
    fix="a name of your own, e.g. with your package's name in front: my-pkg-rover.",
)
FOLDER = Rule(
    name="checkpoints",
    why="predictors and policies search this folder for their weights.",
    fix="a factory that returns the path of an existing folder of the package, Path(__file__).parent / "
    "'weights', "
    "with KIND/NAME.safetensors and KIND/NAME.json (the card) in it, both shipped in the wheel.",
)
RULES = (BROKEN, CLASH, FOLDER)

ALL = "all"


@dataclass(frozen=True)
class Choice:
    """What to check other plugins with; None leaves it to each check.

    Attributes:
        robot: registered robot, for skills.
        team: as on the command line, for predictors, planners, tasks and worlds.
    """

    robot: str | None = None
    team: str | None = None

    def validate(self) -> None:
        """Check that there are such robots.

        Raises:
            HppError: if there are not.
        """
        if self.robot is not None:
            hub().robots.entry(self.robot)
        if self.team is not None:
            parse_team(self.team)


@dataclass(frozen=True)
class Target:
    """One registered thing.

    Attributes:
        kind: attribute name of its registry, e.g. ``"skills"``.
        entry: of the registry.
        clash: what to say if others have the same name, or empty.
    """

    kind: str
    entry: Entry[Any]
    clash: str = ""

    @property
    def name(self) -> str:
        """The name to look it up by."""
        return f"{self.entry.distribution}/{self.entry.name}" if self.clash else self.entry.name

    @property
    def subject(self) -> str:
        """How messages call it."""
        return f"{hub().registries()[self.kind].kind} '{self.name}'"


def find_targets(name: str) -> tuple[list[Target], list[BrokenPlugin]]:
    """Return what a name stands for, and the broken plugins that belong to it.

    Args:
        name: a distribution, a registered name (of any kind), or ``"all"``.

    Raises:
        UnknownNameError: if it is none of these; says so where a distribution registers nothing.
    """
    everything = list(_everything(hub()))
    wanted = canonicalize_name(name)
    targets = [t for t in everything if name == ALL or canonicalize_name(t.entry.distribution) == wanted]
    broken = [p for p in hub().broken if name == ALL or canonicalize_name(p.distribution) == wanted]
    if not targets and not broken:
        named = [t for t in everything if name in (t.entry.name, f"{t.entry.distribution}/{t.entry.name}")]
        targets = named or _nothing(name, everything)
    return targets, broken


def _everything(hub: Hub) -> Iterator[Target]:
    for kind, registry in hub.registries().items():
        yield from (Target(kind, entry) for entry in registry)
        for name, entries in registry.clashes().items():
            yield from (Target(kind, entry, registry.clash(name)) for entry in entries)


def _nothing(name: str, everything: list[Target]) -> list[Target]:
    try:
        found = version(name)
    except (PackageNotFoundError, ValueError):
        known = {t.entry.name for t in everything} | {t.entry.distribution for t in everything} - {""}
        raise unknown_name("distribution or registered thing", name, known) from None
    module = canonicalize_name(name).replace("-", "_")
    raise UnknownNameError(
        f"{name} {found} is installed, but registers nothing. Its pyproject.toml needs\n"
        f'[project.entry-points."hpp_framework.plugins"]\n{module} = "{module}.plugin:register"\n'
        "and has to be installed again after that line is added."
    )


def check_target(target: Target, choice: Choice | None = None) -> None:
    """Run the check that suits a registered thing.

    Args:
        target: what to check.
        choice: what to check it with.

    Raises:
        CheckError: if anything is wrong; holds everything that was found.
    """
    findings: list[Finding] = []
    if target.clash:
        findings.append(Finding(CLASH, "the name", f"is taken: {target.clash}"))
    try:
        _checks(choice or Choice()).get(target.kind, lambda _: _check_source(target))(target.name)
    except CheckError as error:
        findings += error.findings
    if findings:
        raise CheckError(target.subject, tuple(findings))


def check_broken(plugin: BrokenPlugin) -> CheckError:
    """Return a plugin that could not be loaded as the error of a check."""
    return CheckError(
        f"plugin '{plugin.name}'", (Finding(BROKEN, "the plugin", f"is broken: {plugin.reason}"),)
    )


def stopped(target: Target, error: Exception) -> CheckError:
    """Return an error that no check foresaw as the error of a check."""
    return CheckError(target.subject, (Finding(RAISES, "the check", f"was stopped by {describe(error)}."),))


def _checks(choice: Choice) -> dict[str, Callable[[str], None]]:
    robots = None if choice.team is None else parse_team(choice.team).robots
    return {
        "robots": check_robot,
        "skills": lambda name: check_skill(name, robot=choice.robot),
        "tasks": lambda name: check_task(name, robots=robots),
        "worlds": lambda name: check_world(name, robots=robots),
        "planners": lambda name: check_planner(name, team=choice.team),
        "layers": lambda name: check_layer(name, team=choice.team),
        "predictors": lambda name: check_predictor(name, team=choice.team),
    }


def _check_source(target: Target) -> None:
    """Check what has no check of its own: that it can be imported, and that a folder of weights is one."""
    report = Report(target.subject)
    try:
        factory = target.entry.factory()
    except PluginError as error:
        not_imported(report, target.kind, error)
        report.finish()
        raise
    with report.guarded("the registered source", rule=IMPORT):
        report.require(callable(factory), IMPORT, "the registered source", f"is {factory!r}, not a function.")
        if target.kind == "checkpoints":
            _check_folder(report, factory())
    report.finish()


def _check_folder(report: Report, folder: Any) -> None:
    if not isinstance(folder, Path) or not folder.is_dir():
        report.add(FOLDER, "the factory", f"returned {folder!r}, which is no existing folder.")
        return
    for file in sorted(folder.glob("*/*.safetensors")):
        card = file.with_suffix(".json")
        try:
            json.loads(card.read_text())
        except (OSError, ValueError) as error:
            report.add(FOLDER, f"{file.parent.name}/{file.name}", f"has no readable card beside it: {error}.")
