"""Heaps in physics: things of an assortment, poured into a tote; broken meshes and overflow are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.errors import PicktreeError
from picktree.robots.loading import load_robot
from picktree.simulation.kinematic.backend import KinematicHardware
from picktree.simulation.physics.backend import PhysicsHardware
from picktree.simulation.spawning.heap_spawning import mesh_files, read_thing
from picktree.simulation.spawning.spawn import spawn_items
from picktree.world.scene.description import Assortment, SceneDescription
from picktree.world.scene.loading.scene_loading import load_scene, parse_scene

CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 20) for y in (0, 20) for z in (0, 20))
FACES = "f 1 2 3 4\nf 5 6 7 8\nf 1 5 2 6\n"


def tote(number: int = 6, meshes: str = "random_urdfs") -> SceneDescription:
    scene = load_scene("tote")
    (spawn,) = scene.spawn
    assert scene.assortment is not None
    assortment = replace(scene.assortment, meshes=meshes)
    return replace(scene, spawn=(replace(spawn, counts=(("assortment", number),)),), assortment=assortment)


def thing(tmp_path: Path, text: str, density: float = 1000.0):
    file = tmp_path / "thing.obj"
    file.write_text(text)
    return read_thing(file, Assortment(str(tmp_path), 1e-3, density, 0.5))


def test_a_thing_has_the_mass_centre_and_inertia_of_its_parts(tmp_path: Path):
    found = thing(tmp_path, "o part\n" + CUBE + FACES)
    assert found.entry.mass == pytest.approx(0.008)
    assert found.mesh.centre == pytest.approx((0.01, 0.01, 0.01))
    assert found.mesh.inertia == pytest.approx((0.02**2 / 6,) * 3)
    assert np.abs(np.array(found.entry.shape.vertices)).max() == pytest.approx(0.01)  # type: ignore[union-attr]


def test_two_parts_of_a_thing_are_weighed_apart(tmp_path: Path):
    second = "".join(f"v {x} {y} {z}\n" for x in (60, 80) for y in (0, 20) for z in (0, 20))
    other = "f 9 10 11 12\nf 13 14 15 16\nf 9 13 10 14\n"
    found = thing(tmp_path, "o a\n" + CUBE + FACES + "o b\n" + second + other)
    assert found.entry.mass == pytest.approx(0.016)
    assert found.mesh.centre == pytest.approx((0.04, 0.01, 0.01))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            CUBE.replace("v 20 20 20", "v nan 20 20") + FACES,
            "the mesh is broken: a vertex is not a finite number",
        ),
        (CUBE.replace("20\n", "0\n") + FACES, "the mesh is broken: a part has no volume"),
        (CUBE.replace("20\n", "1\n") + FACES, "the mesh is 1.0 mm thick; at least 2 mm are wanted"),
        ("v 1 2\nf 1 2 3\n", "the mesh is broken: it is no OBJ file"),
        ("v 1 2 3\n", "the mesh is broken: it has no faces"),
    ],
)
def test_a_broken_mesh_is_refused_with_a_sentence(tmp_path: Path, text: str, words: str):
    with pytest.raises(PicktreeError) as caught:
        thing(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 'thing.obj'}: {words}")


def test_the_shipped_set_has_a_thing_without_finite_vertices_which_is_never_drawn():
    broken = next(file for file in mesh_files("random_urdfs") if file.stem == "168")
    with pytest.raises(PicktreeError, match="not a finite number"):
        read_thing(broken, Assortment("random_urdfs", 0.01, 1000.0, 0.5))
    drawn = spawn_items(tote(200), 1)
    assert len(drawn) == 200 == len({item.mesh.file for item in drawn if item.mesh is not None})
    assert all(item.entry.mass >= 0.03 and "168" not in (item.mesh or item).file for item in drawn)  # type: ignore


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
    scene = tote(60)
    with pytest.raises(PicktreeError, match=r"spawn\[0\]: tote overflows: \d+ of 60 items do not stay in it"):
        PhysicsHardware(scene, load_robot("panda"), 1)


def test_a_heap_without_physics_is_refused():
    with pytest.raises(PicktreeError, match="needs physics"):
        KinematicHardware(tote(), load_robot("panda"), 1)


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
