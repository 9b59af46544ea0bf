"""Team files: a team in YAML, checked so that every mistake names file, key and remedy.

The format is described in ``docs/teams.md``. What a file says with all its defaults filled in, the effective
team, is plain data: run folders record it, and it is read like a file again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from hpp_framework.config.fields import Source, read_yaml
from hpp_framework.core.disturbances import NoiseModel
from hpp_framework.core.team import Member, Team
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import Registry, hub
from hpp_framework.utils.errors import ConfigError, suggest

SUFFIXES = (".yaml", ".yml")

_DEFAULTS = ("skill", "planner", "noise")
"""Keys of the whole team that hold for members that say nothing else."""
_TEAM = (*_DEFAULTS, "members")
_TIMES = ("joins_at", "leaves_at")
_MEMBER = ("id", "robot", *_DEFAULTS, "believes", "weights", *_TIMES)
_BELIEVED = ("robot", "skill")
_NOISE = tuple(each.name for each in fields(NoiseModel))


def is_team_file(text: str) -> bool:
    """Return whether a team is named by its file."""
    return text.strip().lower().endswith(SUFFIXES)


def resolve_team(text: str, *, skill: str = "p2p") -> Team:
    """Return the team of a file, or of text like ``"fetch,freight"``.

    Args:
        text: a path that ends in ``.yaml`` or ``.yml``, or what
            :func:`~hpp_framework.plugins.build.parse_team` reads.
        skill: registered skill of every robot for which a file names none.

    Raises:
        ConfigError: if the file or the text has a mistake.
    """
    if is_team_file(text):
        return build_team(read_team_file(Path(text.strip())), skill=skill)
    return parse_team(text, skill=skill)


def read_team_file(file: Path) -> dict[str, Any]:
    """Return the effective team of a file.

    Raises:
        ConfigError: if anything in the file is wrong; names the file, the key and the remedy.
    """
    return effective_team(read_yaml(file, kind="team", least="members: [{id: alice, robot: fetch}]"), file)


def effective_team(content: object, file: Path) -> dict[str, Any]:
    """Check the content of a team file and fill in its defaults.

    Args:
        content: as YAML or JSON has it.
        file: that it is from, for messages; folders of weights in it are relative to the file's.

    Raises:
        ConfigError: if anything is wrong.
    """
    source = Source(file)
    team = source.mapping("", content, _TEAM, required=("members",))
    defaults = {key: team[key] for key in _DEFAULTS if key in team}
    noise = _noise(source, "noise", defaults.pop("noise", {}))
    entries = source.items("members", team["members"])
    if not entries:
        raise source.error("members", "is empty", "List at least one: '- {id: alice, robot: fetch}'.")
    ids = _ids(source, entries)
    return {
        "members": [
            _member(source, f"members[{i}]", {**defaults, **entry}, ids, noise)
            for i, entry in enumerate(entries)
        ]
    }


def build_team(content: Mapping[str, Any], *, skill: str) -> Team:
    """Return the team that an effective team describes.

    Args:
        content: from :func:`effective_team`.
        skill: registered skill of members that name none.
    """
    hub().skills.entry(skill)
    plain = {
        entry["id"]: Member(
            id=entry["id"], robot=hub().robots.create(entry["robot"]), skill=entry.get("skill", skill)
        )
        for entry in content["members"]
    }
    return Team(tuple(_build_member(entry, plain, skill) for entry in content["members"]))


def _build_member(entry: Mapping[str, Any], plain: Mapping[str, Member], skill: str) -> Member:
    weights = {id_: Path(folder) for id_, folder in entry.get("weights", {}).items()}
    believes = {
        id_: Member(
            id=id_,
            robot=hub().robots.create(taken["robot"]) if "robot" in taken else plain[id_].robot,
            skill=taken.get("skill", plain[id_].skill),
            weights=weights if id_ == entry["id"] else {},
        )
        for id_, taken in entry.get("believes", {}).items()
    }
    return Member(
        id=entry["id"],
        robot=plain[entry["id"]].robot,
        skill=entry.get("skill", skill),
        planner=entry.get("planner"),
        believes=believes,
        weights=weights,
        noise=entry.get("noise", {}),
        **{name: entry[name] for name in _TIMES if name in entry},
    )


def _ids(source: Source, entries: list[Any]) -> list[str]:
    """Return the members' ids, all different."""
    ids: list[str] = []
    for i, entry in enumerate(entries):
        key = f"members[{i}]"
        found = source.mapping(key, entry, _MEMBER, required=("id", "robot"))
        id_ = source.text(f"{key}.id", found["id"])
        if id_ in ids:
            raise source.error(f"{key}.id", f"'{id_}' is taken", "Give every robot of the team its own id.")
        ids.append(id_)
    return ids


def _member(
    source: Source, key: str, entry: dict[str, Any], ids: list[str], noise: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the checked entry of one member; what it leaves to the command is left out."""
    found: dict[str, Any] = {
        "id": source.text(f"{key}.id", entry["id"]),
        "robot": _registered(source, f"{key}.robot", entry["robot"], hub().robots),
    }
    if "skill" in entry:
        found["skill"] = _registered(source, f"{key}.skill", entry["skill"], hub().skills)
    if "planner" in entry:
        text = source.text(f"{key}.planner", entry["planner"])
        _registered(source, f"{key}.planner", text.partition(":")[0], hub().planners)
        found["planner"] = text
    if "believes" in entry:
        found["believes"] = {
            id_: _believed(source, f"{key}.believes.{id_}", taken)
            for id_, taken in _by_id(source, f"{key}.believes", entry["believes"], ids).items()
        }
        if "robot" in found["believes"].get(found["id"], {}):
            raise source.error(
                f"{key}.believes.{found['id']}",
                "is the robot itself, which knows its body",
                "Write '{skill: ...}' for the skill that it takes itself to have.",
            )
    if "weights" in entry:
        found["weights"] = {
            id_: _folder(source, f"{key}.weights.{id_}", folder)
            for id_, folder in _by_id(source, f"{key}.weights", entry["weights"], ids).items()
        }
    if own := {**noise, **_noise(source, f"{key}.noise", entry.get("noise", {}))}:
        found["noise"] = own
    return {**found, **_times(source, key, entry)}


def _noise(source: Source, key: str, value: object) -> dict[str, Any]:
    """Return what a noise model is told, by name."""
    found = source.mapping(key, value, _NOISE)
    for name, each in found.items():
        if name == "scan_std" and each is None:
            continue
        source.number(f"{key}.{name}", each, low=0)
        if name == "delay" and not isinstance(each, int):
            raise source.error(f"{key}.delay", f"counts control steps, got {each}", "Write a whole number.")
    try:
        NoiseModel(**found)
    except ConfigError as error:
        raise source.error(key, f"is wrong: {str(error).rstrip('.')}", "Mend the number.") from error
    return found


def _times(source: Source, key: str, entry: Mapping[str, Any]) -> dict[str, float]:
    """Return when a member joins and leaves, in seconds; what is not said is left out."""
    found = {name: source.number(f"{key}.{name}", entry[name], low=0) for name in _TIMES if name in entry}
    leaves, joins = found.get("leaves_at"), found.get("joins_at", 0.0)
    if leaves is not None and leaves <= joins:
        raise source.error(
            f"{key}.leaves_at", f"of {leaves:g} s is not after it joins, at {joins:g} s", "Make it later."
        )
    return found


def _believed(source: Source, key: str, value: object) -> dict[str, str]:
    """Return what another robot is taken for: ``fetch``, or a mapping of robot and skill."""
    taken = source.mapping(key, {"robot": value} if isinstance(value, str) else value, _BELIEVED)
    return {
        name: _registered(source, f"{key}.{name}", each, getattr(hub(), f"{name}s"))
        for name, each in taken.items()
    }


def _by_id(source: Source, key: str, value: object, ids: list[str]) -> dict[str, Any]:
    """Return a mapping whose keys are ids of members."""
    return source.mapping(key, value, ids)


def _folder(source: Source, key: str, value: object) -> str:
    folder = (source.file.parent / source.text(key, value)).resolve()
    if not folder.is_dir():
        raise source.error(key, f"'{folder}' is not a folder", "Give the --out of 'hpp train predictor'.")
    return str(folder)


def _registered(source: Source, key: str, value: object, registry: Registry[Any]) -> str:
    """Return a name that something is registered under."""
    name = source.text(key, value)
    if name not in registry:
        known = sorted(entry.name for entry in registry)
        hint = suggest(name, known).strip()
        raise source.error(
            key,
            f"names no {registry.kind} that there is: '{name}'",
            f"{hint} Known: {', '.join(known)}.".strip(),
        )
    return name
