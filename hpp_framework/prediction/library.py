"""Finds the weights of motion models and refuses those made for other robots, lidars or histories."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from torch import nn

from hpp_framework.core.predictor import PredictorRequest
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.team import Member, Team
from hpp_framework.perception.sensing import HISTORY
from hpp_framework.plugins.registry import hub
from hpp_framework.plugins.weights import find_weights, load_checkpoint, load_into, weight_folders
from hpp_framework.utils.errors import CheckpointError, ConfigError

STOP_GAP = "--set predictor=empty-world plans without weights, as if nothing stood in the way."


def file_name(agent: Member, subject: Member, *, own: bool) -> str:
    """Return the file name of the model by which ``agent`` predicts ``subject`` (or itself)."""
    return f"self-{agent.robot.name}" if own else f"other-{agent.robot.name}-{subject.robot.name}"


def find_members(team: Team, agent: int, subject: int) -> tuple[Member, Member]:
    """Return the predicting and the predicted robot.

    Raises:
        ConfigError: if the team has no such robots.
    """
    for name, place in (("agent", agent), ("subject", subject)):
        if not 0 <= place < len(team):
            raise ConfigError(f"--{name} {place}: the team has robots 0 to {len(team) - 1}.")
    return team.members[agent], team.members[subject]


def model_pairs(
    team: Team, agent: int | None = None, subject: int | None = None
) -> dict[str, tuple[int, int]]:
    """Return the models of a team: file name to (agent, subject); robots that are alike share theirs.

    Args:
        team: all robots.
        agent: only models of this robot.
        subject: only models that predict this robot.

    Raises:
        ConfigError: if the team has no such robots.
    """
    pairs: dict[str, tuple[int, int]] = {}
    for one in range(len(team)) if agent is None else [agent]:
        for other in range(len(team)) if subject is None else [subject]:
            name = file_name(*find_members(team, one, other), own=one == other)
            pairs.setdefault(name, (one, other))
    return pairs


def remedy(team: Team) -> str:
    """Return what to do about weights that a team lacks."""
    robots = ",".join(dict.fromkeys(member.robot.name for member in team.members))
    skills = ", ".join(
        dict.fromkeys(f"hpp onboard {member.skill} --with {robots}" for member in team.members)
    )
    return (
        "Motion models belong to robots and their skills: a new robot or skill needs models of its own. "
        f"One command makes all that a team of these needs: {skills}. Until then {STOP_GAP}"
    )


def skill_name(member: Member) -> str:
    """Return the name under which a member's skill is registered, however it was written."""
    return hub().skills.entry(member.skill).name if member.skill in hub().skills else member.skill


def find_model(kind: str, request: PredictorRequest, subject: int) -> Path:
    """Return the weights by which the agent of a request predicts a robot of its team.

    Raises:
        CheckpointError: if there are none, or they were made for something else.
    """
    agent, other, own = _members(request, subject)
    named = agent.weights.get(other.id)
    # a folder that is named for this pair must have them
    asked = (named,) if named else request.folders
    return find_weights(
        asked if named else weight_folders(asked), "predictor", kind, file_name(agent, other, own=own),
        remedy(request.team), expected=expected_metadata(kind, agent, other, own=own), asked=len(asked),
    )  # fmt: skip


def _members(request: PredictorRequest, subject: int) -> tuple[Member, Member, bool]:
    return *find_members(request.team, request.agent, subject), request.agent == subject


def expected_metadata(kind: str, agent: Member, subject: Member, *, own: bool) -> dict[str, Any]:
    """Return what weights must say of themselves to fit."""
    return {
        "predictor": kind,
        "role": "self" if own else "other",
        "agent": agent.robot.name,
        "agent_skill": skill_name(agent),
        "subject": subject.robot.name,
        "subject_skill": skill_name(subject),
        "beams": agent.robot.lidar.beams,
        "history": HISTORY,
    }


def load_models(
    kind: str, request: PredictorRequest, build: Callable[[RobotSpec], nn.Module]
) -> list[nn.Module]:
    """Load the model of every robot of a team, as seen by one agent.

    Args:
        kind: registered predictor name, also the folder name.
        request: who predicts whom.
        build: makes the empty network for the predicting agent's robot.

    Returns:
        One network per robot, in team order.

    Raises:
        ConfigError: if a folder of the request does not exist or has no weights of this kind.
        CheckpointError: if weights are missing or made for something else.
    """
    for folder in request.folders:
        _check_folder(folder, kind)
    models: list[nn.Module] = []
    for subject in range(len(request.team)):
        agent, other, own = _members(request, subject)
        file = find_model(kind, request, subject)
        weights, _ = load_checkpoint(file, expected_metadata(kind, agent, other, own=own))
        model = build(agent.robot)
        load_into(model, weights, file)
        models.append(model.eval())
    return models


def find_cards(kind: str, request: PredictorRequest) -> dict[str, dict[str, Any]]:
    """Return the cards of the models that one agent of a team uses, by file name.

    Kinds without weights have none.

    Args:
        kind: registered predictor name.
        request: who predicts whom.
    """
    found: dict[str, dict[str, Any]] = {}
    for subject in range(len(request.team)):
        with suppress(CheckpointError):
            file = find_model(kind, request, subject)
            found[file.stem] = load_checkpoint(file, {})[1]
    return found


def _check_folder(folder: Path, kind: str) -> None:
    """Refuse folders in which nothing can be found: shipped weights would silently take their place."""
    if not folder.is_dir():
        raise ConfigError(f"--weights '{folder}' is not a folder. Give the --out of 'hpp train predictor'.")
    # snapshots of unfinished trainings are no weights
    files = [file for file in folder.glob("*/*.safetensors") if not file.stem.endswith(".resume")]
    kinds = sorted({file.parent.name for file in files})
    if kind not in kinds:
        raise ConfigError(
            f"--weights '{folder}' has no weights of predictor '{kind}' ('{folder / kind}/*.safetensors'); "
            f"it has: {', '.join(kinds) or 'none'}. Give the --out of 'hpp train predictor {kind}'."
        )
