"""Run folders: what ``config.json`` records, and which command may write into which folder.

``config.json`` holds the experiment's own fields, ``command``, ``world_files`` (one digest per world file)
and ``task_file`` (its digest); these must be the same to resume. ``versions`` and ``planner_configs`` are
there to be read.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from hpp_framework.config.task_file import is_task_file
from hpp_framework.config.yaml_files import is_yaml
from hpp_framework.utils.errors import ConfigError, reason
from hpp_framework.utils.run_folder import RunFolder, differ, read_json
from hpp_framework.utils.versions import installed_versions
from hpp_framework.worlds.loader import load_world

CONFIG, EPISODES, SUMMARY = "config.json", "episodes.csv", "summary.json"
MARL_EVAL = "marl_eval.json"
RUN, EVALUATE, REHEARSE = "run", "evaluate", "robot rehearse"

ADDED: Mapping[str, Any] = {"settings": {}, "members": {}, "people": 0}
"""What experiments of older versions did not record, as they had it."""

CONTENTS = {"world_files": "contents of world files", "task_file": "contents of the task file"}
"""Digests, as messages call them."""

NOT_COMPARED = ("versions", "planner_configs")


def record(command: str, experiment: Mapping[str, Any], planner_configs: Mapping[str, Any]) -> dict[str, Any]:
    """Return what ``config.json`` holds.

    Args:
        command: ``"run"`` or ``"evaluate"``.
        experiment: its fields.
        planner_configs: effective parameters by planner, None where a planner has none.
    """
    content = {
        **experiment,
        "command": command,
        "world_files": digests(experiment["worlds"]),
        # those that judge skills or predictors have none
        "task_file": task_digest(experiment.get("task", "")),
        "versions": installed_versions(),
        "planner_configs": dict(planner_configs),
    }
    return json.loads(json.dumps(content, default=str))


def digests(worlds: Sequence[str]) -> dict[str, str]:
    """Return a digest of each world file, its meshes included; registered worlds have none.

    Raises:
        ConfigError: if a world file has a mistake.
    """
    found: dict[str, str] = {}
    for name in worlds:
        if is_yaml(name):
            files = [Path(name), *(mesh.file for mesh in load_world(Path(name)).meshes)]
            found[name] = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    return found


def task_digest(task: str) -> str | None:
    """Return a digest of a task file; registered tasks have none.

    Raises:
        ConfigError: if the file cannot be read.
    """
    if not is_task_file(task):
        return None
    try:
        return hashlib.sha256(Path(task.strip()).read_bytes()).hexdigest()
    except OSError as error:
        raise ConfigError(f"task file '{task}' cannot be read: {reason(error)}.") from error


def open_evaluation(out: Path, config: Mapping[str, Any]) -> None:
    """Create the folder of an evaluation, or check that it holds the same one.

    Args:
        out: run folder.
        config: from :func:`record`.

    Raises:
        ConfigError: if the folder holds something else, is damaged, or cannot be written to.
    """
    if (out / EPISODES).exists() and not (out / CONFIG).exists():
        raise ConfigError(
            f"'{out}' holds {EPISODES} but no {CONFIG} that says what of. Choose another --out."
        )
    RunFolder(out).claim(
        CONFIG, config, what="experiment", compare=partial(_differences, out),
        remedy="Choose another --out, or repeat the same options to resume it.",
    )  # fmt: skip


def _differences(out: Path, recorded: Mapping[str, Any], config: Mapping[str, Any]) -> str:
    """Return what keeps an evaluation from being resumed; what an older version left out cannot differ."""
    found = {**ADDED, **recorded}
    if found.get("command", EVALUATE) != config["command"]:
        raise ConfigError(f"'{out}' holds what `hpp {found['command']}` wrote. Choose another --out.")
    unknown = {"command", "world_files", "task_file"} - found.keys()
    compared = [key for key in config if key not in unknown and key not in NOT_COMPARED]
    return differ(CONTENTS.get(key, key) for key in compared if found.get(key) != config[key])


def open_run(out: Path, config: Mapping[str, Any]) -> None:
    """Create the folder of one filmed episode; an earlier one in it is replaced.

    Args:
        out: run folder.
        config: from :func:`record`.

    Raises:
        ConfigError: if the folder holds an evaluation, is damaged, or cannot be written to.
    """
    file = out / CONFIG
    evaluated = (out / EPISODES).exists()
    if evaluated or (file.exists() and read_json(file).get("command", RUN) != RUN):
        raise ConfigError(f"'{out}' holds what `hpp evaluate` wrote. Choose another --out.")
    RunFolder(out).write_record(CONFIG, config)


def read_config(file: Path, command: str) -> dict[str, Any]:
    """Read a ``config.json`` to repeat it.

    Args:
        file: a ``config.json``.
        command: that wants to repeat it.

    Raises:
        ConfigError: if it cannot be read, another command wrote it, or a world file has changed since.
    """
    found = read_json(file)
    if found.get("command", command) != command:
        raise ConfigError(f"'{file}' was written by `hpp {found['command']}`; repeat it with that command.")
    recorded = found.get("world_files", {})
    for name, digest in digests(list(recorded)).items():
        if digest != recorded[name]:
            raise ConfigError(
                f"world file '{name}' has changed since '{file}' was written, so it cannot be repeated. "
                "Restore the world file, or give the options without --config."
            )
    if task_digest(found.get("task", "")) != found.get("task_file"):
        raise ConfigError(
            f"task file '{found['task']}' has changed since '{file}' was written, so it cannot be repeated. "
            "Restore it, or give the options without --config."
        )
    return found
