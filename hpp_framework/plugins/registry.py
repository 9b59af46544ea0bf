"""One generic registry and the lazy, loud discovery of plugins.

A plugin is a function ``register(hub)`` named in the entry-point group ``hpp_framework.plugins``. It adds
names to the registries of the hub it is given::

    def register(hub: Hub) -> None:
        hub.robots.add("rover", "my_package.rover:rover")

Plugins are loaded at the first look-up, never at import (:mod:`hpp_framework.plugins.discovery`). One that
cannot be loaded is kept in ``Hub.broken`` with its reason; all others work.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Generic, TypeVar, cast

from packaging.utils import canonicalize_name

from hpp_framework.utils.errors import PluginError, UnknownNameError, unknown_name
from hpp_framework.utils.versions import installed

T = TypeVar("T")

HERE = "this process"
"""Origin of what a program registers itself, without a plugin."""


@dataclass(frozen=True)
class BrokenPlugin:
    """A plugin that could not be loaded; nothing that it registers is known.

    Attributes:
        name: of its entry point.
        origin: distribution and version.
        reason: what went wrong and what to do, in whole sentences.
    """

    name: str
    origin: str
    reason: str

    @property
    def distribution(self) -> str:
        """Name of the distribution, without its version."""
        return self.origin.rpartition(" ")[0]


@dataclass(frozen=True)
class Entry(Generic[T]):
    """One registered name: where it came from and how to build it.

    Attributes:
        name: registered name.
        source: the factory, or ``"module:attribute"``.
        summary: what it is, for lists.
        origin: distribution and version, or :data:`HERE`.
    """

    name: str
    source: str | Callable[..., T]
    summary: str
    origin: str

    @property
    def distribution(self) -> str:
        """Name of the distribution without its version; empty for what this process registered itself."""
        return "" if self.origin == HERE else self.origin.rpartition(" ")[0]

    def factory(self) -> Callable[..., T]:
        """Import and return the callable behind this entry.

        Raises:
            PluginError: if a ``module:attribute`` source cannot be imported.
        """
        if callable(self.source):
            return self.source
        module_name, _, attribute = self.source.partition(":")
        try:
            return cast("Callable[..., T]", getattr(importlib.import_module(module_name), attribute))
        except Exception as error:
            raise PluginError(
                f"'{self.name}' from {self.origin} could not be loaded from '{self.source}': {error!r}."
            ) from error


class Registry(Generic[T]):
    """Names to factories of one kind of thing.

    A name is looked up as it is, or as ``"distribution/name"``, which tells apart what two distributions call
    the same.

    Args:
        kind: singular noun used in messages, e.g. ``"robot"``.
    """

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.broken: list[BrokenPlugin] = []
        self._entries: dict[str, Entry[T]] = {}
        self._clashes: dict[str, tuple[Entry[T], ...]] = {}
        self._origin = HERE

    def add(self, name: str, source: str | Callable[..., T], *, summary: str = "") -> None:
        """Register a factory, or a ``"module:attribute"`` string that is imported when first used.

        Raises:
            PluginError: if the name is taken (both origins are named) or malformed.
        """
        if not name or name != name.strip() or "," in name:
            raise PluginError(f"'{name}' is not a usable {self.kind} name: no spaces around it, no commas.")
        entry = Entry(name, source, summary, self._origin)
        if name in self._clashes or name in self._entries:
            taken = self._clashes.get(name) or (self._entries[name],)
            raise PluginError(_clash(self.kind, (*taken, entry)))
        self._entries[name] = entry

    def merge(self, other: Registry[T]) -> None:
        """Take over what another registry holds; a name that both hold belongs to neither from then on."""
        for entry in other:
            known = self._clashes.get(entry.name) or tuple(
                known for known in self._entries.values() if known.name == entry.name
            )
            if known:
                self._clashes[entry.name] = (*known, entry)
                self._entries.pop(entry.name, None)
            else:
                self._entries[entry.name] = entry

    def create(self, name: str, *args: Any, **kwargs: Any) -> T:
        """Build a fresh object by name.

        Raises:
            UnknownNameError: if nothing has that name; the nearest name is suggested.
            PluginError: if several distributions registered the name, or the entry cannot be imported.
        """
        return self.entry(name).factory()(*args, **kwargs)

    def entry(self, name: str) -> Entry[T]:
        """Return the entry of a name (see :meth:`create` for the errors)."""
        if name in self._clashes:
            raise PluginError(self.clash(name))
        found = self._entries.get(name) or self._of_distribution(name)
        if found is None:
            raise self._unknown(name)
        return found

    def __iter__(self) -> Iterator[Entry[T]]:
        return iter([self._entries[name] for name in sorted(self._entries)])

    def __contains__(self, name: object) -> bool:
        return name in self._entries or (isinstance(name, str) and self._of_distribution(name) is not None)

    def clashes(self) -> dict[str, tuple[Entry[T], ...]]:
        """Return the names that several distributions registered, with all their entries."""
        return {name: self._clashes[name] for name in sorted(self._clashes)}

    def clash(self, name: str) -> str:
        """Return what to say of a name that several distributions registered."""
        return _clash(self.kind, self._clashes[name])

    def set_origin(self, origin: str) -> None:
        """Name the distribution whose registrations follow (called while plugins load)."""
        self._origin = origin

    def _of_distribution(self, name: str) -> Entry[T] | None:
        everything = [*self._entries.values(), *(entry for same in self._clashes.values() for entry in same)]
        qualified = {
            f"{entry.distribution}/{entry.name}": entry for entry in everything if entry.distribution
        }
        return qualified.get(name)

    def _unknown(self, name: str) -> UnknownNameError:
        error = unknown_name(self.kind, name, self._entries)
        if self.broken:
            origins = ", ".join(plugin.origin for plugin in self.broken)
            return UnknownNameError(
                f"{error} It may belong to a plugin that could not be loaded: {origins}. 'hpp list' says why."
            )
        distribution, slash, _ = name.partition("/")
        if slash and self._brings_none(distribution):
            return UnknownNameError(
                f"{error} {distribution} is installed, but registers no {self.kind}: "
                f"'hpp check {distribution}' says what it does register, or why it registers nothing."
            )
        return error

    def _brings_none(self, distribution: str) -> bool:
        """Return whether a distribution is installed and has nothing in this registry."""
        if not distribution or installed((distribution,))[distribution] is None:
            return False
        wanted = canonicalize_name(distribution)
        clashing = (entry for same in self._clashes.values() for entry in same)
        return all(canonicalize_name(each.distribution) != wanted for each in (*self, *clashing))


def _clash(kind: str, entries: Sequence[Entry[Any]]) -> str:
    count = {2: "Two"}.get(len(entries), str(len(entries)))
    origins = ", ".join(f"one from {entry.origin}" for entry in entries)
    remedy = "Rename one or uninstall one of the two."
    apart = [f"'{entry.distribution}/{entry.name}'" for entry in entries if entry.distribution]
    if len(set(apart)) == len(entries):
        remedy = f"Write {' or '.join(apart)}, or uninstall one of them."
    return f"{count} {kind}s are called '{entries[0].name}': {origins}. {remedy}"


def _registry(kind: str) -> Any:
    return field(default_factory=lambda: Registry[Any](kind))


@dataclass(frozen=True)
class Hub:
    """All registries, one per noun of the design.

    Factories and their signatures:

    - ``robots``: ``() -> RobotSpec``
    - ``skills``: ``(robot: RobotSpec) -> Skill``
    - ``tasks``: ``(robots: Sequence[RobotSpec]) -> Task``; keyword parameters are settings
    - ``terms``: ``(robots: Sequence[RobotSpec]) -> Term``; keyword parameters are settings
    - ``worlds``: ``(rng: numpy.random.Generator) -> World``
    - ``planners``: ``(context: PlannerContext) -> MetaPlanner``
    - ``policies``: ``(context: PlannerContext) -> Policy``
    - ``layers``: ``(context: ControlContext) -> ControlLayer``
    - ``estimators``: ``(context: EstimatorContext) -> Estimator``
    - ``predictors``: ``(request: PredictorRequest) -> Predictor``
    - ``predictor_trainers``: ``(config: PredictorTraining) -> Path``
    - ``skill_trainers``: ``(config: SkillTraining) -> Path``
    - ``skill_searches``: ``() -> SkillSearch``, of the skill trainer of the same name
    - ``checkpoints``: ``() -> Path``, a folder of weights that predictors and policies search

    ``broken`` holds the plugins that could not be loaded.
    """

    robots: Registry[Any] = _registry("robot")
    skills: Registry[Any] = _registry("skill")
    tasks: Registry[Any] = _registry("task")
    terms: Registry[Any] = _registry("term")
    worlds: Registry[Any] = _registry("world")
    planners: Registry[Any] = _registry("planner")
    policies: Registry[Any] = _registry("policy")
    layers: Registry[Any] = _registry("layer")
    estimators: Registry[Any] = _registry("estimator")
    predictors: Registry[Any] = _registry("predictor")
    predictor_trainers: Registry[Any] = _registry("predictor trainer")
    skill_trainers: Registry[Any] = _registry("skill trainer")
    skill_searches: Registry[Any] = _registry("skill search")
    checkpoints: Registry[Any] = _registry("checkpoint folder")

    broken: list[BrokenPlugin] = field(default_factory=lambda: list[BrokenPlugin]())

    def __post_init__(self) -> None:
        for registry in self.registries().values():
            registry.broken = self.broken

    def registries(self) -> dict[str, Registry[Any]]:
        """Return the registries by attribute name."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return {name: value for name, value in values.items() if isinstance(value, Registry)}

    def set_origin(self, origin: str) -> None:
        """Name the distribution whose registrations follow, in every registry."""
        for registry in self.registries().values():
            registry.set_origin(origin)


@cache
def hub() -> Hub:
    """Return the hub with every installed plugin registered; loads them at the first call."""
    # discovery fills hubs, so it knows this module
    from hpp_framework.plugins.discovery import discover

    return discover()
