"""Finds installed plugins and lets each register; a broken one does not take the others down.

A distribution says which versions of this framework it was built for as any distribution does, by what it
requires: ``dependencies = ["hpp-framework>=0.1,<0.2"]``. One that requires another version than the running
one is not even imported.
"""

from __future__ import annotations

from importlib.metadata import Distribution, EntryPoint, entry_points, version
from threading import RLock

from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name

from hpp_framework.plugins.registry import BrokenPlugin, Hub
from hpp_framework.utils.errors import PluginError

PLUGIN_GROUP = "hpp_framework.plugins"
FRAMEWORK = "hpp-framework"
VERSION = version(FRAMEWORK)

_lock = RLock()
_loading: list[str] = []


def discover() -> Hub:
    """Return a hub with what every installed plugin registers, and with those that could not be loaded.

    Raises:
        PluginError: if a plugin calls this while it registers.
    """
    with _lock:
        if _loading:
            raise PluginError(
                "hub() was called while plugins are being loaded. In register(hub), use the hub that is "
                "given; call hub() inside factories only, never when a module is imported."
            )
        hub = Hub()
        for point in sorted(entry_points(group=PLUGIN_GROUP), key=lambda p: (p.name, p.value)):
            _loading.append(point.name)
            try:
                _take(hub, point)
            finally:
                _loading.clear()
        return hub


def _take(hub: Hub, point: EntryPoint) -> None:
    """Let one plugin register, all or nothing."""
    try:
        registered = load_plugin(point)
    except PluginError as error:
        hub.broken.append(BrokenPlugin(point.name, _origin(point), str(error)))
        return
    for name, registry in registered.registries().items():
        hub.registries()[name].merge(registry)


def load_plugin(point: EntryPoint) -> Hub:
    """Let one plugin register into a hub of its own, and return that.

    Raises:
        PluginError: if it was built for another version of the framework, cannot be imported, or its
            ``register`` fails; names the distribution.
    """
    origin = _origin(point)
    if point.dist:
        _check_version(point.dist, origin)
    hub = Hub()
    hub.set_origin(origin)
    try:
        point.load()(hub)
    # a plugin's own sys.exit() must not end the program either
    except (Exception, SystemExit) as error:
        raise PluginError(
            f"The plugin '{point.name}' of {origin} failed to register: {error!r}. "
            f"Fix '{point.value}' or uninstall {origin}.{_version_hint(point.dist, error)}"
        ) from error
    return hub


def _origin(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else point.value


def _requirements(distribution: Distribution) -> list[Requirement]:
    """Return what a distribution requires of the framework here."""
    found: list[Requirement] = []
    for text in distribution.requires or ():
        try:
            requirement = Requirement(text)
        except InvalidRequirement:
            continue
        applies = requirement.marker is None or requirement.marker.evaluate({"extra": ""})
        if applies and canonicalize_name(requirement.name) == FRAMEWORK:
            found.append(requirement)
    return found


def _check_version(distribution: Distribution, origin: str) -> None:
    for requirement in _requirements(distribution):
        if not requirement.specifier.contains(VERSION, prereleases=True):
            raise PluginError(
                f"{origin} was built for {requirement}, but this is {FRAMEWORK} {VERSION}. Install a "
                f"version of {distribution.name} made for {VERSION}, or the {FRAMEWORK} that it asks for."
            )


def _version_hint(distribution: Distribution | None, error: BaseException) -> str:
    """Return a hint where a plugin misses something of the framework and does not say which one it needs."""
    silent = distribution is not None and not _requirements(distribution)
    if not silent or "hpp_framework" not in str(error):
        return ""
    return (
        f" It does not say which {FRAMEWORK} it was built for, maybe another than {VERSION}: its project "
        f'should have dependencies = ["{FRAMEWORK}>=X.Y,<X.Z"].'
    )
