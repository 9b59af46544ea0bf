"""``hpp new``: write a plugin package to start from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True, kw_only=True)
class NewTask:
    """Write a package with a task: all robots meet at one place that all know."""

    name: Annotated[str, tyro.conf.Positional]
    """PACKAGE/NAME, e.g. my-pkg/meet-at-door; or PACKAGE alone."""
    out: Path = Path()
    """Folder to write the package's own folder into."""

    def run(self) -> None:
        """Write it and say what comes next."""
        _write("task", self.name, self.out)


@dataclass(frozen=True, kw_only=True)
class NewSkill:
    """Write a package with a skill: a classical one that slows down before obstacles."""

    name: Annotated[str, tyro.conf.Positional]
    """PACKAGE/NAME, e.g. my-pkg/cautious; or PACKAGE alone."""
    out: Path = Path()
    """Folder to write the package's own folder into."""

    def run(self) -> None:
        """Write it and say what comes next."""
        _write("skill", self.name, self.out)


@dataclass(frozen=True, kw_only=True)
class NewLayer:
    """Write a package with a control layer: it limits a robot's speed near its teammates."""

    name: Annotated[str, tyro.conf.Positional]
    """PACKAGE/NAME, e.g. my-pkg/cautious; or PACKAGE alone."""
    out: Path = Path()
    """Folder to write the package's own folder into."""

    def run(self) -> None:
        """Write it and say what comes next."""
        _write("layer", self.name, self.out)


@dataclass(frozen=True, kw_only=True)
class NewRobot:
    """Write a package with a robot: an example's numbers to replace by hand, or those of a URDF."""

    name: Annotated[str, tyro.conf.Positional]
    """PACKAGE/NAME, e.g. my-pkg/rover; or PACKAGE alone."""
    urdf: Path | None = None
    """URDF to read footprint, wheels, lidar pose and mass off; what it does not say is asked for."""
    answers: Path | None = None
    """YAML file of numbers that the URDF does not say, or that go before its own."""
    out: Path = Path()
    """Folder to write the package's own folder into."""

    def run(self) -> None:
        """Write it and say what comes next."""
        from hpp_framework.onboarding.names import parse_name
        from hpp_framework.onboarding.scaffold import THINGS
        from hpp_framework.onboarding.urdf.module import module_of_urdf
        from hpp_framework.utils.errors import ConfigError

        if self.urdf is None and self.answers is not None:
            raise ConfigError("--answers adds to what a URDF says; give --urdf too, or leave it out.")
        replaced = (
            None
            if self.urdf is None
            else module_of_urdf(parse_name(self.name, THINGS["robot"]), self.urdf, self.answers)
        )
        _write("robot", self.name, self.out, replaced)


@dataclass(frozen=True)
class New:
    """Write a plugin package to start from: an entry point, a working example, tests, the next commands."""

    what: Annotated[
        Annotated[NewTask, tyro.conf.subcommand("task")]
        | Annotated[NewSkill, tyro.conf.subcommand("skill")]
        | Annotated[NewLayer, tyro.conf.subcommand("layer")]
        | Annotated[NewRobot, tyro.conf.subcommand("robot")],
        tyro.conf.arg(name=""),
    ]

    def run(self) -> None:
        """Write what was named."""
        self.what.run()


def _write(kind: str, text: str, out: Path, replaced: Mapping[str, str] | None = None) -> None:
    from hpp_framework.onboarding.names import parse_name
    from hpp_framework.onboarding.scaffold import THINGS, write_package

    name = parse_name(text, THINGS[kind])
    folder = out / name.package
    for file in write_package(kind, name, folder, replaced=replaced):
        print(file)
    print(f"\nNext, and more in {folder / 'README.md'}:\n  cd {folder}\n  pip install -e '.[test]'\n  pytest")
