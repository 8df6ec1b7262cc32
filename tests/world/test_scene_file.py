"""Scene files: every faulty value is refused with its place and a sentence, all at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from picktree.files import FileError, PicktreeError
from picktree.world import Box, ConvexMesh, Cylinder, Pose, Sphere, heap_geometry
from picktree.world.scene import load_scene, parse_scene
from picktree.world.scene.scene_loading import scene_names

SCENE = """\
picktree: 1
kind: scene
robot: panda
fixtures:
  table: {box: [1.2, 1.6, 0.04], at: [0.5, 0, -0.02]}
  bin_a: {bin: [0.25, 0.20, 0.10], wall: 5 mm, at: [0.4, 0.5, 0], yaw: 90 deg}
cameras:
  top: {at: [0.5, 0, 0.8], look_at: [0.5, 0, 0]}
catalogue:
  block: {box: [4 cm, 4 cm, 4 cm], mass: 0.1, friction: 0.6}
  can: {cylinder: {radius: 2 cm, height: 8 cm}, mass: 120 g, friction: 0.5, force_limit: 60 N}
  ball: {sphere: {radius: 20 mm}, mass: 50 g, friction: 0.6}
  plate: {plate: [6 cm, 4 cm, 8 mm], mass: 50 g, friction: 0.6}
spawn:
  - {of: {block: 2, can: 1}, colours: [red, blue], area: {min: [0.3, -0.2], max: [0.6, 0.2]}, lying: 0.5}
destinations:
  - {where: "colour == 'red'", to: bin_a}
limits: {force: 50 N}
"""
HERE = Path("scene.yaml")


def faults(text: str, path: Path = HERE) -> str:
    with pytest.raises(FileError) as caught:
        parse_scene(text, path)
    return str(caught.value)


def test_a_tote_is_a_container_from_which_items_are_taken() -> None:
    tote = "  bin_b: {tote: [0.37, 0.27, 0.12], wall: 4 mm, at: [0.5, -0.5, 0], yaw: 90 deg}\n"
    scene = parse_scene(SCENE.replace("cameras:", tote + "cameras:"), HERE)
    regions = heap_geometry.heap_regions(scene)
    assert [(b.id, b.is_tote) for b in scene.bins] == [("bin_a", False), ("bin_b", True)]
    assert list(regions) == ["bin_b"] and regions["bin_b"].rim == 0.12
    low, high = scene.bins[1].inside()
    assert low == pytest.approx((-0.181, -0.131, 0.004)) and high == pytest.approx((0.181, 0.131, 0.12))


def test_a_scene_is_read() -> None:
    scene = parse_scene(SCENE, HERE)
    (table,), (bin_a,), (camera,) = scene.fixtures, scene.bins, scene.cameras
    assert (scene.name, scene.robot, scene.source, scene.text) == ("scene", "panda", "scene.yaml", SCENE)
    assert (table.id, table.shape, table.pose) == ("table", Box((1.2, 1.6, 0.04)), Pose((0.5, 0, -0.02)))
    assert (bin_a.size, bin_a.wall) == ((0.25, 0.2, 0.1), 0.005)
    assert bin_a.pose.angle(Pose()) == pytest.approx(np.pi / 2)
    assert (camera.size, camera.depth_noise, camera.error) == ((320, 240), 0.002, Pose())
    shapes = [entry.shape for entry in scene.catalogue]
    assert shapes[:3] == [Box((0.04, 0.04, 0.04)), Cylinder(0.02, 0.08), Sphere(0.02)]
    assert [entry.form for entry in scene.catalogue] == ["box", "cylinder", "sphere", "plate"]
    assert scene.entry("can").force_limit == 60.0
    (spawn,) = scene.spawn
    assert (spawn.counts, spawn.lying, spawn.gap) == ({"block": 2, "can": 1}, 0.5, 0.025)
    assert (scene.limits.force, scene.thinking.image, scene.checkpoint_every) == (50.0, 0.06, 4)


REPLACED = {  # by the text that is replaced and the one in its place; more faults: tests/check/faulty
    "robot: panda": {
        "robot: my/robot.yaml": "3:8: robot: there is no robot file my/robot.yaml",
        "robot: [panda]": "3:8: robot: a text is wanted, not a list",
    },
    "robot: panda\n": {"": "1:1: 'robot' is missing"},
    "limits:": {"limit:": "18:1: limit: unknown key 'limit' (did you mean 'limits'?)"},
    "limits: {force: 50 N}": {
        "limits: {workspace: {min: [0, 0, 2]}}": (
            "18:21: limits.workspace: the workspace is empty: "
            "'max' must be greater than 'min' along x, y and z"
        ),
        "limits: 3": "18:9: limits: a mapping is wanted, not 3",
        "feed: 3": "18:7: feed: a list is wanted, not 3",
        "goal: sort >= total": "18:7: goal: unknown name 'sort' (did you mean 'sorted'?)",
        "thinking: {image: -60 ms}": "18:19: thinking.image: -60 ms is negative (a time is 0 or more here)",
        "sensors: {encoder: .nan}": "18:20: sensors.encoder: nan is not a finite number",
    },
    "mass: 0.1": {
        "mass: 0": "10:42: catalogue.block.mass: 0 kg is not positive",
        "mass: heavy": "10:42: catalogue.block.mass: 'heavy' is not a mass (as 100 g)",
        "mass: [1]": "10:42: catalogue.block.mass: a list is not a number in kg",
    },
    "[4 cm, 4 cm, 4 cm]": {
        "[4 cm, .nan, -4 cm]": (
            "10:23: catalogue.block.box[1]: nan is not a finite number\n"
            "10:29: catalogue.block.box[2]: -4 cm is less than 0.1 cm"
        ),
    },
    "box: [4 cm, 4 cm, 4 cm], ": {
        "": "10:3: catalogue.block: 'box', 'cylinder', 'sphere', 'plate' or 'mesh' is missing",
    },
    "{radius: 20 mm}": {
        "{diameter: 20 mm}": (
            "12:10: catalogue.ball.sphere: 'radius' is missing\n"
            "12:19: catalogue.ball.sphere.diameter: unknown key 'diameter' (known: radius)"
        ),
    },
    "[6 cm, 4 cm, 8 mm]": {
        "[6 cm, 4 cm, 2 cm]": (
            "13:18: catalogue.plate.plate: a plate is flat "
            "(its height, the third number, is at most a third of the shorter side; else it is a box)"
        ),
    },
    "  plate: {": {
        "  unknown: {": (
            "13:3: catalogue.unknown: the name 'unknown' is taken (the word means an item that fits no kind)"
        ),
    },
    "wall: 5 mm, ": {
        "": "6:3: fixtures.bin_a: 'wall' is missing (the thickness of the bin's walls, as 5 mm)",
    },
    "{bin: [0.25, 0.20, 0.10], wall: 5 mm,": {
        "{tote: [0.37, 0.27, 0.12],": (
            "6:3: fixtures.bin_a: 'wall' is missing (the thickness of the tote's walls, as 5 mm)"
        ),
        "{tote: [0.25, 0.20, 0.10], wall: 15 cm,": (
            "6:43: fixtures.bin_a.wall: walls of 15 cm leave no room inside ('tote' is the outside)"
        ),
    },
    "  table: {box: [1.2, 1.6, 0.04], at: [0.5, 0, -0.02]}": {
        "  table: 3": "5:10: fixtures.table: a mapping is wanted, not 3",
    },
    "at: [0.5, 0, -0.02]}": {
        "at: [0.5, 0, -0.02], wall: 1}": "5:55: fixtures.table.wall: only a bin or tote has walls",
    },
    "  bin_a: {bin": {
        "  gripper: {bin": (
            "6:3: fixtures.gripper: the name 'gripper' is taken "
            "(no body may be called arm, gripper, hand, aside)\n"
            "17:36: destinations[0].to: there is no bin 'bin_a' (known: gripper)"
        ),
    },
    "look_at: [0.5, 0, 0]}": {
        "look_at: [0.5, 0, 0], up: [0, 0, 2]}": (
            "8:54: cameras.top.up: 'up' lies along the line of sight (name what is up in the picture)"
        ),
        "look_at: [0.5, 0, 0], size: [320, 8], fov: 200 deg, near: 4, edge_dropout: 2}": (
            "8:62: cameras.top.size[1]: at least 16 is wanted, not 8\n"
            "8:71: cameras.top.fov: 200 deg is more than 150 deg\n"
            "8:86: cameras.top.near: 'near' (4 m) is not less than 'far' (3 m)\n"
            "8:103: cameras.top.edge_dropout: 2 is more than 1"
        ),
    },
    "{block: 2, can: 1}": {
        "{block: two}": "15:18: spawn[0].of.block: a whole number is wanted, not 'two'",
        "{}": "15:10: spawn[0].of: at least 1 is wanted, not 0",
    },
    "[red, blue]": {
        "[rde]": "15:40: spawn[0].colours[0]: 'rde' is no colour that an item may have (did you mean 'red'?)",
    },
    "max: [0.6, 0.2]": {
        "max: [0.2, 0.2]": (
            "15:58: spawn[0].area: the area is empty: 'max' must be greater than 'min' along x and y"
        ),
        "max: [0.6, 3]": (
            "15:58: spawn[0].area: the area is outside the workspace (which is x -0.5 … 1 m, y -1 … 1 m)\n"
            "15:58: spawn[0].area: the area is not over a level fixture (items need a table below them)"
        ),
    },
    "lying: 0.5": {
        "touching: true, tumbled: true": (
            "15:95: spawn[0].touching: 'touching' and 'tumbled' exclude each other: "
            "dropped items come to rest anywhere (give one of them)"
        ),
    },
    "colour == 'red'": {
        "colour == 'rde'": "17:24: destinations[0].where: this is never 'rde' (did you mean 'red'?)",
        "colour == 'red' and colour == 'blue'": (
            "17:13: destinations[0].where: "
            "no item can fulfil this (check the colour, form and kind that it asks for)"
        ),
        "'red'": "17:14: destinations[0].where: true or false is wanted, not a text",
        "colour < 3": "17:21: destinations[0].where: '<' does not work on a text and a whole number",
    },
}


@pytest.mark.parametrize(("old", "new"), [(old, new) for old, table in REPLACED.items() for new in table])
def test_a_faulty_value_is_refused_with_its_place(old: str, new: str) -> None:
    assert SCENE.count(old) == 1, old
    expected = "\n".join(f"scene.yaml:{line}" for line in REPLACED[old][new].split("\n"))
    assert faults(SCENE.replace(old, new)) == expected


def test_faults_of_all_sections_come_at_once_and_only_once() -> None:
    text = SCENE.replace("box: [1.2, 1.6, 0.04]", "box: [1.2, 1.6]").replace("mass: 0.1", "mass: -1")
    text = text.replace("{block: 2, can: 1}", "{block: 2, kan: 1}").replace("to: bin_a", "to: bin_b")
    assert faults(text.replace("robot: panda", "robot: 7").replace("fov", "fow")) == "\n".join(
        [
            "scene.yaml:3:8: robot: a text is wanted, not 7 (quote it)",
            "scene.yaml:5:16: fixtures.table.box: 3 values are wanted, not 2",
            "scene.yaml:10:42: catalogue.block.mass: -1 kg is negative (a mass is positive here)",
            "scene.yaml:15:21: spawn[0].of.kan: the catalogue has no 'kan' (did you mean 'can'?)",
            "scene.yaml:17:36: destinations[0].to: there is no bin 'bin_b' (did you mean 'bin_a'?)",
        ]
    )


@pytest.mark.parametrize("section", ["fixtures", "cameras", "catalogue"])
def test_a_section_that_is_no_mapping(section: str) -> None:
    text = "picktree: 1\nkind: scene\nrobot: panda\n" + f"{section}: [1]\n"
    assert (
        faults(text)
        == f"scene.yaml:4:{len(section) + 3}: {section}: a mapping from names is wanted, not a list"
    )


def test_the_camera_looks_where_it_should() -> None:
    camera = parse_scene(SCENE, HERE).cameras[0]
    right, down, forward = camera.pose.rotation().T
    np.testing.assert_allclose(forward, [0, 0, -1], atol=1e-12)
    # Looking straight down, the world's x is up in the picture.
    np.testing.assert_allclose(down, [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(right, [0, -1, 0], atol=1e-12)
    tilted = SCENE.replace("look_at: [0.5, 0, 0]}", "look_at: [1, 0, 0.3], error: {rpy: [0, 0, 1 deg]}}")
    camera = parse_scene(tilted, HERE).cameras[0]
    right, down, forward = camera.pose.rotation().T
    np.testing.assert_allclose(forward, np.array([1, 0, -1]) / np.sqrt(2), atol=1e-12)
    assert down[2] < 0
    np.testing.assert_allclose(np.cross(right, down), forward, atol=1e-12)
    assert camera.error.angle(Pose()) == pytest.approx(np.pi / 180)


def with_mesh(tmp_path: Path, name: str, extra: str = "") -> tuple[str, Path]:
    text = SCENE.replace("box: [4 cm, 4 cm, 4 cm]", f"mesh: {{file: {name}{extra}}}")
    return text, tmp_path / "scene.yaml"


def test_a_mesh_becomes_its_hull_about_its_centre(tmp_path: Path) -> None:
    cone = trimesh.creation.cone(radius=20, height=40, sections=16)
    cone.apply_translation([100, 50, 7])
    cone.export(tmp_path / "cone.stl")
    shape = parse_scene(*with_mesh(tmp_path, "cone.stl", ", scale: 0.001")).entry("block").shape
    assert isinstance(shape, ConvexMesh)
    points = np.array(shape.vertices)
    # The centre of mass of a cone is a quarter of its height above the base.
    assert points[:, 2].min() == pytest.approx(-0.010, abs=1e-5)
    assert points[:, 2].max() == pytest.approx(0.030, abs=1e-5)
    assert np.abs(points[:, :2]).max() == pytest.approx(0.020, abs=1e-5)
    assert shape.source == str(tmp_path / "cone.stl")


OPEN = (
    "the mesh is not closed: some of its edges do not belong to two faces "
    "(close the mesh, or replace it by its convex hull, which has 6.0 cm³)"
)


@pytest.mark.parametrize(
    ("size", "faces", "message"),
    [
        ((0.03, 0.02, 0.01), 10, OPEN),
        ((0.03, 0.02, 0.0), 12, "the mesh is flat: it encloses no volume"),
        ((30, 20, 10), 12, "the mesh is 30 m large (is the mesh in millimetres? then add 'scale: 0.001')"),
    ],
)
def test_meshes_that_are_refused(
    tmp_path: Path, size: tuple[float, float, float], faces: int, message: str
) -> None:
    """More of them: `test_mesh_reader`."""
    whole = trimesh.creation.box(size)
    trimesh.Trimesh(whole.vertices, whole.faces[:faces]).export(tmp_path / "part.obj")
    found = faults(*with_mesh(tmp_path, "part.obj"))
    assert found == f"{tmp_path}/scene.yaml:10:17: catalogue.block.mesh: {message}"


def test_a_scene_on_a_base_keeps_the_places_of_both_files(tmp_path: Path) -> None:
    (tmp_path / "below.yaml").write_text(SCENE.replace("mass: 0.1", "mass: -0.1"))
    own = "picktree: 1\nkind: scene\nbase: below\ncameras:\n  top: {fov: x}\nspawn: null\n"
    assert faults(own, tmp_path / "own.yaml") == (
        f"{tmp_path}/below.yaml:10:42: catalogue.block.mass: -0.1 kg is negative (a mass is positive here)\n"
        f"{tmp_path}/own.yaml:5:14: cameras.top.fov: 'x' is not an angle (as 5 deg)"
    )
    (tmp_path / "below.yaml").write_text(SCENE)
    scene = parse_scene(own.replace("x}", "70 deg}"), tmp_path / "own.yaml")
    assert (scene.name, scene.spawn) == ("own", ())
    assert scene.cameras[0].fov == pytest.approx(np.radians(70))
    again = parse_scene(scene.text, tmp_path / "own.yaml")
    assert again == scene


def test_bases_that_cannot_be_read(tmp_path: Path) -> None:
    own = tmp_path / "own.yaml"
    own.write_text("picktree: 1\nkind: scene\nbase: own.yaml\n")
    with pytest.raises(FileError) as caught:
        load_scene(str(own))
    assert str(caught.value) == f"{own}:3:7: base: more than 5 scenes are based on one another"
    text = "picktree: 1\nkind: scene\nbase: three_bin\n"
    assert faults(text) == "scene.yaml:3:7: base: unknown scene 'three_bin' (did you mean 'three_bins'?)"


def test_scenes_are_found_by_name_and_path(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(SCENE)
    mission = tmp_path / "mission.yaml"
    assert load_scene("mine", mission).name == "mine"
    assert load_scene("mine.yaml", mission) == load_scene(str(tmp_path / "mine.yaml"))
    assert load_scene("three_bins", mission).source.endswith("scenes/three_bins.yaml")
    for name, message in [
        ("three_bin", "unknown scene 'three_bin' (did you mean 'three_bins'?)"),
        ("other.yaml", f"there is no scene file {tmp_path}/other.yaml"),
        ("", "'' is not the name of a scene"),
    ]:
        with pytest.raises(PicktreeError) as caught:
            load_scene(name, mission)
        assert str(caught.value) == message


@pytest.mark.parametrize("name", scene_names())
def test_shipped_scenes_are_read_and_their_logged_text_gives_them_again(name: str) -> None:
    scene = load_scene(name)
    assert parse_scene(scene.text, Path(scene.source)) == scene
    loads = (*scene.spawn, *(delivery.load for delivery in scene.deliveries))
    assert all(load.number > 0 for load in loads)
    assert (sum(load.number for load in loads) > 0) is (name != "calibrating")
    heaped = name in ("tote", "totes", "tote_of_items", "pile", "packed") or name.startswith("bin_to_bin")
    assert (scene.assortment is not None) == heaped
    forms = {scene.entry(kind).form for load in loads for kind in load.counts if kind != "assortment"}
    assert ("mesh" in forms) == name.startswith(("three_bins", "continuous", "belt", "parts"))


def test_a_shipped_camera_may_hang_elsewhere_than_believed() -> None:
    true, off = load_scene("three_bins").cameras[0], load_scene("three_bins_camera_off_8mm").cameras[0]
    assert (off.pose, off.fov) == (true.pose, true.fov)
    assert off.error == Pose((0.008, 0.008, 0.008))
