"""Binary glTF 2.0, reduced to the needs of a link's mesh, with Y up as viewers expect; links' meshes."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TypedDict

import numpy as np
import orjson
from numpy.typing import NDArray

from picktree.files import disk_cache
from picktree.world import Box, ConvexMesh, Pose, Shape, mesh_reader, shapes, values
from picktree.world.robot_model import (
    LinkShape,
    link_shapes,
    link_solids,
    refuse_mesh,
    refuse_size,
    urdf_parser,
)

from . import triangle_meshes
from .log_records import BodyRecord, LinkMesh
from .triangle_meshes import Indices, Mesh, join_meshes, load_mesh, shape_mesh

_HEADER = struct.Struct("<4sII")
_CHUNK = struct.Struct("<II")
_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_FLOAT, _UINT16 = 5126, 5123
_MAX_VERTICES = 65535
_GENERATOR = "picktree, Y up"
"""Generator in the file. Files with the generator `picktree` alone have their Y down."""


class _View(TypedDict):
    buffer: int
    byteOffset: int
    byteLength: int


class _Primitive(TypedDict):
    attributes: dict[str, int]
    indices: int
    material: int


def write_glb(mesh: Mesh) -> bytes:
    """Encode a mesh with one primitive for each of its colours. Raises ValueError for too many vertices."""
    # Corners with the same vertex and the same normal are one vertex of the file.
    keys = np.column_stack([mesh.faces.ravel(), np.round(mesh.normals.reshape(-1, 3) * 100).astype(np.int64)])
    _, first, corner = np.unique(keys @ _KEY_FACTORS, return_index=True, return_inverse=True)
    vertices = mesh.vertices[mesh.faces.ravel()[first]]
    normals = mesh.normals.reshape(-1, 3)[first]
    faces = corner.reshape(-1, 3)
    if len(vertices) > _MAX_VERTICES:
        raise ValueError(f"{len(vertices)} vertices; a link's model may have {_MAX_VERTICES}")
    palette, colour = np.unique(
        np.round(mesh.colours * 255).astype(np.int64) @ _RGB_FACTORS, return_inverse=True
    )

    blobs = [
        _up(vertices).astype("<f4").tobytes(),
        _up(normals).astype("<f4").tobytes(),
        *(_padded(faces[colour == k].astype("<u2").tobytes()) for k in range(len(palette))),
    ]
    views: list[_View] = []
    offset = 0
    for blob in blobs:
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": len(blob)})
        offset += len(blob)
    lifted = _up(vertices).astype("<f4")
    accessors: list[dict[str, object]] = [
        {
            "bufferView": 0,
            "componentType": _FLOAT,
            "count": len(vertices),
            "type": "VEC3",
            "min": lifted.min(axis=0).tolist(),
            "max": lifted.max(axis=0).tolist(),
        },
        {"bufferView": 1, "componentType": _FLOAT, "count": len(vertices), "type": "VEC3"},
        *(
            {
                "bufferView": 2 + k,
                "componentType": _UINT16,
                "count": int((colour == k).sum()) * 3,
                "type": "SCALAR",
            }
            for k in range(len(palette))
        ),
    ]
    document = {
        "asset": {"version": "2.0", "generator": _GENERATOR},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2 + k, "material": k}
                    for k in range(len(palette))
                ]
            }
        ],
        "materials": [
            {
                "pbrMetallicRoughness": {
                    "baseColorFactor": [*_rgb(int(code)), 1.0],
                    "metallicFactor": 0.0,
                    "roughnessFactor": 0.6,
                }
            }
            for code in palette
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": offset}],
    }
    text = orjson.dumps(document)
    text += b" " * (-len(text) % 4)
    binary = b"".join(blobs)
    total = _HEADER.size + 2 * _CHUNK.size + len(text) + len(binary)
    return b"".join(
        (
            _HEADER.pack(b"glTF", 2, total),
            _CHUNK.pack(len(text), _JSON),
            text,
            _CHUNK.pack(len(binary), _BINARY),
            binary,
        )
    )


class _Material(TypedDict):
    pbrMetallicRoughness: dict[str, list[float]]


class _Accessor(TypedDict):
    count: int


class _Asset(TypedDict):
    generator: str


class _Document(TypedDict):
    asset: _Asset
    accessors: list[_Accessor]
    meshes: list[dict[str, list[_Primitive]]]
    materials: list[_Material]
    bufferViews: list[_View]


def with_y_up(data: bytes) -> bytes:
    """Return a file of an older picktree, which was upside down in viewers, in today's form; any other
    unchanged."""
    return data if _GENERATOR.encode() in data[:200] else write_glb(read_glb(data))


def read_glb(data: bytes) -> Mesh:
    """Decode a file of `write_glb`. Raises ValueError for a file that is not of that kind."""
    magic, version, total = _HEADER.unpack_from(data)
    if magic != b"glTF" or version != 2 or total != len(data):
        raise ValueError("not a binary glTF 2.0 file")
    length, _ = _CHUNK.unpack_from(data, _HEADER.size)
    start = _HEADER.size + _CHUNK.size
    document: _Document = orjson.loads(data[start : start + length])
    binary = start + length + _CHUNK.size

    def part(index: int) -> bytes:
        view = document["bufferViews"][index]
        return data[binary + view["byteOffset"] :][: view["byteLength"]]

    def triangles_of(index: int) -> Indices:
        count = document["accessors"][index]["count"]
        return np.frombuffer(part(index), "<u2")[:count].reshape(-1, 3).astype(np.int64)

    up = _Y_UP_AXES if document["asset"]["generator"] == _GENERATOR else _Y_UP_AXES * [1.0, -1.0, -1.0]
    vertices = np.frombuffer(part(0), "<f4").reshape(-1, 3).astype(np.float64) @ up
    normals = np.frombuffer(part(1), "<f4").reshape(-1, 3).astype(np.float64) @ up
    faces: list[Indices] = []
    colours: list[np.ndarray] = []
    for primitive in document["meshes"][0]["primitives"]:
        triangles = triangles_of(primitive["indices"])
        factor = document["materials"][primitive["material"]]["pbrMetallicRoughness"]["baseColorFactor"]
        linear = np.array(factor[:3])
        faces.append(triangles)
        colours.append(np.tile(linear ** (1 / 2.2), (len(triangles), 1)))
    joined = np.concatenate(faces)
    return Mesh(vertices, joined, normals[joined], np.concatenate(colours))


_Y_UP_AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Axes for row vectors: (x, y, z) of a Z-up frame = (X, Y, Z) of the file @ _UP."""
_KEY_FACTORS = np.array([1 << 32, 1 << 20, 1 << 10, 1], dtype=np.int64)
_RGB_FACTORS = np.array([65536, 256, 1], dtype=np.int64)


def _up(points: np.ndarray) -> np.ndarray:
    return points @ _Y_UP_AXES.T


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)


def _rgb(code: int) -> list[float]:
    """Return the colour as linear light, as glTF demands."""
    return [((code >> shift & 255) / 255) ** 2.2 for shift in (16, 8, 0)]


def parts_of(body: BodyRecord) -> tuple[tuple[Shape, Pose], ...]:
    """Return convex shapes with their poses in the body's frame."""
    if not body.blocks:
        return ((body.shape, Pose()),)
    return tuple((Box(block.size), Pose(block.at)) for block in body.blocks)


MAX_LINK_FACES = 2000


def _visible_geometry(urdf: str) -> list[urdf_parser.UrdfMesh | urdf_parser.UrdfPrimitive | LinkShape]:
    """Return the visual geometry, and collision bodies for links without visual geometry."""
    visual = urdf_parser.link_geometry(urdf, "visual")
    seen = {element.link for element in visual}
    return [*visual, *(part for part in link_shapes(urdf) if part.link not in seen)]


@lru_cache(maxsize=4)
def link_meshes(urdf: str) -> tuple[LinkMesh, ...]:
    """Return a mesh for each link that has a shape.

    A link without visual geometry is drawn with its collision geometry. Meshes that were made before come
    from the disk cache. Raises PicktreeError for a mesh that cannot be read: file, link, and a remedy."""
    geometry = _visible_geometry(urdf)
    files = disk_cache.cached_arrays(
        "link-meshes", _inputs(geometry), _MAKERS, lambda: _encoded_links(urdf, geometry)
    )
    return tuple(LinkMesh(link, glb.tobytes()) for link, glb in files.items())


_MAKERS = (
    *(urdf_parser, link_solids, mesh_reader, shapes, values, triangle_meshes, Path(__file__)),
    *("fast-simplification", "numpy", "pycollada", "scipy", "trimesh"),
)
"""Code that `link_meshes` depends on."""


def _inputs(
    geometry: Sequence[urdf_parser.UrdfMesh | urdf_parser.UrdfPrimitive | LinkShape],
) -> Iterator[str | bytes | Path]:
    """Yield all inputs of this geometry's meshes."""
    yield str(MAX_LINK_FACES)
    for element in geometry:
        if isinstance(element, urdf_parser.UrdfMesh):
            path = Path(element.path)
            yield f"{replace(element, path='')} {path.suffix}"
            yield path
            library = mesh_reader.material_library(path) if path.suffix.lower() == ".obj" else None
            yield library if library is not None and library.is_file() else ""
        else:
            yield orjson.dumps(element)


def _encoded_links(
    urdf: str, geometry: Sequence[urdf_parser.UrdfMesh | urdf_parser.UrdfPrimitive | LinkShape]
) -> dict[str, NDArray[np.uint8]]:
    """Return the glTF file of each link's geometry."""
    parts: dict[str, list[Mesh]] = {}
    files: dict[str, Mesh] = {}
    for element in geometry:
        if isinstance(element, urdf_parser.UrdfMesh):
            if element.path not in files:
                try:
                    files[element.path] = load_mesh(element.path, MAX_LINK_FACES)
                except mesh_reader.MeshError as error:
                    refuse_mesh(urdf, element, error)
            mesh = files[element.path].placed(element.pose_in_link, element.scale)
            refuse_size(urdf, element, mesh.vertices)
        else:
            mesh = shape_mesh(element.shape).placed(element.pose_in_link)
        parts.setdefault(element.link, []).append(mesh)
    return {link: np.frombuffer(write_glb(_drawable(m)), np.uint8) for link, m in parts.items()}


def _drawable(parts: Sequence[Mesh]) -> Mesh:
    """Return the meshes of a link as one; its convex hull where it is too fine and cannot be decimated."""
    whole = join_meshes(parts)
    if 3 * len(whole.faces) <= _MAX_VERTICES:
        return whole
    corners = mesh_reader.hull_corners(whole.vertices)
    return shape_mesh(ConvexMesh(tuple((x, y, z) for x, y, z in corners.tolist()), ""))
