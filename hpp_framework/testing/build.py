"""From what a plugin's author has - a registered name, a factory, an object - to the object to check."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hpp_framework.plugins.registry import hub
from hpp_framework.testing.report import Report, Rule, describe
from hpp_framework.utils.errors import CheckpointError, ConfigError, PluginError

IMPORT = Rule(
    name="import",
    why="the name is listed, but every use of it ends in an error.",
    fix='a source "package.module:factory" that exists: hub.KIND.add("name", "my_package.module:factory").',
)
SIGNATURE = Rule(
    name="signature",
    why="the framework calls every factory of a kind with the same arguments.",
    fix="a factory with exactly the parameters named above; further ones need defaults.",
)
BUILD = Rule(
    name="build",
    why="a command line or team file that names it gets this error and no run.",
    fix="a factory that works for every input it is meant for and raises ConfigError with a remedy for "
    "others.",
)
WEIGHTS = Rule(
    name="weights",
    why="a learned plugin without its weights cannot be built; users get this error.",
    fix="weights (.safetensors and their card) inside the package, shipped in the wheel, or name the "
    "robots and "
    "the team that there are weights for: hpp check has the options --robot and --team.",
)
KIND = Rule(
    name="kind",
    why="everything that uses it relies on the methods of the base class.",
    fix="a class that derives from the base class of hpp_framework, and a factory that returns an "
    "object of it.",
)
SHARED = Rule(
    name="shared-object",
    why="every robot and every episode gets an object of its own; a shared one carries state from one "
    "to another.",
    fix="a factory that builds a new object at each call; keep nothing but constants in the module.",
)
REFUSED = replace(BUILD, fix="a value that it accepts.")
"""For a module that builds something when it is imported, from a value that the framework refuses."""
RULES = (IMPORT, SIGNATURE, BUILD, WEIGHTS, KIND, SHARED)


@dataclass(frozen=True)
class Source:
    """What a check was given.

    Attributes:
        subject: how messages call it.
        factory: builds it, or None.
        made: the object itself, or None.
        distribution: that registered it; empty for what was not registered.
        name: registered name; empty for what was not registered.
    """

    subject: str
    factory: Callable[..., Any] | None
    made: Any = None
    distribution: str = ""
    name: str = ""


def find_source(kind: str, given: Any, expected: type) -> tuple[Source, Report]:
    """Look at what a check was given, and begin its report.

    Args:
        kind: noun, e.g. ``"skill"``.
        given: a registered name, a factory, or an object of the expected type.
        expected: base class of what is checked.

    Raises:
        UnknownNameError: if nothing has that name.
        CheckError: if the registered source cannot be imported.
    """
    if isinstance(given, str):
        entry = hub().registries()[f"{kind}s"].entry(given)
        report = Report(f"{kind} '{given}'")
        try:
            factory = entry.factory()
        except PluginError as error:
            not_imported(report, f"{kind}s", error)
            report.finish()
            raise
        return Source(report.subject, factory, None, entry.distribution, entry.name), report
    if isinstance(given, expected):
        subject = f"{kind} {type(given).__name__}"
        return Source(subject, None, given), Report(subject)
    subject = f"{kind} {getattr(given, '__name__', type(given).__name__)}"
    if not callable(given):
        report = Report(subject)
        report.add(KIND, "the object", f"is {given!r}, neither a {expected.__name__} nor a factory of one.")
        report.finish()
    return Source(subject, given), Report(subject)


def not_imported(report: Report, registry: str, error: PluginError) -> None:
    """Add why a registered source cannot be imported.

    Args:
        report: of the check.
        registry: attribute name of the registry, e.g. ``"robots"``.
        error: of the entry's factory.
    """
    refused = error.__cause__
    if isinstance(refused, ConfigError):
        report.add(REFUSED, "the module", f"gives a value that is refused: {refused}{_where(refused)}")
        return
    rule = replace(IMPORT, fix=IMPORT.fix.replace("KIND", registry))
    report.add(rule, "the registered source", f"cannot be imported: {error}")


def _where(error: BaseException) -> str:
    """Return the line of a module that led to an error when it was imported, if there is one."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.name == "<module>"]
    return f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""


def build(
    source: Source,
    report: Report,
    arguments: Sequence[Any],
    expected: type,
    signature: str,
    *,
    fresh: bool = True,
) -> Any:
    """Return the object to check; None after findings that leave nothing to check.

    Args:
        source: what was given.
        report: of the check.
        arguments: of the factory.
        expected: base class of what it returns.
        signature: of the factory, for messages.
        fresh: whether two calls must return two objects.

    Raises:
        CheckpointError: if weights are missing; there may be some for other arguments.
    """
    made = source.made if source.factory is None else _call(source.factory, report, arguments, signature)
    if report.findings:
        return None
    if not isinstance(made, expected):
        shown = "None (is a 'return' missing?)" if made is None else repr(made)[:80]
        report.add(KIND, "the factory", f"returned {shown}, which is no {expected.__name__}.")
        return None
    if fresh and source.factory is not None:
        with report.guarded("the factory", "at its second call", BUILD):
            if source.factory(*arguments) is made:
                report.add(SHARED, "the factory", "returned the same object at its second call.")
    return made


def _call(factory: Callable[..., Any], report: Report, arguments: Sequence[Any], signature: str) -> Any:
    try:
        inspect.signature(factory).bind(*arguments)
    except TypeError as error:
        report.add(SIGNATURE, "the factory", f"does not take {signature}: {error}.")
        return None
    except ValueError:
        # some built-in callables do not say what they take
        pass
    try:
        return factory(*arguments)
    except CheckpointError:
        raise
    except Exception as error:
        report.add(BUILD, "the factory", f"raised {describe(error)}.")
        return None
