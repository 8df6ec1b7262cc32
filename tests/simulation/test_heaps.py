"""Heaps in physics: things of an assortment in a tote, in a pile, packed; broken meshes and overflow are
refused."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.robot.perception import PosedCamera
from picktree.robot.perception.heap_mapping import map_heaps
from picktree.robot.perception.segmentation import SegmentationInput
from picktree.simulation import Sticker, distance, footprint, spawn_items
from picktree.simulation.heap_spawning import mesh_files, read_thing, upright_turn
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware, RenderedImage
from picktree.simulation.physics.bodies import inertia
from picktree.simulation.physics.rgbd_camera import draw_tag
from picktree.world import CompoundMesh, ConvexMesh, ObjectId, Pose, Sphere, bottom, heap_geometry, top
from picktree.world.robot_model import load_robot
from picktree.world.scene import (
    Assortment,
    CameraDescription,
    CatalogueEntry,
    SceneDescription,
    load_scene,
    parse_scene,
)
from picktree.world.scene.description import Destination

CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 20) for y in (0, 20) for z in (0, 20))
FACES = "f 1 2 3 4\nf 5 6 7 8\nf 1 5 2 6\n"


def tote(number: int = 6, meshes: str = "random_urdfs") -> SceneDescription:
    scene = load_scene("tote")
    (spawn,) = scene.spawn
    assert scene.assortment is not None
    assortment = replace(scene.assortment, meshes=meshes)
    return replace(scene, spawn=(replace(spawn, counts={"assortment": number}),), assortment=assortment)


def thing(tmp_path: Path, text: str, density: float = 1000.0):
    file = tmp_path / "thing.obj"
    file.write_text(text)
    return read_thing(file, Assortment(str(tmp_path), 1e-3, density, 0.5, 0.0))


def test_a_thing_has_the_mass_centre_and_inertia_of_its_parts(tmp_path: Path):
    found = thing(tmp_path, "o part\n" + CUBE + FACES)
    assert found.entry.mass == pytest.approx(0.008)
    assert inertia(found.entry.shape, 1.0) == pytest.approx((0.02**2 / 6,) * 3)
    assert np.abs(np.array(found.entry.shape.vertices)).max() == pytest.approx(0.01)  # type: ignore[union-attr]


def test_two_parts_of_a_thing_are_weighed_apart(tmp_path: Path):
    second = "".join(f"v {x} {y} {z}\n" for x in (60, 80) for y in (0, 20) for z in (0, 20))
    other = "f 9 10 11 12\nf 13 14 15 16\nf 9 13 10 14\n"
    found = thing(tmp_path, "o a\n" + CUBE + FACES + "o b\n" + second + other)
    assert found.entry.mass == pytest.approx(0.016)
    shape = found.entry.shape
    assert isinstance(shape, CompoundMesh) and len(shape.parts) == 2
    # The origin is the centre of mass, in the middle between both.
    assert sorted(x for x, _, _ in shape.parts[0]) == pytest.approx([-0.04] * 4 + [-0.02] * 4)
    far = 0.02**2 / 12 + 0.03**2
    assert inertia(shape, 1.0) == pytest.approx((0.02**2 / 6, far + 0.02**2 / 12, far + 0.02**2 / 12))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            CUBE.replace("v 20 20 20", "v nan 20 20") + FACES,
            "the mesh has 1 of 8 vertices that are not finite numbers; export it anew",
        ),
        (CUBE.replace("20\n", "0\n") + FACES, "the mesh is broken: a part has no volume"),
        (CUBE.replace("20\n", "1\n") + FACES, "the mesh is 1.0 mm thick; at least 2 mm are wanted"),
        ("v 1 2\nf 1 2 3\n", "the mesh file is damaged, or of another format than its name says"),
        ("v 1 2 3\n", "the mesh has no triangles; convert it anew to OBJ"),
    ],
)
def test_a_broken_mesh_is_refused_with_a_sentence(tmp_path: Path, text: str, words: str):
    with pytest.raises(PicktreeError) as caught:
        thing(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 'thing.obj'}: {words}")


def test_the_shipped_set_has_a_thing_without_finite_vertices_which_is_never_drawn():
    broken = next(file for file in mesh_files("random_urdfs") if file.stem == "168")
    with pytest.raises(PicktreeError, match="not finite numbers"):
        read_thing(broken, Assortment("random_urdfs", 0.01, 1000.0, 0.5, 0.0))
    drawn = spawn_items(tote(200), 1)
    sources = [item.entry.shape.source for item in drawn if isinstance(item.entry.shape, ConvexMesh)]
    assert len(drawn) == 200 == len(set(sources))
    assert all(item.entry.mass >= 0.03 for item in drawn) and not any("168" in name for name in sources)


def test_a_heap_is_drawn_from_the_seed_alone():
    assert spawn_items(tote(), 3) == spawn_items(tote(), 3)
    assert spawn_items(tote(), 3) != spawn_items(tote(), 4)


def test_poured_things_come_to_rest_in_their_tote_fall_asleep_and_continue_from_a_checkpoint():
    scene, robot = tote(), load_robot("panda")
    hardware = PhysicsHardware(scene, robot, 2)
    low, high = scene.bins[0].inside()
    for body in hardware.truth():
        at = scene.bins[0].pose.inverse().apply(np.array(body.pose.position))
        assert low[0] < at[0] < high[0] and low[1] < at[1] < high[1] and 0.0 < at[2] < high[2]
    for _ in range(720):
        hardware.step()
    saved = hardware.checkpoint()
    assert all(item.asleep for item in saved.items)
    resumed = PhysicsHardware.resume(scene, robot, 2, saved)
    for each in (hardware, resumed):
        each.remove("item_00")
        for _ in range(60):
            each.step()
    assert hardware.truth() == resumed.truth()


def test_a_tote_that_overflows_is_refused():
    scene = tote(20)
    small = tuple(replace(each, size=(0.19, 0.14, 0.04)) if each.is_tote else each for each in scene.bins)
    scene = replace(scene, bins=small)
    with pytest.raises(PicktreeError, match=r"spawn\[0\]: tote overflows: \d+ of 20 items do not stay in it"):
        PhysicsHardware(scene, load_robot("panda"), 1)


def test_a_heap_without_physics_is_refused():
    with pytest.raises(PicktreeError, match="needs physics"):
        KinematicHardware(tote(), load_robot("panda"), 1)


def on_table(drop: str, number: int = 6) -> SceneDescription:
    scene = load_scene("pile" if drop == "pile" else "packed")
    (spawn,) = scene.spawn
    return replace(scene, spawn=(replace(spawn, counts={"assortment": number}),))


def test_a_pile_lies_together_and_nothing_holds_it_when_the_run_begins():
    scene = on_table("pile", 10)
    narrow = replace(scene.spawn[0], area=((0.44, -0.06), (0.56, 0.06)))
    scene = replace(scene, spawn=(narrow,))
    hardware = PhysicsHardware(scene, load_robot("panda"), 2)
    bodies = hardware.truth()
    (region,) = heap_geometry.heap_regions(scene).values()
    assert region.id == "table" and region.size == pytest.approx((0.24, 0.24))
    assert region.covers(np.array([body.pose.position for body in bodies])).all()
    assert max(float(np.linalg.norm(body.velocity)) for body in bodies) < 0.01
    outlines = [footprint(b.shape, b.pose.orientation).at(b.pose.position) for b in bodies]
    assert any(distance(a, b) <= 0.0 for a, b in itertools.combinations(outlines, 2)), "things lie crosswise"
    outermost = max(bodies, key=lambda body: body.pose.position[0]).id
    hardware.bump(outermost, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for _ in range(240):
        hardware.step()
    gone = next(body for body in hardware.truth() if body.id == outermost)
    assert gone.pose.position[0] > 0.58, "no wall is left about the area"


def test_packed_things_stand_apart_on_a_face_that_carries_them():
    scene = on_table("packed", 8)
    items = spawn_items(scene, 4)
    outlines = [footprint(i.entry.shape, i.pose.orientation).at(i.pose.position) for i in items]
    apart = [distance(a, b) for a, b in itertools.combinations(outlines, 2)]
    assert 0.005 <= min(apart) < 0.05
    hardware = PhysicsHardware(scene, load_robot("panda"), 4)
    for item, body in zip(items, hardware.truth(), strict=True):
        assert bottom(item.entry.shape, item.pose) == pytest.approx(0.0, abs=1e-9)
        assert body.pose.angle(item.pose) < math.radians(10.0), f"{item.id} has toppled"


@pytest.mark.parametrize(("depth", "height"), [(30, 90), (4, 4)])
def test_a_thing_stands_on_the_face_that_makes_it_tallest_unless_it_would_topple(
    tmp_path: Path, depth: int, height: int
):
    plate = "".join(f"v {x} {y} {z}\n" for x in (0, depth) for y in (0, 60) for z in (0, 90))
    shape = thing(tmp_path, "o part\n" + plate + FACES).entry.shape
    pose = Pose(orientation=upright_turn(shape))
    assert 1000 * (top(shape, pose) - bottom(shape, pose)) == pytest.approx(height, abs=0.01)


def test_a_pile_that_rolls_apart_is_refused():
    scene = load_scene("pile")
    ball = CatalogueEntry("ball", "sphere", Sphere(0.02), 0.1, 0.5)
    (spawn,) = scene.spawn
    many = replace(spawn, counts={"ball": 90})
    scene = replace(scene, catalogue=(ball,), spawn=(many,))
    words = r"spawn\[0\]: \d+ of 90 items roll or slide out of the area with its rim of 60 mm"
    with pytest.raises(PicktreeError, match=words):
        PhysicsHardware(scene, load_robot("panda"), 1)


def test_a_thing_has_tags_on_the_faces_that_carry_one(tmp_path: Path):
    plate = "".join(f"v {x} {y} {z}\n" for x in (0, 10) for y in (0, 40) for z in (0, 60))
    (tmp_path / "thing.obj").write_text("o part\n" + plate + FACES)
    given = Assortment(str(tmp_path), 1e-3, 1000.0, 0.5, tags=(7,), tag_size=0.02)
    stickers = read_thing(tmp_path / "thing.obj", given).stickers
    assert len(stickers.poses) == 2 and stickers.size == 0.02
    assert sorted(round(1000 * pose.position[0], 6) for pose in stickers.poses) == [-5.0, 5.0]
    for pose in stickers.poses:
        outwards = pose.rotation()[:, 2]
        assert outwards * np.sign(pose.position[0]) == pytest.approx((1.0, 0.0, 0.0))
        assert np.array(pose.position[1:]) == pytest.approx((0.0, 0.0), abs=1e-9)


def tagged(number: int, turn: float, height: float = 0.0) -> tuple[RenderedImage, CameraDescription]:
    """Return a picture from above of a red plate with a tag, 0.85 m away."""
    camera = CameraDescription("top", look_down(0.85), size=(640, 480), fov=math.radians(36.0))
    colour = np.zeros((480, 640, 3), np.uint8)
    colour[:] = (180, 30, 30)
    picture = RenderedImage(colour, np.full((480, 640), np.float32(0.85)))
    pose = Pose((0.02, -0.03, height), (0.0, 0.0, math.sin(turn / 2), math.cos(turn / 2)))
    draw_tag(picture, camera.pose, camera.intrinsics, Sticker(number, 0.02, pose))
    return picture, camera


def look_down(height: float) -> Pose:
    return Pose.from_rotation((0.0, 0.0, height), np.diag((1.0, -1.0, -1.0)))


@pytest.mark.parametrize("turn", [0.4, 2.8])
@pytest.mark.parametrize("number", [0, 41])
def test_a_tag_is_read_where_it_is(number: int, turn: float):
    picture, camera = tagged(number, turn)
    sight = PosedCamera.at(camera.intrinsics, camera.pose)
    depth = picture.depth.astype(np.float64)
    empty = np.zeros(depth.shape, np.uint8)
    seen = SegmentationInput(sight, depth, depth, empty, empty > 0, empty.astype(np.int32), [])
    scene = replace(load_scene("pile"), destinations=(Destination("tag == 3", ObjectId("red_bin")),))
    spawn = replace(scene.spawn[0], area=((-0.05, -0.05), (0.05, 0.05)))
    scene = replace(scene, spawn=(spawn,))
    (heap,) = map_heaps(seen, empty > 0, scene, picture.colour).values()
    (tag,) = heap.tags
    assert tag.number == number
    assert heap.frame.apply(np.array([*tag.at, 0.0]))[:2] == pytest.approx((0.02, -0.03), abs=0.001)
    nobody_asks = replace(scene, destinations=())
    (heap,) = map_heaps(seen, empty > 0, nobody_asks, picture.colour).values()
    assert heap.tags == ()


def test_a_tag_that_something_hides_is_not_drawn():
    plain, _ = tagged(3, 0.0, height=-0.01)
    assert (plain.colour == (180, 30, 30)).all()
    shown, _ = tagged(3, 0.0)
    assert not (shown.colour == (180, 30, 30)).all()


PILE_AREA = "{min: [0.40, -0.10], max: [0.60, 0.10]}"


@pytest.mark.parametrize(
    ("entry", "fault"),
    [
        (f"area: {PILE_AREA}, drop: heap", "'drop: heap' does not go with this place"),
        ("into: red_bin, drop: pile", "'drop: pile' does not go with this place"),
        (f"area: {PILE_AREA}", "'drop' is missing"),
        (
            "area: {min: [0.40, -0.10], max: [0.60, 0.33]}, drop: pile",
            "the area with its rim of 60 mm lies over red_bin",
        ),
    ],
)
def test_faults_of_piles_in_a_scene_file(entry: str, fault: str):
    base = "picktree: 1\nkind: scene\nbase: pile\nspawn:\n"
    text = base + "  - {of: {assortment: 2}, colours: [red], " + entry + "}\n"
    with pytest.raises(PicktreeError, match=fault):
        parse_scene(text, Path("scene.yaml"))


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        (", drop: heap", "", "'drop' is missing"),
        ("into: tote", "into: red_bin", "there is no tote 'red_bin'"),
        ("into: tote, ", "", "'area' is missing"),
        ("drop: heap", "drop: heap, tumbled: true", "'drop' and 'tumbled' exclude each other"),
        ("meshes: random_urdfs", "meshes: nowhere", "there are no OBJ files in 'nowhere'"),
    ],
)
def test_faults_of_heaps_in_a_scene_file(old: str, new: str, fault: str):
    text = load_scene("tote").text
    assert old in text
    with pytest.raises(PicktreeError, match=fault):
        parse_scene(text.replace(old, new), Path("tote.yaml"))
