"""World files: the documented example, the rule for starts, and mistakes with clear messages."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError, UnknownNameError
from hpp_framework.worlds.loader import load_world, resolve_world
from hpp_framework.worlds.spawn import spawn_poses

ROOT = Path(__file__).parents[2]
BOUNDS = "bounds: [-5, -5, 5, 5]\n"


@pytest.fixture
def team():
    return [hub().robots.create("fetch"), hub().robots.create("freight")]


def write(folder: Path, text: str, name: str = "room.yaml") -> Path:
    file = folder / name
    file.write_text(text)
    return file


def documented_examples() -> list[str]:
    """Return the complete examples; those indented within a list of steps are parts of it."""
    page = (ROOT / "docs" / "worlds.md").read_text()
    return re.findall(r"^```yaml\n(.*?)^```", page, re.DOTALL | re.MULTILINE)


def test_complete_example_of_the_documentation_loads(tmp_path, team):
    trimesh.creation.box((0.5, 0.5, 2.0)).export(tmp_path / "pillar.stl")
    complete, fixed = documented_examples()
    world = load_world(write(tmp_path, complete), team)
    assert (world.name, len(world.boxes), len(world.cylinders), len(world.meshes)) == ("my room", 2, 1, 1)
    assert world.boxes[0].yaw == pytest.approx(math.pi / 2)
    assert world.boxes[1].base == 0.7
    assert world.meshes[0].file == tmp_path / "pillar.stl"
    assert world.meshes[0].yaw == pytest.approx(math.radians(30))
    assert world.spawn.center == (-1, -1, 1, 1)
    assert world.spawn.axis_spread == pytest.approx(math.radians(15))
    starts = load_world(write(tmp_path, fixed), team).spawn.poses
    assert starts == ((-2.5, 0, 0), (2.5, 0, math.pi))


def test_every_documented_key_of_the_loader_is_in_the_complete_example():
    from hpp_framework.worlds import loader

    complete = documented_examples()[0] + documented_examples()[1]
    for entry in (
        loader.WorldFile,
        loader.BoxEntry,
        loader.CylinderEntry,
        loader.MeshEntry,
        loader.PersonEntry,
        loader.MovingEntry,
        loader.SpawnEntry,
    ):
        assert all(f"{field.alias or key}:" in complete for key, field in entry.model_fields.items())


def test_shortest_file_takes_its_name_and_defaults_from_the_file(tmp_path):
    world = load_world(write(tmp_path, BOUNDS, "attic.yml"))
    assert world.name == "attic"
    assert world.walled
    assert world.spawn.distance == 5.0
    assert world.file == tmp_path / "attic.yml"


MISTAKES = {
    "unknown key": (BOUNDS + "boxs: []", "boxs", "Did you mean 'boxes'"),
    "unknown box key": (
        BOUNDS + "boxes: [{center: [0, 0], size: [1, 1], hieght: 2}]",
        "boxes[0].hieght",
        "'height'",
    ),
    "unknown spawn key": (BOUNDS + "spawn: {distence: 3}", "spawn.distence", "Did you mean 'distance'"),
    "number as key": (BOUNDS + "3: 4", "line 2, column 1: the key '3'", "put it in quotes"),
    "velocity of a cylinder": (
        BOUNDS + "cylinders: [{center: [0, 0], radius: 1, velocity: [1, 0]}]",
        "'cylinders[0].velocity' is not a key of an obstacle that stands",
        "under 'moving'",
    ),
    "speed of a box": (
        BOUNDS + "boxes: [{center: [0, 0], size: [1, 1], speed: 1}]",
        "'boxes[0].speed'",
        "under 'people'",
    ),
    "fewer than no people": (BOUNDS + "people: -1", "'people' must be from 0 to 1000", "a number of people"),
    "people as text": (BOUNDS + "people: many", "'people' must be a list", "Begin each entry"),
    "person out of bounds": (BOUNDS + "people: [{start: [9, 0]}]", "'people[0].start'", "widen 'bounds'"),
    "person with both": (
        BOUNDS + "people: [{waypoints: [[1, 1]], goal: [2, 2]}]",
        "'people[0]'",
        "remove one of the two",
    ),
    "unknown key of a person": (
        BOUNDS + "people: [{velocity: 1}]",
        "'people[0].velocity'",
        "Known here: start",
    ),
    "moving without a path": (
        BOUNDS + "moving: [{radius: 1}]",
        "'moving[0].path' is missing",
        "required here",
    ),
    "moving box and cylinder": (
        BOUNDS + "moving: [{radius: 1, size: [1, 1], path: [[0, 0, 0]]}]",
        "'moving[0]'",
        "not both",
    ),
    "times that go back": (
        BOUNDS + "moving: [{radius: 1, path: [[1, 0, 0], [0, 1, 0]]}]",
        "'moving[0]'",
        "increasing times",
    ),
    "number as text as key": (BOUNDS + "'3': 4", "'3' is not a known key", "Known here"),
    "no bounds": ("name: x", "bounds", "is missing"),
    "bounds of three": ("bounds: [0, 0, 5]", "bounds", "[x_min, y_min, x_max, y_max]"),
    "bounds swapped": ("bounds: [5, 5, -5, -5]", "bounds", "at least 1 m|each side from 1"),
    "bounds far too large": ("bounds: [0, 0, 9000, 9000]", "bounds", "200 m"),
    "bounds with NaN": ("bounds: [.nan, 0, 5, 5]", "bounds[0]", "finite"),
    "bounds with infinity": ("bounds: [0, 0, .inf, 5]", "bounds[2]", "finite"),
    "bounds with text": ("bounds: [0, 0, ten, 5]", "bounds[2]", "must be a number"),
    "number with a unit": (
        BOUNDS + "boxes: [{center: [0, 0], size: [1 m, 1]}]",
        "boxes[0].size[0]",
        "without a unit",
    ),
    "exponent read as text": (BOUNDS + "spawn: {clearance: 1e-1}", "spawn.clearance", "decimal point"),
    "truth value as number": (BOUNDS + "spawn: {distance: true}", "spawn.distance", "must be a number"),
    "walled in quotes": (BOUNDS + "walled: 'no'", "walled", "true or false"),
    "name with a slash": (BOUNDS + "name: a/b", "name", "Use letters"),
    "name a list": (BOUNDS + "name: [a]", "name", "must be text"),
    "boxes a mapping": (BOUNDS + "boxes: {center: [0, 0]}", "boxes", "must be a list"),
    "box a number": (BOUNDS + "boxes: [3]", "boxes[0]", "must be a mapping"),
    "box without size": (BOUNDS + "boxes: [{center: [0, 0]}]", "boxes[0].size", "is missing"),
    "negative size": (
        BOUNDS + "boxes: [{center: [0, 0], size: [1, -1]}]",
        "boxes[0].size[1]",
        "greater than 0",
    ),
    "negative base": (
        BOUNDS + "boxes: [{center: [0, 0], size: [1, 1], base: -1}]",
        "boxes[0].base",
        "at least 0",
    ),
    "zero height": (
        BOUNDS + "boxes: [{center: [0, 0], size: [1, 1], height: 0}]",
        "boxes[0].height",
        "greater than 0",
    ),
    "NaN yaw": (
        BOUNDS + "boxes: [{center: [0, 0], size: [1, 1], yaw_deg: .nan}]",
        "boxes[0].yaw_deg",
        "finite",
    ),
    "cylinder of no radius": (
        BOUNDS + "cylinders: [{center: [0, 0], radius: 0}]",
        "cylinders[0].radius",
        "greater",
    ),
    "cylinder with a size": (
        BOUNDS + "cylinders: [{center: [0, 0], size: 1}]",
        "cylinders[0].size",
        "Known here",
    ),
    "box out of bounds": (
        BOUNDS + "boxes: [{center: [9, 0], size: [1, 1]}]",
        "boxes[0].center",
        "outside the bounds",
    ),
    "cylinder out of bounds": (
        BOUNDS + "cylinders: [{center: [0, -9], radius: 1}]",
        "cylinders[0].center",
        "outside the bounds",
    ),
    "mesh without file": (BOUNDS + "meshes: [{scale: 1}]", "meshes[0].file", "is missing"),
    "mesh not there": (BOUNDS + "meshes: [{file: gone.stl}]", "meshes[0].file", "does not exist"),
    "mesh unreadable": (
        BOUNDS + "meshes: [{file: broken.stl}]",
        "meshes[0].file",
        "could not be read|no triangles",
    ),
    "mesh of unknown type": (BOUNDS + "meshes: [{file: notes.txt}]", "meshes[0].file", "could not be read"),
    "mesh without triangles": (BOUNDS + "meshes: [{file: points.ply}]", "meshes[0].file", "no triangles"),
    "mesh of no scale": (
        BOUNDS + "meshes: [{file: cube.stl, scale: 0}]",
        "meshes[0].scale",
        "greater than 0",
    ),
    "mesh out of bounds": (
        BOUNDS + "meshes: [{file: cube.stl, position: [20, 0, 0]}]",
        "meshes[0].position",
        "outside the bounds",
    ),
    "no free space": (
        BOUNDS + "boxes: [{center: [0, 0], size: [12, 12]}]",
        "spawn.clearance",
        "no free space",
    ),
    "spawn a list": (BOUNDS + "spawn: [1, 2]", "spawn", "must be a mapping"),
    "negative distance": (BOUNDS + "spawn: {distance: -5}", "spawn.distance", "greater than 0"),
    "negative clearance": (BOUNDS + "spawn: {clearance: -0.1}", "spawn.clearance", "at least 0"),
    "spawn center swapped": (BOUNDS + "spawn: {center: [1, 1, -1, -1]}", "spawn.center", "swapped"),
    "starts beside a rule": (BOUNDS + "spawn: {distance: 3, poses: [[0, 0, 0]]}", "spawn.distance", "no use"),
    "no starts": (BOUNDS + "spawn: {poses: []}", "spawn.poses", "is empty"),
    "start of two numbers": (BOUNDS + "spawn: {poses: [[0, 0]]}", "spawn.poses[0]", "heading_deg"),
    "too few starts": (BOUNDS + "spawn: {poses: [[0, 0, 0]]}", "spawn.poses", "1 starts for 2 robots"),
    "overlapping starts": (BOUNDS + "spawn: {poses: [[0, 0, 0], [0.3, 0, 0]]}", "spawn.poses[1]", "overlaps"),
    "start in an obstacle": (
        BOUNDS + "cylinders: [{center: [2, 0], radius: 1}]\nspawn: {poses: [[-2, 0, 0], [2, 0, 0]]}",
        "spawn.poses[1]",
        "from an obstacle",
    ),
    "start in a solid mesh": (
        BOUNDS + "meshes: [{file: cube.stl}]\nspawn: {poses: [[-3, 0, 0], [0, 0, 0]]}",
        "spawn.poses[1]",
        "from an obstacle",
    ),
    "start outside": (
        BOUNDS + "spawn: {poses: [[-2, 0, 0], [7, 0, 0]]}",
        "spawn.poses[1]",
        "from an obstacle or",
    ),
    "key twice": (BOUNDS + "name: a\nname: b", "line 3", "given twice"),
    "malformed": (BOUNDS + "boxes: [{center: [0, 0]", "line 3|line 2", "Mend the YAML"),
    "tab": (BOUNDS + "spawn:\n\tdistance: 3", "line 3", "Mend the YAML"),
    "python object": (BOUNDS + "name: !!python/object/apply:os.getcwd []", "line 2", "Mend the YAML"),
    "empty": ("", "is empty", "bounds"),
    "only a comment": ("# nothing\n", "is empty", "bounds"),
    "a list": ("- 1\n- 2\n", "mapping", "Keys"),
    "a control character": ("name: \x07", "is not YAML", "UTF-8"),
    "impossible date": (BOUNDS + "name: 2020-13-45", "not usable YAML", "Write plain"),
}


@pytest.mark.parametrize(("text", "where", "remedy"), MISTAKES.values(), ids=MISTAKES.keys())
def test_mistake_names_file_key_and_remedy(tmp_path, team, text, where, remedy):
    (tmp_path / "broken.stl").write_bytes(b"\x00\x01not a mesh")
    (tmp_path / "notes.txt").write_text("hello")
    trimesh.PointCloud(np.eye(3)).export(tmp_path / "points.ply")
    trimesh.creation.box((2.0, 2.0, 2.0)).export(tmp_path / "cube.stl")
    file = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load_world(file, team)
    message = str(caught.value)
    assert message.startswith(str(file))
    assert any(part in message for part in where.split("|")), message
    assert any(part in message for part in remedy.split("|")), message
    assert message.endswith(".")


def test_missing_file_folder_and_binary_file_are_clear(tmp_path):
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x80")
    for name, part in (
        ("gone.yaml", "no such file"),
        ("folder.yaml", "cannot be read"),
        ("binary.yaml", "UTF-8"),
    ):
        with pytest.raises(ConfigError, match=part):
            load_world(tmp_path / name)


def test_resolve_world_takes_names_and_files(tmp_path):
    rng = np.random.default_rng(0)
    assert resolve_world("simple")(rng).name == "simple"
    file = write(tmp_path, BOUNDS)
    factory = resolve_world(str(file))
    assert factory(rng) == factory(rng)
    with pytest.raises(UnknownNameError, match=r"Did you mean 'simple'.*\.yaml"):
        resolve_world("simpel")


def test_fixed_starts_are_given_in_team_order(tmp_path, team):
    world = load_world(write(tmp_path, BOUNDS + "spawn: {poses: [[-2, 0, 90], [2, 1, 180], [0, 3, 0]]}"))
    poses = spawn_poses(world, team, np.random.default_rng(0))
    np.testing.assert_allclose(poses, [[-2, 0, math.pi / 2], [2, 1, math.pi]])


def test_crowded_rule_names_file_and_remedy(tmp_path, team):
    world = load_world(write(tmp_path, "bounds: [0, 0, 3, 3]"))
    with pytest.raises(ConfigError, match=r"room\.yaml: 'spawn' finds no room for 2 robots"):
        spawn_poses(world, team, np.random.default_rng(0))
