"""Mesh files: triangles in metres, read in one place for robots, items and pictures."""

from __future__ import annotations

import io
import logging
import math
import os
import re
import struct
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from picktree.files import XmlError, decode_xml, file_system, parse_xml
from picktree.files.yaml import file_text

from .shapes import convex_hull
from .values import Array

if TYPE_CHECKING:
    import trimesh

FORMATS = ("stl", "obj", "dae", "ply", "off", "glb")
"""Formats of readable meshes. A glTF file in several parts is excluded: it names files that may be
missing."""
MAX_BYTES = 200_000_000
MAX_TRIANGLES = 4_000_000
MAX_MATERIAL_BYTES = 1_000_000
MAX_EXTENT = 1e9
"""Greatest coordinate of which a hull is computed, m: beyond it squares lose their meaning."""
MIN_THICKNESS = 1e-5
"""Extent of a hull in its thinnest direction below which a mesh is flat, m."""
DEFAULT_COLOUR = (0.93, 0.93, 0.94)
DAMAGED = "the mesh file is damaged, or of another format than its name says"

_BINARY_STL_HEADER = 84
_BINARY_STL_TRIANGLE = 50
_INDENT = re.compile(rb"[\r\n]+ *")
_LIBRARY = re.compile(rb"^\s*mtllib\s+(.*)", re.MULTILINE)


class MeshError(ValueError):
    """Error in a mesh file, with a remedy."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(f"{message}; {hint}" if hint else message)
        self.message, self.hint = message, hint


class FlatMesh(MeshError):
    """Error for a mesh that encloses no volume."""

    def __init__(self) -> None:
        super().__init__("the mesh is flat: it encloses no volume")


@dataclass(frozen=True, slots=True, eq=False)
class TriangleMesh:
    """Triangles of a mesh file in its own frame: vertices (n, 3) m, faces (m, 3), colours of faces (m, 3),
    0 … 1."""

    vertices: Array
    faces: NDArray[np.int64]
    colours: Array

    def volume(self) -> float:
        """Return the enclosed volume, m³; meaningless for an open mesh."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return float(abs(np.einsum("fi,fi->", a, np.cross(b, c))) / 6)


def read_mesh(path: Path, most: int = MAX_BYTES) -> TriangleMesh:
    """Read a mesh file of at most `most` bytes. The content decides on its format, then the name's suffix.

    A COLLADA file's `<unit>` is applied; its `<up_axis>` is not, as in ROS. Raises MeshError for a file that
    cannot be read, for vertices that are not finite, and for one without triangles.
    """
    try:
        raw = file_text.read_bytes(path, most)
    except file_text.Unreadable as error:
        raise MeshError(f"{path}: {error.message}") from None
    return parse_mesh(raw, path)


def parse_mesh(raw: bytes, path: Path) -> TriangleMesh:
    """Parse the content of a mesh file named `path`, beside which materials are looked for.

    Raises MeshError as `read_mesh` does.
    """
    kind = _format(raw, path)
    unit = _collada_unit(raw) if kind == "dae" else 1.0
    content = _prepared(raw, kind)
    scene = _loaded(content, kind, _materials(raw, path.parent) if kind == "obj" else {})
    parts = [part for node in scene.graph.nodes_geometry if (part := _part(scene, node)) is not None]
    if not sum(len(part.faces) for part in parts):
        raise MeshError("the mesh has no triangles", "convert it anew to STL or OBJ")
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])]).tolist()
    vertices = np.concatenate([part.vertices for part in parts]) * unit
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)])
    if len(faces) > MAX_TRIANGLES:
        raise MeshError(f"the mesh has {len(faces):,} triangles", f"{MAX_TRIANGLES:,} at most; simplify it")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise MeshError("the mesh has faces with vertices that are missing")
    # Vertices without a face are no part of the body.
    used, places = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], places.reshape(-1, 3).astype(np.int64)
    _refuse_infinite(vertices)
    return TriangleMesh(vertices, faces, np.concatenate([part.colours for part in parts]))


def _refuse_infinite(vertices: Array) -> None:
    if bad := int((~np.isfinite(vertices).all(axis=1)).sum()):
        raise MeshError(
            f"the mesh has {bad} of {len(vertices)} vertices that are not finite numbers", "export it anew"
        )


def parse_groups(raw: bytes) -> list[Array]:
    """Return the vertices (n, 3) of each object (`o`) of an OBJ file's content, in no certain order.

    Raises MeshError as `read_mesh` does.
    """
    scene = _loaded(_prepared(raw, "obj"), "obj", {}, by_object=True)
    meshes = list(cast("Any", scene).geometry.values())
    solid = [mesh for mesh in meshes if len(getattr(mesh, "faces", ()))]
    groups = [np.asarray(mesh.vertices, dtype=np.float64)[np.unique(mesh.faces)] for mesh in solid]
    if not groups:
        raise MeshError("the mesh has no triangles", "convert it anew to OBJ")
    _refuse_infinite(np.concatenate(groups))
    return groups


def hull_corners(points: Array) -> Array:
    """Return the corners (k, 3) of the convex hull of points (n, 3), m. Raises FlatMesh; MeshError for points
    beyond MAX_EXTENT."""
    if not float(np.abs(points).max()) <= MAX_EXTENT:
        raise MeshError(f"the mesh reaches further than {MAX_EXTENT:g} m", "is its unit right?")
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    if float(np.ptp(centred @ axes, axis=0).min()) < MIN_THICKNESS:
        raise FlatMesh
    try:
        return points[convex_hull(points).vertices]
    except RuntimeError:
        raise FlatMesh from None


def hulls_text(parts: Sequence[Array]) -> str:
    """Return an OBJ file with one `o` group for each part, corners (k, 3); faces of hulls face outwards."""
    lines, first = list[str](), 1
    for n, corners in enumerate(parts):
        faces = convex_hull(corners).simplices
        triangles = corners[faces]
        outward = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        inverted = np.einsum("fi,fi->f", outward, triangles.mean(axis=1) - corners.mean(axis=0)) < 0
        faces = np.where(inverted[:, None], faces[:, ::-1], faces)
        lines.append(f"o part_{n}")
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in corners.tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (faces + first).tolist()]
        first += len(corners)
    return "\n".join(lines) + "\n"


def material_library(path: Path) -> Path | None:
    """Return the file of materials that an OBJ file names at its beginning; it need not exist."""
    with path.open("rb") as mesh:
        library = _LIBRARY.search(mesh.read(4096))
    return path.parent / library[1].strip().decode(errors="replace") if library else None


def _format(raw: bytes, path: Path) -> str:
    """Return the format that the content shows, else that of the name. Raises MeshError for no mesh."""
    head = raw[:4096].lstrip(b"\xef\xbb\xbf \t\r\n")
    if not head:
        raise MeshError("the file is empty")
    if head.startswith(b"version https://git-lfs"):
        raise MeshError("the file is a pointer of git-lfs, not the mesh", "get the mesh: git lfs pull")
    if head[:15].lower().startswith((b"<!doctype html", b"<html")):
        raise MeshError("the file is a web page, not a mesh", "download the mesh itself")
    if head.startswith(b"glTF"):
        return "glb"
    if head.startswith((b"ply\n", b"ply\r")):
        return "ply"
    if re.match(rb"(ST|C|N|4|n)*OFF\s", head):
        return "off"
    if b"<COLLADA" in head:
        return "dae"
    suffix = path.suffix.lower().removeprefix(".")
    if suffix not in FORMATS:
        raise MeshError(f"{path.name} is not a mesh file of a known format", f"known: {', '.join(FORMATS)}")
    return suffix


def _prepared(raw: bytes, kind: str) -> bytes:
    """Return the content in the form that the library reads: text in ASCII, a binary STL without a tail."""
    if kind == "stl" and len(raw) >= _BINARY_STL_HEADER:
        (count,) = struct.unpack_from("<I", raw, _BINARY_STL_HEADER - 4)
        size = _BINARY_STL_HEADER + _BINARY_STL_TRIANGLE * count
        text = b"facet" in raw[:1000].lower()
        if len(raw) >= size and count and not text:
            return raw[:size]
        if not text:
            there = (len(raw) - _BINARY_STL_HEADER) // _BINARY_STL_TRIANGLE
            if count == 0:
                raise MeshError("the mesh has no triangles", "convert it anew to STL or OBJ")
            if count <= MAX_TRIANGLES:
                raise MeshError(f"the file is cut off: {there:,} of {count:,} triangles are in it")
            raise MeshError(DAMAGED)
    if kind == "stl":
        return _ascii(raw).lower()
    if kind == "obj":
        return _INDENT.sub(b"\n", _ascii(raw).replace(b"\t", b" "))
    if kind == "dae":
        return decode_xml(raw).encode()
    if kind == "off" or (kind == "ply" and b"format ascii" in raw[:200]):
        return _ascii(raw)
    return raw


def _ascii(raw: bytes) -> bytes:
    """Return a text in ASCII: names in other letters do not affect the geometry."""
    wide = raw.startswith((b"\xff\xfe", b"\xfe\xff"))
    return raw.decode("utf-16" if wide else "utf-8-sig", errors="replace").encode("ascii", errors="replace")


def _collada_unit(raw: bytes) -> float:
    """Return the length of a COLLADA file's unit, m; 1 where it names none."""
    try:
        asset = next((e for e in parse_xml(raw) if e.tag.rpartition(":")[2] == "asset"), ())
    except XmlError as error:
        raise MeshError(f"the mesh file cannot be read: {error}") from None
    unit = next((element for element in asset if element.tag.rpartition(":")[2] == "unit"), None)
    text = "1" if unit is None else unit.get("meter", "1")
    try:
        length = float(text.replace(",", "."))  # some exporters write a decimal comma
    except ValueError:
        length = math.nan
    if not (math.isfinite(length) and length > 0):
        raise MeshError(
            f'the mesh has <unit meter="{text}">, which is not a length',
            'as <unit meter="0.001"> for millimetres',
        )
    return length


def _loaded(raw: bytes, kind: str, materials: dict[str, bytes], *, by_object: bool = False) -> trimesh.Scene:
    import trimesh  # slow to import

    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # it reports pictures that it does not find
    options: dict[str, Any] = {}
    if kind == "obj":
        options = {"group_material": not by_object, "split_objects": by_object, "resolver": materials}
    try:
        loaded = trimesh.load_scene(io.BytesIO(raw), kind, process=False, **options)  # pyright: ignore[reportUnknownMemberType]
    except (ValueError, NotImplementedError) as error:
        message = str(error).strip().partition("\n")[0] or type(error).__name__
        raise MeshError(f"the mesh file cannot be read: {message}") from None
    except Exception:  # noqa: BLE001 - the library of each format has errors of its own
        raise MeshError(DAMAGED) from None
    return loaded


def material_names(raw: bytes) -> tuple[bytes, ...]:
    """Return the names of the libraries of materials in an OBJ file's content, each once."""
    return tuple(dict.fromkeys(line.strip() for line in _LIBRARY.findall(raw)))


def material_files(raw: bytes, folder: Path) -> dict[bytes, Path]:
    """Return the libraries of materials that an OBJ file in `folder` names and that are there, by name."""
    found: dict[bytes, Path] = {}
    for library in material_names(raw):
        written = (os.fsdecode(library), library.decode("latin-1"))
        file = next((folder / name for name in written if file_system.is_file(folder / name)), None)
        if file is not None:
            found[library] = file
    return found


def _materials(raw: bytes, folder: Path) -> dict[str, bytes]:
    """Return the content of the libraries of materials that can be read, by name."""
    found: dict[str, bytes] = {}
    for library, file in material_files(raw, folder).items():
        with suppress(file_text.Unreadable):
            found[_ascii(library).decode()] = _ascii(file_text.read_bytes(file, MAX_MATERIAL_BYTES))
    return found


def _part(scene: trimesh.Scene, node: str) -> TriangleMesh | None:
    """Return one geometry of a scene in the scene's frame; None for points and lines."""
    transform, name = cast("tuple[Array, str]", scene.graph[node])
    mesh = cast("Any", scene).geometry[name]
    faces = np.asarray(getattr(mesh, "faces", ()), dtype=np.int64).reshape(-1, 3)
    if not len(faces):
        return None
    vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
    if not np.array_equal(transform, np.eye(4)):
        vertices = vertices @ transform[:3, :3].T + transform[:3, 3]
        if np.linalg.det(transform[:3, :3]) < 0:
            faces = faces[:, ::-1]
    return TriangleMesh(vertices, faces, _colours(mesh, len(faces)))


def _colours(mesh: Any, count: int) -> Array:
    """Return the colours (count, 3) of a mesh's faces, 0 … 1."""
    visual = mesh.visual
    plain = np.tile(np.array(DEFAULT_COLOUR), (count, 1))
    if not visual.defined:
        return plain
    if visual.kind == "texture":
        return np.tile(np.asarray(visual.material.main_color, dtype=np.float64)[:3] / 255, (count, 1))
    colours = np.asarray(visual.face_colors, dtype=np.float64).reshape(-1, 4)
    return colours[:, :3] / 255 if len(colours) == count else plain
