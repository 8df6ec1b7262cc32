"""Items that are not convex: their convex parts, what is seen and gripped of them, and the file of parts."""

from __future__ import annotations

import math
import sys
from dataclasses import asdict
from pathlib import Path
from subprocess import run

import numpy as np
import pytest
import trimesh
from pydantic import TypeAdapter

from picktree.files.disk_cache import VARIABLE
from picktree.logs.triangle_meshes import shape_mesh
from picktree.world import (
    CompoundMesh,
    ConvexMesh,
    Pose,
    Shape,
    convex_decomposition,
    half_spaces,
    inside,
    pad_contacts,
    ray_hits,
    top_heights,
)
from picktree.world.convex_decomposition import (
    MAX_PARTS,
    body_of,
    moments,
    parts_name,
    parts_text,
    read_parts,
)
from picktree.world.mesh_reader import FlatMesh, MeshError
from picktree.world.scene.scene_entries import load_body
from picktree.world.scene.scene_loading import SHIPPED

ANGLE = [(0.0, 0.0), (0.06, 0.0), (0.06, 0.006), (0.006, 0.006), (0.006, 0.04), (0.0, 0.04)]
ANGLE_TRIANGLES = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]


def angle(folder: Path, scale: float = 1.0) -> Path:
    """Write an angle bracket: a plate of 60 × 30 × 6 mm and one of 40 × 30 × 6 mm upon its end."""
    outline, triangles = np.array(ANGLE) / scale, np.array(ANGLE_TRIANGLES)
    made = trimesh.creation.extrude_triangulation(outline, triangles, height=0.03 / scale)
    made.export(folder / "angle.stl")
    return folder / "angle.stl"


def ring(folder: Path) -> Path:
    trimesh.creation.annulus(0.014, 0.022, 0.018, sections=32).export(folder / "ring.stl")
    return folder / "ring.stl"


def compound(path: Path, scale: float = 1.0) -> CompoundMesh:
    body = load_body(path, scale)
    assert isinstance(body, CompoundMesh)
    return body


def test_a_bracket_has_the_room_and_centre_of_its_mesh(tmp_path: Path) -> None:
    body, mesh = compound(angle(tmp_path)), trimesh.load_mesh(tmp_path / "angle.stl")
    assert 2 <= len(body.parts) <= MAX_PARTS
    volume = sum(moments(np.array(part))[0] for part in body.parts)
    assert volume == pytest.approx(mesh.volume, rel=0.02)
    assert np.ptp(np.array(body.vertices), axis=0) == pytest.approx((0.06, 0.04, 0.03), abs=1e-5)
    corner = -np.array(mesh.center_mass)
    points = corner + np.array([(0.003, 0.03, 0.015), (0.05, 0.003, 0.015), (0.03, 0.03, 0.015)])
    assert inside(body, Pose(), points).tolist() == [True, True, False]


def test_coordinates_of_parts_are_whole_hundredths_of_a_millimetre(tmp_path: Path) -> None:
    steps = np.concatenate([np.array(part) for part in compound(ring(tmp_path)).parts]) * 1e5
    assert np.abs(steps - np.round(steps)).max() < 1e-6


def test_a_sliver_without_volume_is_no_part() -> None:
    box = np.array(np.meshgrid((0.0, 0.04), (0.0, 0.03), (0.0, 0.02))).reshape(3, -1).T
    beside = np.array((0.04, 0.0, 0.0))
    sliver = box * np.array((1.0, 1.0, 1e-5)) + np.array((0.0, 0.0, 0.0200001))
    body = body_of([box, box + beside, sliver], "bar.stl", 1.0)
    assert isinstance(body, CompoundMesh)
    assert len(body.parts) == 2
    with pytest.raises(FlatMesh):
        body_of([sliver, sliver + beside], "bar.stl", 1.0, centre=np.zeros(3))


def test_rays_go_through_a_hole_and_not_through_the_wall(tmp_path: Path) -> None:
    body = compound(ring(tmp_path))
    for x, hit in ((0.0, math.inf), (0.018, 1.0 - 0.009), (0.03, math.inf)):
        ray = np.array([[0.0, 0.0, -1.0]])
        found = ray_hits(body, np.eye(3), np.zeros(3), np.array([x, 0.0, 1.0]), ray)
        assert found == pytest.approx([hit], abs=1e-5)
    heights = top_heights(body, Pose((0.5, 0.0, 0.2)), np.array([(0.5, 0.0), (0.518, 0.0)]))
    assert heights == pytest.approx([-math.inf, 0.209], abs=1e-5)


def test_pads_meet_the_wall_that_is_between_them(tmp_path: Path) -> None:
    body, heights = compound(ring(tmp_path)), (-0.006, 0.006)
    whole = pad_contacts(body, Pose(), 0.06, 0.002, heights)
    assert whole is not None and whole.opposed
    assert whole.width == pytest.approx(0.044, abs=3e-4)
    wall = pad_contacts(body, Pose((0.0, -0.018, 0.0)), 0.02, 0.002, heights)
    assert wall is not None and wall.opposed
    assert wall.width == pytest.approx(0.008, abs=6e-4)
    assert pad_contacts(body, Pose(), 0.02, 0.002, heights) is None


def test_the_file_of_parts_gives_the_same_body(tmp_path: Path) -> None:
    path = angle(tmp_path, scale=0.001)
    body = compound(path, 0.001)
    named = tmp_path / parts_name("angle.stl", 0.001)
    named.write_text(parts_text(body, path.read_bytes()))
    again = compound(path, 0.001)
    assert (again.vertices, again.parts) == (body.vertices, body.parts)
    # Other parts in the file are other parts of the body: the file is read, and the mesh not taken apart.
    one = parts_text(CompoundMesh(body.vertices, "", (body.parts[0],), 0.001), path.read_bytes())
    named.write_text(one)
    assert isinstance(load_body(path, 0.001), ConvexMesh)
    assert not isinstance(load_body(path, 0.001), CompoundMesh)


@pytest.mark.parametrize("name", ["bracket", "cup", "ring", "screw"])
def test_shipped_meshes_have_their_parts_beside_them(name: str) -> None:
    mesh = SHIPPED / "meshes" / f"{name}.obj"
    parts = read_parts(mesh, mesh.read_bytes(), 0.001)
    assert parts is not None
    assert len(parts) == len(compound(mesh, 0.001).parts)


def test_the_file_of_parts_of_another_mesh_is_left_alone(tmp_path: Path) -> None:
    path = angle(tmp_path)
    body = compound(path)
    wrong = parts_text(CompoundMesh(body.vertices, "", (body.parts[0],)), b"another mesh")
    (tmp_path / parts_name("angle.stl", 1.0)).write_text(wrong)
    assert compound(path).parts == body.parts


def test_a_mesh_that_so_few_parts_do_not_make_up_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PICKTREE_CACHE", "")
    monkeypatch.setattr(convex_decomposition, "MAX_EXCESS", -0.5)
    with pytest.raises(
        MeshError, match=r"^the mesh is too intricate: 16 convex parts are -?\d+ % larger than the mesh"
    ):
        load_body(angle(tmp_path, 0.5), 0.5)


def test_a_hull_with_many_corners_loses_those_that_matter_least(tmp_path: Path) -> None:
    trimesh.creation.cylinder(radius=0.02, height=0.03, sections=400).export(tmp_path / "roll.stl")
    body = load_body(tmp_path / "roll.stl", 1.0)
    assert isinstance(body, ConvexMesh)
    assert len(body.vertices) == 256
    reach = np.hypot(*np.array(body.vertices)[:, :2].T)
    assert reach == pytest.approx(np.full(256, 0.02), abs=1e-6)


def test_a_ball_keeps_its_size(tmp_path: Path) -> None:
    trimesh.creation.icosphere(4, radius=0.03).export(tmp_path / "ball.stl")
    body = load_body(tmp_path / "ball.stl", 1.0)
    assert len(body.vertices) == 256
    normals, offsets = half_spaces(body)
    assert len(normals) > 256
    assert float(offsets.min()) == pytest.approx(0.03, abs=0.0006)


def test_a_log_keeps_what_is_not_convex(tmp_path: Path) -> None:
    body = compound(angle(tmp_path))
    read = TypeAdapter[Shape](Shape).validate_python(asdict(body))
    assert isinstance(read, CompoundMesh) and read == body
    assert isinstance(
        TypeAdapter[Shape](Shape).validate_python(asdict(ConvexMesh(body.vertices, ""))), ConvexMesh
    )
    drawn = shape_mesh(read)
    # As its parts, and not as its hull, which is more than twice as large.
    volume = sum(moments(np.array(part))[0] for part in body.parts)
    corners = drawn.vertices[drawn.faces]
    enclosed = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert enclosed == pytest.approx(volume, rel=1e-3)


def test_a_command_says_that_it_decomposes_a_mesh_when_it_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes seconds. The next command has the parts from the cache."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    trimesh.creation.annulus(13.7, 21.3, 9.1, sections=16).export(tmp_path / "washer.stl")
    (tmp_path / "scene.yaml").write_text(
        "picktree: 1\nkind: scene\nbase: sort_small\n"
        "catalogue: {washer: {mesh: {file: washer.stl, scale: 0.001}, mass: 20 g, friction: 0.5}}\n"
    )
    words = [sys.executable, "-m", "picktree", "check", "scene.yaml", "--format", "json"]
    # In a new interpreter: threads of the library would not survive a fork of this one.
    first, second = (run(words, cwd=tmp_path, capture_output=True, text=True, check=True) for _ in range(2))
    assert first.stderr == "decomposing washer.stl into convex parts …\n"
    assert (second.stderr, second.stdout) == ("", first.stdout)
