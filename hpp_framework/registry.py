"""One generic registry and the lazy, loud discovery of plugins.

A plugin is a function ``register(hub)`` named in the entry-point group ``hpp_framework.plugins``. It adds
names to the registries of the hub it is given::

    def register(hub: Hub) -> None:
        hub.robots.add("rover", "my_package.rover:rover")

Plugins are loaded at the first look-up, never at import.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar, cast

from hpp_framework.errors import PluginError, unknown_name

T = TypeVar("T")

PLUGIN_GROUP = "hpp_framework.plugins"


@dataclass(frozen=True)
class Entry(Generic[T]):
    """One registered name: where it came from and how to build it."""

    name: str
    source: str | Callable[..., T]
    summary: str
    origin: str

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

    Args:
        kind: singular noun used in messages, e.g. ``"robot"``.
    """

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self._entries: dict[str, Entry[T]] = {}
        self._origin = "this process"

    def add(self, name: str, source: str | Callable[..., T], *, summary: str = "") -> None:
        """Register a factory, or a ``"module:attribute"`` string that is imported when first used.

        Raises:
            PluginError: if the name is taken (both origins are named) or malformed.
        """
        if not name or name != name.strip() or "," in name:
            raise PluginError(f"'{name}' is not a usable {self.kind} name: no spaces around it, no commas.")
        if name in self._entries:
            raise PluginError(
                f"Two {self.kind}s are called '{name}': one from {self._entries[name].origin}, "
                f"one from {self._origin}. Rename one or uninstall one of the two."
            )
        self._entries[name] = Entry(name, source, summary, self._origin)

    def create(self, name: str, *args: Any, **kwargs: Any) -> T:
        """Build a fresh object by name.

        Raises:
            UnknownNameError: if nothing has that name; the nearest name is suggested.
            PluginError: if the entry cannot be imported.
        """
        return self.entry(name).factory()(*args, **kwargs)

    def entry(self, name: str) -> Entry[T]:
        """Return the entry of a name (see :meth:`create` for the errors)."""
        if name not in self._entries:
            raise unknown_name(self.kind, name, self._entries)
        return self._entries[name]

    def __iter__(self) -> Iterator[Entry[T]]:
        return iter([self._entries[name] for name in sorted(self._entries)])

    def __contains__(self, name: object) -> bool:
        return name in self._entries

    def set_origin(self, origin: str) -> None:
        """Name the distribution whose registrations follow (called while plugins load)."""
        self._origin = origin


def _registry(kind: str) -> Any:
    return field(default_factory=lambda: Registry[Any](kind))


@dataclass(frozen=True)
class Hub:
    """All registries, one a noun of the design.

    Factories and their signatures:

    - ``robots``: ``() -> RobotSpec``
    - ``skills``: ``(robot: RobotSpec) -> Skill``
    - ``tasks``: ``(robots: Sequence[RobotSpec]) -> Task``
    - ``worlds``: ``(rng: numpy.random.Generator) -> World``
    - ``planners``: ``(context: PlannerContext) -> MetaPlanner``
    - ``predictors``: ``(request: PredictorRequest) -> Predictor``
    - ``predictor_trainers``: ``(config: PredictorTraining) -> Path``
    - ``skill_trainers``: ``(config: SkillTraining) -> Path``
    - ``skill_searches``: ``() -> SkillSearch``, of the skill trainer of the same name
    - ``checkpoints``: ``() -> Path``, a folder of weights that predictors and policies search
    """

    robots: Registry[Any] = _registry("robot")
    skills: Registry[Any] = _registry("skill")
    tasks: Registry[Any] = _registry("task")
    worlds: Registry[Any] = _registry("world")
    planners: Registry[Any] = _registry("planner")
    predictors: Registry[Any] = _registry("predictor")
    predictor_trainers: Registry[Any] = _registry("predictor trainer")
    skill_trainers: Registry[Any] = _registry("skill trainer")
    skill_searches: Registry[Any] = _registry("skill search")
    checkpoints: Registry[Any] = _registry("checkpoint folder")

    def registries(self) -> dict[str, Registry[Any]]:
        """Return the registries by attribute name."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


def load_plugin(hub: Hub, point: EntryPoint) -> None:
    """Let one entry point register into a hub.

    Raises:
        PluginError: if it cannot be imported or its ``register`` fails; names the distribution.
    """
    origin = f"{point.dist.name} {point.dist.version}" if point.dist else point.value
    for registry in hub.registries().values():
        registry.set_origin(origin)
    try:
        point.load()(hub)
    except PluginError:
        raise
    except Exception as error:
        raise PluginError(
            f"The plugin '{point.name}' of {origin} failed to register: {error!r}. "
            f"Fix '{point.value}' or uninstall {origin}."
        ) from error


@cache
def hub() -> Hub:
    """Return the hub with every installed plugin registered; loads them at the first call."""
    loaded = Hub()
    for point in sorted(entry_points(group=PLUGIN_GROUP), key=lambda p: (p.name, p.value)):
        load_plugin(loaded, point)
    for registry in loaded.registries().values():
        registry.set_origin("this process")
    return loaded
