"""Episodes as files: one compressed NumPy archive with everything that is needed to look at them again.

The archive holds no pickles and needs no other file: the world is in it as it is drawn, robots as numbers.
``header`` is JSON; the other arrays are named after the fields of
:class:`~hpp_framework.viz.record.EpisodeRecord`, those of an agent begin with its place in the team.
Lengths are rounded to 1/1024 m, which halves the file.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from hpp_framework.core.robot import DriveLimits, Lidar, RobotSpec
from hpp_framework.utils.errors import ConfigError, reason
from hpp_framework.utils.run_folder import ROOM, replacing
from hpp_framework.viz.floor_plan import FloorPlan
from hpp_framework.viz.record import AgentRecord, EpisodeRecord, Plan

FILE = "episode.npz"
KIND = "hpp episode"
FORMAT = 1
GRAIN = 1024.0
"""Parts of a metre (and of a radian) that are kept."""

Arrays = dict[str, np.ndarray]

_OPTIONAL = ("people", "moving")
"""Arrays that are left out where nothing moved but robots."""
_GROUND = ("boxes", "boxes_touched", "discs", "discs_touched", "lines")
_AGENT = ("seen", "scans", "goals", "resting")
_PLAN = ("goal", "mean", "std", "candidates", "scores", "paths", "times")


def save_record(file: Path, record: EpisodeRecord) -> Path:
    """Write an episode, completely or not at all.

    Args:
        file: ends in ``.npz``; an earlier one is replaced. Its folder is made if need be.
        record: the episode.

    Raises:
        ConfigError: if the file cannot be written.
    """
    arrays: Arrays = {"poses": record.poses}
    arrays |= {name: getattr(record, name) for name in _OPTIONAL if getattr(record, name) is not None}
    arrays |= {f"ground.{name}": getattr(record.ground, name) for name in _GROUND}
    arrays |= {f"ground.outline.{i}": outline for i, outline in enumerate(record.ground.outlines)}
    for i, agent in enumerate(record.agents):
        arrays |= {f"{i}.{name}": getattr(agent, name) for name in _AGENT}
        for k, plan in enumerate(agent.plans):
            arrays |= {f"{i}.plan.{k}.{name}": getattr(plan, name) for name in _PLAN}
    header = {
        "kind": KIND, "format": FORMAT, "about": record.about, "period": record.period,
        "bounds": record.ground.bounds, "outlines": len(record.ground.outlines),
        "agents": [
            {"id": agent.id, "robot": _robot(agent.robot), "plan_steps": [plan.step for plan in agent.plans]}
            for agent in record.agents
        ],
    }  # fmt: skip
    text = np.frombuffer(json.dumps(header).encode(), np.uint8)
    rounded: dict[str, Any] = {name: _rounded(array) for name, array in arrays.items()}
    failed = f"episode '{file}' could not be written"
    with replacing(file, failed=failed, remedy=ROOM) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, header=text, **rounded)
    return file


def load_record(place: Path) -> EpisodeRecord:
    """Read an episode.

    Args:
        place: the file, or a run folder that holds ``episode.npz``.

    Raises:
        ConfigError: if there is no such file, or it is damaged, no episode, or of another format.
    """
    file = place / FILE if place.is_dir() else place
    if not file.is_file():
        raise ConfigError(
            f"there is no episode '{file}'. Give {FILE} as `hpp run` wrote it, or the folder that holds it."
        )
    arrays = _read(file)
    header = _header(file, arrays)
    try:
        return _build(header, arrays)
    except (KeyError, TypeError, ValueError, IndexError, ConfigError) as error:
        raise _damaged(file, f"{type(error).__name__}: {error}") from error


def _read(file: Path) -> Arrays:
    try:
        with np.load(file, allow_pickle=False) as archive:
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise _foreign(file)
            arrays: dict[str, Any] = {name: archive[name] for name in archive.files}
    except OSError as error:
        raise ConfigError(f"cannot read '{file}': {reason(error)}.") from error
    except (ValueError, TypeError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError) as error:
        if zipfile.is_zipfile(file) or file.read_bytes()[:2] == b"PK":
            raise _damaged(file, str(error)) from error
        raise _foreign(file) from error
    if not all(isinstance(array, np.ndarray) for array in arrays.values()):
        raise _foreign(file)
    return arrays


def _header(file: Path, arrays: Arrays) -> dict[str, Any]:
    try:
        header: Any = json.loads(arrays["header"].tobytes())
    except (KeyError, ValueError) as error:
        raise _foreign(file) from error
    if not isinstance(header, dict) or header.get("kind") != KIND:
        raise _foreign(file)
    if header.get("format") != FORMAT:
        raise ConfigError(
            f"'{file}' has format {header.get('format')!r}, but this version reads {FORMAT}. Make the "
            "episode again, or use the version that wrote it."
        )
    return header


def _build(header: Mapping[str, Any], arrays: Arrays) -> EpisodeRecord:
    x_min, y_min, x_max, y_max = map(float, header["bounds"])
    ground = FloorPlan(
        bounds=(x_min, y_min, x_max, y_max),
        outlines=tuple(arrays[f"ground.outline.{i}"] for i in range(header["outlines"])),
        **{name: arrays[f"ground.{name}"] for name in _GROUND},
    )
    agents = tuple(_agent(i, about, arrays) for i, about in enumerate(header["agents"]))
    record = EpisodeRecord(
        about=dict(header["about"]), period=float(header["period"]), ground=ground, poses=arrays["poses"],
        agents=agents, **{name: arrays.get(name) for name in _OPTIONAL},
    )  # fmt: skip
    _check(record)
    return record


def _agent(number: int, about: Mapping[str, Any], arrays: Arrays) -> AgentRecord:
    plans = tuple(
        Plan(step=int(step), **{name: arrays[f"{number}.plan.{k}.{name}"] for name in _PLAN})
        for k, step in enumerate(about["plan_steps"])
    )
    own = {name: arrays[f"{number}.{name}"] for name in _AGENT}
    return AgentRecord(id=str(about["id"]), robot=_spec(about["robot"]), plans=plans, **own)


def _check(record: EpisodeRecord) -> None:
    """Raise ``ValueError`` unless all shapes fit each other."""
    steps, count = len(record.poses), len(record.agents)
    if record.poses.shape != (steps, count, 3) or not steps or not count or record.period <= 0:
        raise ValueError(f"poses of shape {record.poses.shape} for {count} robots")
    for name, rest in (("people", (4,)), ("moving", (2,))):
        found = getattr(record, name)
        if found is not None and (len(found) != steps or found.shape[-1:] != rest):
            raise ValueError(f"{name} of shape {found.shape} in {steps} steps")
    for agent in record.agents:
        beams = agent.robot.lidar.beams
        shapes = [agent.seen.shape, agent.scans.shape, agent.goals.shape, agent.resting.shape]
        if shapes != [(steps, count, 3), (steps, beams), (steps, 2), (steps,)]:
            raise ValueError(f"robot '{agent.id}' has arrays of shapes {shapes}")
        for plan in agent.plans:
            g, t = len(plan.candidates), len(plan.times)
            shapes = [plan.goal.shape, plan.candidates.shape, plan.scores.shape, plan.paths.shape]
            if shapes != [(2,), (g, 2), (g,), (g, t, count, 2)] or not 0 <= plan.step < steps:
                raise ValueError(f"a plan of robot '{agent.id}' has arrays of shapes {shapes}")


def _robot(robot: RobotSpec) -> dict[str, Any]:
    nested = ("body", "drive", "lidar")
    plain = {each.name: getattr(robot, each.name) for each in fields(robot) if each.name not in nested}
    return {**plain, "drive": asdict(robot.drive), "lidar": asdict(robot.lidar)}


def _spec(about: Mapping[str, Any]) -> RobotSpec:
    drive, lidar = dict(about["drive"]), dict(about["lidar"])
    drive["speed"], lidar["mount"] = tuple(drive["speed"]), tuple(lidar["mount"])
    rest = {name: value for name, value in about.items() if name not in ("drive", "lidar", "sources")}
    return RobotSpec(
        drive=DriveLimits(**drive), lidar=Lidar(**lidar), sources=tuple(about["sources"]), **rest
    )


def _rounded(values: np.ndarray) -> np.ndarray:
    if values.dtype.kind != "f":
        return values
    return (np.round(values.astype(np.float64) * GRAIN) / GRAIN).astype(np.float32)


def _damaged(file: Path, reason: str) -> ConfigError:
    return ConfigError(f"'{file}' is damaged ({reason}). Make the episode again, or copy the file again.")


def _foreign(file: Path) -> ConfigError:
    remedy = f"Give {FILE} as `hpp run` wrote it, or the folder that holds it."
    return ConfigError(f"'{file}' is no episode. {remedy}")
