"""Team files: a team in YAML, checked so that every mistake names file, key and remedy.

The format is described in ``docs/teams.md``. What a file says with all its defaults filled in, the effective
team, is plain data: run folders record it, and it is read like a file again.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, cast

from pydantic import AfterValidator, Field, model_validator

from hpp_framework.config.deployment import GateLimits, Topics
from hpp_framework.config.sensing_choice import parse_disturbances
from hpp_framework.config.yaml_files import FileModel, checked, is_yaml, read_yaml
from hpp_framework.core.team import Member, Team
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.builtin import DEFAULT_SKILL
from hpp_framework.plugins.registry import Registry, hub
from hpp_framework.utils.errors import HppError
from hpp_framework.utils.validation import LISTED, NonNegative, Text, filled, mistake, unknown

is_team_file = is_yaml


def _registered(noun: str) -> AfterValidator:
    """Return a check that something is registered under a name, settings behind a colon left aside."""

    def check(text: str) -> str:
        registry: Registry[Any] = getattr(hub(), noun)
        name = text.partition(":")[0]
        if name not in registry:
            known = sorted(entry.name for entry in registry)
            raise mistake(f"names no {registry.kind} that there is: '{name}'", unknown(name, known))
        return text

    return AfterValidator(check)


def _profile(text: str) -> str:
    try:
        parse_disturbances(text)
    except HppError as error:
        raise mistake(f"is wrong: {str(error).removesuffix('.')}", "") from error
    return text


def _folder(text: str, info: Any) -> str:  # a ValidationInfo, which beartype cannot check
    folder = (info.context / text).resolve()
    if not folder.is_dir():
        raise mistake(f"'{folder}' is not a folder", "Give the --out of 'hpp train predictor'.")
    return str(folder)


Robot = Annotated[Text, _registered("robots")]
Skill = Annotated[Text, _registered("skills")]
Planner = Annotated[Text, _registered("planners")]
Folder = Annotated[Text, AfterValidator(_folder)]


class Believed(FileModel):
    """What another robot is taken for: ``fetch``, or a mapping of robot and skill."""

    robot: Robot | None = None
    skill: Skill | None = None

    @model_validator(mode="before")
    @classmethod
    def _a_robot_alone(cls, value: Any) -> Any:
        return {"robot": value} if isinstance(value, str) else value


class Defaults(FileModel):
    """What a team may say for members that say nothing else."""

    skill: Skill | None = None
    planner: Planner | None = None
    control: Text | None = None
    disturbances: Annotated[Text, AfterValidator(_profile)] | None = None
    topics: Topics | None = None
    gate: GateLimits | None = None


class MemberEntry(Defaults):
    """One robot of a team file."""

    id: Text
    robot: Robot
    believes: dict[str, Believed] = Field(default_factory=dict)
    weights: dict[str, Folder] = Field(default_factory=dict)
    joins_at: NonNegative = 0.0
    leaves_at: NonNegative | None = None

    @model_validator(mode="after")
    def _leaves_later(self) -> MemberEntry:
        if self.leaves_at is not None and self.leaves_at <= self.joins_at:
            raise mistake(
                f"of {self.leaves_at:g} s is not after it joins, at {self.joins_at:g} s", "Make it later.",
                key="leaves_at",
            )  # fmt: skip
        return self


class TeamFile(Defaults):
    """A team file."""

    members: Annotated[
        tuple[MemberEntry, ...], LISTED, filled("List at least one: '- {id: alice, robot: fetch}'.")
    ]

    @model_validator(mode="after")
    def _ids_fit(self) -> TeamFile:
        ids = [member.id for member in self.members]
        for i, member in enumerate(self.members):
            if member.id in ids[:i]:
                raise mistake(
                    f"'{member.id}' is taken", "Give every robot of the team its own id.", f"members[{i}].id"
                )
            for part, named in (("believes", member.believes), ("weights", member.weights)):
                for name in named:
                    if name not in ids:
                        key = f"members[{i}].{part}.{name}"
                        raise mistake("is not the id of a member", unknown(name, ids), key)
            if member.id in member.believes and member.believes[member.id].robot is not None:
                raise mistake(
                    "is the robot itself, which knows its body",
                    "Write '{skill: ...}' for the skill that it takes itself to have.",
                    f"members[{i}].believes.{member.id}",
                )
        return self


def resolve_team(text: str, *, skill: str = DEFAULT_SKILL) -> Team:
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
    team = checked(TeamFile, content, file)
    shared = _said(team, content)
    members: list[dict[str, Any]] = []
    for member, entry in zip(team.members, cast("Any", content)["members"], strict=True):
        own = _said(member, entry)
        members.append({**shared, **own})
    return {"members": members}


def _said(checked_entry: Defaults, entry: Any) -> dict[str, Any]:
    """Return what a part of a team file says, without what it leaves out."""
    return checked_entry.model_dump(exclude_unset=True, exclude_none=True, exclude={"members"})


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
        control=entry.get("control"),
        believes=believes,
        weights=weights,
        disturbances=entry.get("disturbances"),
        **{name: entry[name] for name in ("joins_at", "leaves_at") if name in entry},
    )
