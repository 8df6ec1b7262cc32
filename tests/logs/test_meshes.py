"""Models of links: small, closed under writing and reading, right side up."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.logs.binary_gltf import link_meshes, read_glb, write_glb
from picktree.logs.triangle_meshes import decimate, join_meshes, load_mesh, shape_mesh
from picktree.world import Box, ConvexMesh, Cylinder, Pose, Shape, Sphere

URDF = """
<robot name="two">
  <link name="base"><visual><geometry><mesh filename="package://part.obj"/></geometry></visual></link>
  <link name="bare"/>
  <link name="tip"><visual><origin xyz="0 0 1"/><geometry><box size="0.1 0.1 0.2"/></geometry></visual></link>
  <joint name="a" type="fixed"><parent link="base"/><child link="bare"/></joint>
  <joint name="b" type="fixed"><parent link="bare"/><child link="tip"/></joint>
</robot>
"""
OBJ = """mtllib part.mtl
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 2
usemtl red
f 1//1 2//1 3//1
usemtl none
f 1//1 2//1 4//1"""
MTL = "newmtl red\nKd 1.0 0.0 0.0\n"


def written(folder: Path, obj: str = OBJ) -> str:
    (folder / "robot.urdf").write_text(URDF)
    (folder / "part.obj").write_text(obj)
    (folder / "part.mtl").write_text(MTL)
    return str(folder / "robot.urdf")


def test_each_visible_link_has_a_model_with_its_materials(tmp_path: Path) -> None:
    base, tip = link_meshes(written(tmp_path))
    assert (base.link, tip.link) == ("base", "tip")
    mesh = read_glb(base.glb)
    red = mesh.colours[:, 1] < 0.5
    assert red.sum() == 1
    np.testing.assert_allclose(
        mesh.vertices[mesh.faces[red][0]], [[0, 0, 0], [1, 0, 0], [0, 1, 0]], atol=1e-6
    )
    np.testing.assert_allclose(read_glb(tip.glb).vertices[:, 2].max(), 1.1, atol=1e-6)


def test_the_file_has_y_up() -> None:
    data = write_glb(shape_mesh(Box((0.1, 0.2, 0.3))))
    length = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + length])
    assert document["accessors"][0]["max"] == pytest.approx([0.05, 0.15, 0.1])


@pytest.mark.parametrize(
    "shape",
    [
        Box((0.1, 0.2, 0.3)),
        Cylinder(0.1, 0.3),
        Sphere(0.1),
        ConvexMesh(((-0.1, -0.1, 0), (0.1, -0.1, 0), (0, 0.1, 0), (0, 0, 0.2)), "x.obj"),
    ],
)
def test_surfaces_are_closed_and_face_outwards(shape: Shape) -> None:
    mesh = read_glb(write_glb(shape_mesh(shape)))
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    volume = np.einsum("fi,fi->", a, np.cross(b, c)) / 6
    wanted = {Box: 0.006, Cylinder: 0.003 * np.pi, Sphere: 0.004 / 3 * np.pi, ConvexMesh: 0.004 / 3}
    assert volume == pytest.approx(wanted[type(shape)], rel=0.02)
    own = np.cross(b - a, c - a)
    assert (np.einsum("fci,fi->fc", mesh.normals, own) > 0).all()


@pytest.mark.parametrize("size", [1.0, 30.0])
def test_a_fine_mesh_is_thinned_without_losing_its_shape(tmp_path: Path, size: float) -> None:
    sphere = shape_mesh(Sphere(0.5))
    fine = join_meshes([sphere.placed(Pose((float(x), 0.0, 0.0))) for x in range(4)])
    lines = [f"v {x} {y} {z}" for x, y, z in size * fine.vertices]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in fine.faces]
    (tmp_path / "fine.obj").write_text("\n".join(lines))
    mesh = load_mesh(str(tmp_path / "fine.obj"), 1500)
    mesh = replace(mesh, vertices=mesh.vertices / size)
    assert len(fine.faces) > 8000
    assert 1300 < len(mesh.faces) <= 1500
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), np.ptp(fine.vertices, axis=0), rtol=0.01)
    offset = (mesh.vertices[:, 0] + 0.5) % 1.0 - 0.5
    radius = np.linalg.norm(np.column_stack([offset, mesh.vertices[:, 1:]]), axis=1)
    assert abs(radius - 0.5).max() < 0.008


def test_thinning_keeps_corners_borders_and_colours() -> None:
    # A cube of 1 m whose sides are grids, open below, with a round red mark on its top.
    n = 24
    line = np.linspace(-0.5, 0.5, n + 1)
    u, v = (a.ravel() for a in np.meshgrid(line, line))
    half = np.full(len(u), 0.5)
    sides = [np.column_stack([u, v, half])]
    for end in (-half, half):
        sides += [np.column_stack([end, u, v]), np.column_stack([u, end, v])]
    k = np.arange(n * (n + 1)).reshape(n, n + 1)[:, :-1].ravel()
    triangles = ([k, k + 1, k + n + 2], [k, k + n + 2, k + n + 1])
    grid = np.concatenate([np.column_stack(corners) for corners in triangles])
    vertices = np.concatenate(sides)
    faces = np.concatenate([grid + i * len(u) for i in range(5)])
    colours = np.tile([0.9, 0.9, 0.9], (len(faces), 1))
    middle = vertices[faces].mean(axis=1)
    colours[(middle[:, 2] > 0.499) & (np.hypot(middle[:, 0], middle[:, 1]) < 0.3)] = (1.0, 0.0, 0.0)

    few, thin, painted = decimate(vertices, faces, colours, 300)
    assert len(faces) == 5760 and len(thin) <= 310
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    assert np.linalg.norm(few[:, None] - corners, axis=2).min(axis=0).max() < 1e-3
    a, b, c = (few[thin[:, i]] for i in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    assert areas.sum() == pytest.approx(5.0, rel=1e-3)
    red = painted[:, 1] < 0.5
    assert areas[red].sum() == pytest.approx(np.pi * 0.09, rel=0.05)
    assert (few[thin[red]][:, :, 2] > 0.499).all()
