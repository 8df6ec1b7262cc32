"""Mesh files: one tetrahedron or cube in each format and dialect, and what is said of files that are none."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from picktree.world import Array
from picktree.world.mesh_reader import FlatMesh, MeshError, hull_corners, hulls_text, read_mesh

CORNERS: Array = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]])
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
V = "v 0 0 0\nv .1 0 0\nv 0 2e-1 0\nv 0 0 .30\n"
F = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def binary_stl(corners: Array, head: bytes = b"", count: int | None = None) -> bytes:
    parts = [head.ljust(80), struct.pack("<I", len(FACES) if count is None else count)]
    for face in FACES:
        parts += [struct.pack("<12f", 0, 0, 0, *corners[list(face)].ravel()), b"\0\0"]
    return b"".join(parts)


def text_stl() -> str:
    lines = ["solid part"]
    for face in FACES:
        vertices = [f"vertex {x} {y} {z}" for x, y, z in CORNERS[list(face)].tolist()]
        lines += ["facet normal 0 0 0", "outer loop", *vertices, "endloop", "endfacet"]
    return "\n".join([*lines, "endsolid part"])


def dae(unit: str = "", size: float = 1.0, encoding: str = "utf-8") -> bytes:
    numbers = " ".join(str(n) for n in (CORNERS * size).ravel().tolist())
    indices = " ".join(str(n) for face in FACES for n in face)
    return f"""<?xml version="1.0" encoding="{encoding}"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified>{unit}
<up_axis>Y_UP</up_axis></asset><library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="pa" count="12">{numbers}</float_array><technique_common>
<accessor source="#pa" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>{indices}</p></triangles>
</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node id="n">
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>""".encode(encoding)


def off(word: str = "OFF", tail: str = "") -> str:
    lines = [word, "4 4 6", *(f"{x} {y} {z}{tail}" for x, y, z in CORNERS.tolist())]
    return "\n".join([*lines, *(f"3 {a} {b} {c}" for a, b, c in FACES)]) + "\n"


def ply(end: str = "\n") -> str:
    axes = [f"property float {axis}" for axis in "xyz"]
    head = ["ply", "format ascii 1.0", "comment é", "element vertex 4", *axes, "element face 4"]
    body = [f"{x} {y} {z}" for x, y, z in CORNERS.tolist()] + [f"3 {a} {b} {c}" for a, b, c in FACES]
    return end.join([*head, "property list uchar int vertex_indices", "end_header", *body, ""])


GOOD: dict[str, str | bytes] = {
    "binary.stl": binary_stl(CORNERS),
    "binary that begins with solid.stl": binary_stl(CORNERS, b"solid part"),
    "binary with a tail.stl": binary_stl(CORNERS) + b"\0" * 7,
    "text.stl": text_stl(),
    "TEXT IN CAPITALS.STL": text_stl().upper(),
    "plain.obj": V + F,
    "counted from the end.obj": V + "f -4 -2 -3\nf -4 -3 -1\nf -4 -1 -2\nf -3 -2 -1\n",
    "with normals.obj": V + "vn 0 0 1\n" + F.replace("\n", " \n").replace(" ", "//1 ").replace("f//1", "f"),
    "indented, with tabs.obj": V.replace(" ", "\t") + F.replace("f", "  f"),
    "over two lines.obj": V + F.replace("1 3 2", "1 3 \\\n2"),
    "with colours.obj": V.replace("\n", " 1 0 0\n") + F,
    "in UTF-16.obj": (V + F).encode("utf-16"),
    "with a name in Latin-1.obj": "o Hügel\n".encode("latin-1") + (V + F).encode(),
    "with a vertex of no face.off": off().replace("4 4 6", "5 4 6").replace("\n3 0 2 1", "\n9 9 9\n3 0 2 1"),
    "with lines and points.obj": V + "l 1 2\np 1\n" + F,
    "metres.dae": dae(),
    "a unit without a number.dae": dae("<unit/>"),
    "millimetres.dae": dae('<unit meter="0.001" name="millimeter"/>', 1000.0),
    "a unit with a decimal comma.dae": dae('<unit meter="0,010000"/>', 100.0),
    "inches.dae": dae('<unit name="inch" meter="2.54e-2"/>', 1 / 0.0254),
    "in UTF-16.dae": dae(encoding="utf-16"),
    "plain.off": off(),
    "with colours.off": off("COFF", " 1 0 0 1"),
    "an OFF file.stl": off(),
    "text.ply": ply(),
    "with Windows' lines.ply": ply("\r\n"),
}

BAD: dict[str, tuple[str | bytes, str]] = {
    "empty.stl": (b"", "the file is empty"),
    "lfs.dae": (
        "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n",
        "the file is a pointer of git-lfs, not the mesh; get the mesh: git lfs pull",
    ),
    "page.stl": ("<!DOCTYPE html><html>", "the file is a web page, not a mesh; download the mesh itself"),
    "part.step": ("ISO-10303-21;", "part.step is not a mesh file of a known format; known: stl, obj, dae, "
    "ply, "
                  "off, glb"),
    "cut.stl": (binary_stl(CORNERS)[:190], "the file is cut off: 2 of 4 triangles are in it"),
    "none.stl": (binary_stl(CORNERS)[:80] + bytes(4), "the mesh has no triangles; convert it anew to STL or "
                 "OBJ"),
    "points.obj": (V, "the mesh has no triangles; convert it anew to STL or OBJ"),
    "beyond.obj": (V + "f 1 2 9\n", "the mesh file is damaged, or of another format than its name says"),
    "nan.stl": (
        binary_stl(np.where(CORNERS > 0.2, np.nan, CORNERS)),
        "the mesh has 3 of 12 vertices that are not finite numbers; export it anew",
    ),
    "zero.dae": (
        dae('<unit meter="0"/>'),
        'the mesh has <unit meter="0">, which is not a length; as <unit meter="0.001"> for millimetres',
    ),
    "word.dae": (
        dae('<unit meter="inch"/>'),
        'the mesh has <unit meter="inch">, which is not a length; as <unit meter="0.001"> for millimetres',
    ),
    "no scene.dae": (
        dae().replace(b"<scene>", b"<!--").replace(b"</scene>", b"-->"),
        "the mesh file is damaged, or of another format than its name says",
    ),
    "cut.dae": (
        dae()[:150],
        "the mesh file cannot be read: not readable as XML: no element found: line 3, column 32",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", GOOD)
def test_a_tetrahedron_in_each_dialect(name: str, tmp_path: Path) -> None:
    content = GOOD[name]
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    mesh = read_mesh(tmp_path / name)
    assert len(mesh.faces) == len(mesh.colours) == 4
    assert mesh.volume() == pytest.approx(0.001, rel=1e-4)
    np.testing.assert_allclose(
        sorted(hull_corners(mesh.vertices).tolist()), sorted(CORNERS.tolist()), atol=1e-6
    )


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_is_no_mesh_is_told_in_one_sentence(name: str, tmp_path: Path) -> None:
    content, message = BAD[name]
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(MeshError) as raised:
        read_mesh(tmp_path / name)
    assert str(raised.value) == message


def test_faces_have_the_colours_of_their_materials(tmp_path: Path) -> None:
    (tmp_path / "Töne.mtl").write_bytes("newmtl Grün\nKd 0 1 0\nnewmtl red\nKd 1 0 0\n".encode("latin-1"))
    text = f"mtllib Töne.mtl\n{V}usemtl Grün\nf 1 3 2\nusemtl red\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "part.obj").write_bytes(text.encode("latin-1"))
    colours = read_mesh(tmp_path / "part.obj").colours.tolist()
    assert sorted(colours) == [[0, 1, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0]]


def test_a_mesh_beyond_all_bounds_is_told() -> None:
    for size in (1e10, np.inf):
        with pytest.raises(MeshError, match=r"^the mesh reaches further than 1e\+09 m; is its unit right\?$"):
            hull_corners(CORNERS * size if np.isfinite(size) else np.where(CORNERS > 0, size, CORNERS))


@pytest.mark.parametrize("thickness", [0.0, 1e-6])
def test_a_flat_mesh_has_no_hull(thickness: float) -> None:
    sheet = np.array([[x, y, x + y + z] for x in (0, 1) for y in (0, 1) for z in (0, thickness)], np.float64)
    with pytest.raises(FlatMesh, match=r"^the mesh is flat: it encloses no volume$"):
        hull_corners(sheet)


def test_a_written_hull_is_closed_and_faces_outwards(tmp_path: Path) -> None:
    points = np.random.default_rng(3).normal(size=(60, 3))
    (tmp_path / "hull.obj").write_text(hulls_text([hull_corners(points)]))
    mesh = read_mesh(tmp_path / "hull.obj")
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    assert (np.einsum("fi,fi->f", normals, a - points.mean(axis=0)) > 0).all()
    np.testing.assert_allclose(normals.sum(axis=0), 0, atol=1e-12)
    assert sorted(mesh.vertices.tolist()) == sorted(hull_corners(points).tolist())
