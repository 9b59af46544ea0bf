"""Writes a robot that was read off a URDF as a module of numbers, each with its source."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from hpp_framework.core.robot import Part, RobotSpec
from hpp_framework.onboarding.names import Name
from hpp_framework.onboarding.urdf.reading import Reading
from hpp_framework.onboarding.urdf.robot import read_answers, read_robot
from hpp_framework.testing.report import CheckError
from hpp_framework.testing.robot import check_robot
from hpp_framework.utils.errors import ConfigError

HEAD = '''"""A robot whose numbers were read off {file}; where each came from stands beside it."""

from __future__ import annotations

from hpp_framework.core.robot import DriveLimits, Lidar, Part, RobotSpec
'''


def module_of_urdf(name: Name, file: Path, answers: Path | None) -> dict[str, str]:
    """Return the module of a robot of a URDF, by its path in the package of that name.

    Raises:
        ConfigError: see :func:`~hpp_framework.onboarding.urdf.robot.robot_from_urdf`; also if there can be no
            such robot.
    """
    spec, reading = read_robot(file, name.thing, read_answers(answers) if answers else None)
    try:
        check_robot(spec)
    except CheckError as error:
        found = "\n".join(f"  {finding}" for finding in error.findings)
        raise ConfigError(
            f"there can be no such robot as '{file}' and the answers describe; nothing was written.\n"
            f"{found}\nAn answer (--answers FILE) goes before what the file says."
        ) from error
    path = f"{name.package_module}/{name.thing_module}.py"
    return {path: robot_module(spec, reading, factory=name.thing_module, file=file.name)}


def robot_module(spec: RobotSpec, reading: Reading, *, factory: str, file: str) -> str:
    """Return the source of a module with a robot.

    Args:
        spec: the robot.
        reading: where its numbers came from.
        factory: name of the function that returns it.
        file: name of the URDF.
    """
    parts = (_drive(spec, reading), _lidar(spec, reading), _parts(spec))
    blocks = ["\n".join(part) for part in parts]
    return "\n".join(
        [HEAD.format(file=file), "\n\n".join(blocks), "\n", *_factory(spec, reading, factory, file), ""]
    )


def _drive(spec: RobotSpec, reading: Reading) -> Iterator[str]:
    drive = spec.drive
    yield "DRIVE = DriveLimits("
    yield from _line(f"speed=({drive.speed[0]!r}, {drive.speed[1]!r})", reading, "reverse_speed", "speed")
    for name in ("turn_rate", "acceleration", "turn_acceleration"):
        yield from _line(f"{name}={getattr(drive, name)!r}", reading, name)
    yield ")"


def _lidar(spec: RobotSpec, reading: Reading) -> Iterator[str]:
    lidar = spec.lidar
    yield "LIDAR = Lidar("
    yield from _line(f"mount={lidar.mount!r}", reading, "lidar_x", "lidar_y", "lidar_yaw")
    yield from _line(f"height={lidar.height!r}", reading, "lidar_height")
    for name in ("beams", "field_of_view", "min_range", "max_range", "noise_std"):
        yield from _line(f"{name}={getattr(lidar, name)!r}", reading, name)
    yield ")"


def _parts(spec: RobotSpec) -> Iterator[str]:
    yield "PARTS = ("
    for part in spec.build_body():
        yield "    Part("
        yield f'        shape="{part.shape}",'
        yield from (f"        {name}={getattr(part, name)!r}," for name in _fields(part))
        yield "    ),"
    yield ")"
    yield '"""Its collision shapes, for pictures; for meshes the boxes around them."""'


def _fields(part: Part) -> Iterator[str]:
    yield from ("size", "position")
    if any(part.rotation):
        yield "rotation"
    yield "color"


def _factory(spec: RobotSpec, reading: Reading, factory: str, file: str) -> Iterator[str]:
    yield f"def {factory}() -> RobotSpec:"
    yield '    """Return the robot."""'
    yield "    return RobotSpec("
    yield f'        name="{spec.name}",'
    yield "        drive=DRIVE,"
    yield "        lidar=LIDAR,"
    for name in ("footprint_radius", "profile_radius", "height", "mass"):
        yield from _line(f"{name}={getattr(spec, name)!r}", reading, name, indent=8)
    yield "        body=body,"
    yield f'        sources=("{file}", "answers to what it does not say"),'
    yield "    )"
    yield ""
    yield ""
    yield "def body() -> tuple[Part, ...]:"
    yield '    """Return what it looks like."""'
    yield "    return PARTS"


def _line(code: str, reading: Reading, *names: str, indent: int = 4) -> Iterator[str]:
    """Give a line, after comments that say where its numbers came from."""
    space = " " * indent
    for source in dict.fromkeys(reading.sources[name] for name in names):
        which = ", ".join(name for name in names if reading.sources[name] == source)
        yield f"{space}# {which}: {source}" if len(names) > 1 else f"{space}# {source}"
    yield f"{space}{code},"
