"""Triangle meshes for display: read from files, made of shapes, and decimated for the log."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from picktree.world import (
    Array,
    Box,
    CompoundMesh,
    ConvexMesh,
    Cylinder,
    Pose,
    Shape,
    Sphere,
    Vector3,
    convex_hull,
    convex_parts,
    mesh_reader,
)
from picktree.world.scene import Hole

Indices = NDArray[np.int64]

_WELD_DISTANCE = 1e-6
"""Distance below which two vertices are merged, m."""
_MIN_AREA = 1e-14
"""Length of a face's normal below which the face is dropped, m²."""
_AGGRESSION = 2.5
"""Exponent with which the bound of the error grows from pass to pass of a decimation.

A higher one always reaches the number of faces, but finely curved links lose their shape.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangle mesh: vertices (n, 3) m, faces (m, 3), normals of each face's corners (m, 3, 3), colours of
    faces (m, 3)."""

    vertices: Array
    faces: Indices
    normals: Array
    colours: Array

    def placed(self, pose: Pose, scale: Vector3 = (1.0, 1.0, 1.0)) -> Mesh:
        """Return the mesh scaled, then transformed into the frame in which `pose` is given."""
        rotation = pose.rotation()
        normals = (self.normals / np.array(scale)) @ rotation.T
        return Mesh(pose.apply(self.vertices * np.array(scale)), self.faces, unit(normals), self.colours)

    def coloured(self, colour: tuple[float, float, float]) -> Mesh:
        return Mesh(self.vertices, self.faces, self.normals, np.tile(np.array(colour), (len(self.faces), 1)))


def unit(vectors: Array) -> Array:
    """Return vectors (…, 3) scaled to length 1; a zero vector stays."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(lengths > 0, lengths, 1.0)


def join_meshes(meshes: Iterable[Mesh]) -> Mesh:
    """Return one mesh of all; empty without meshes."""
    parts = list(meshes)
    if not parts:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros((0, 3, 3)), np.zeros((0, 3)))
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + o for part, o in zip(parts, offsets, strict=True)]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.colours for part in parts]),
    )


def smooth_mesh(vertices: Array, faces: Indices, colours: Array, crease: float = 0.7) -> Mesh:
    """Return a mesh with corner normals: averaged over the faces around a vertex unless the edge is a crease.

    `crease` is the cosine of the angle beyond which a face keeps its own normal.
    """
    corners = vertices[faces]
    areas = _areas(corners)
    own = unit(areas)
    sums = np.zeros_like(vertices)
    for axis in range(3):
        shares = np.repeat(areas[:, axis], 3)
        sums[:, axis] = np.bincount(faces.ravel(), weights=shares, minlength=len(vertices))
    mean = unit(sums)[faces]
    soft = np.einsum("fci,fi->fc", mean, own) > crease
    return Mesh(vertices, faces, np.where(soft[:, :, None], mean, own[:, None, :]), colours)


def _areas(corners: Array) -> Array:
    """Return the normal of each triangle (n, 3, 3) with twice its area as length, (n, 3)."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    x = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    y = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    z = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return np.stack([x, y, z], axis=1)


def decimate(vertices: Array, faces: Indices, colours: Array, most: int) -> tuple[Array, Indices, Array]:
    """Reduce a mesh to about `most` faces: vertices (n, 3), faces (m, 3) and the faces' colours (m, 3).

    Open borders and borders between two colours stay. A mesh that would lose its shape keeps more faces.
    Quadric error metrics (Garland & Heckbert 1997).
    """
    if len(faces) <= most:
        return vertices, faces, colours
    from fast_simplification import simplify  # slow to import

    cells = np.round(vertices / _WELD_DISTANCE)
    _, first, place = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    welded = first[place.ravel()][faces]
    solid = np.linalg.norm(_areas(vertices[welded]), axis=1) > _MIN_AREA
    welded, colours = welded[solid], colours[solid]
    # Each colour has vertices of its own, so that its edge is a border.
    _, colour = np.unique(colours, axis=0, return_inverse=True)
    corners, index = np.unique(colour.reshape(-1, 1) * len(vertices) + welded, return_inverse=True)
    index = index.reshape(-1, 3)
    points = vertices[corners % len(vertices)]
    size = np.linalg.norm(np.ptp(points, axis=0))
    points, thinned, collapses = simplify(
        points / size,
        index.astype(np.int32),
        target_count=min(most, len(index)),
        agg=_AGGRESSION,
        return_collapses=True,
        preserve_border=True,
    )
    kept = np.arange(len(corners))
    for stays, goes in collapses[::-1].tolist():
        kept[goes] = kept[stays]
    a, b, c = kept[index].T  # the faces that are left are those with three vertices, in their old order
    return points * size, thinned.astype(np.int64), colours[(a != b) & (b != c) & (c != a)]


def load_mesh(path: str, most: int) -> Mesh:
    """Read a mesh file, decimated to about `most` faces, in its own frame. Raises MeshError."""
    mesh = mesh_reader.read_mesh(Path(path))
    return smooth_mesh(*decimate(mesh.vertices, mesh.faces, mesh.colours, most))


def part_mesh(
    shape: Shape, holes: tuple[Hole, ...], colour: tuple[float, float, float] = mesh_reader.DEFAULT_COLOUR
) -> Mesh:
    """Return the surface of a part that never moves, in its own frame; a box may have holes."""
    if not holes or not isinstance(shape, Box):
        return shape_mesh(shape, colour)
    from picktree.world import hole_geometry

    seen = hole_geometry.surface(shape, holes)
    faces = np.arange(len(seen.corners), dtype=np.int64).reshape(-1, 3)
    colours = np.tile(np.array(colour), (len(faces), 1))
    return Mesh(seen.corners, faces, seen.normals.reshape(-1, 3, 3), colours)


def shape_mesh(shape: Shape, colour: tuple[float, float, float] = mesh_reader.DEFAULT_COLOUR) -> Mesh:
    """Return the surface of a shape in its own frame."""
    match shape:
        case Box(size):
            vertices, faces = _box(size)
        case Cylinder(radius, height):
            vertices, faces = _surface_of_revolution([(0.0, -1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 1.0)], 48)
            vertices = vertices * np.array([radius, radius, height / 2])
        case Sphere(radius):
            angles = np.linspace(-math.pi / 2, math.pi / 2, 25)[1:-1]
            rings = [(math.cos(a), math.sin(a)) for a in angles]
            vertices, faces = _surface_of_revolution([(0.0, -1.0), *rings, (0.0, 1.0)], 48)
            vertices = vertices * radius
        case CompoundMesh():
            return join_meshes([shape_mesh(part, colour) for part in convex_parts(shape)])
        case ConvexMesh():
            vertices = np.array(shape.vertices)
            faces = convex_hull(vertices).simplices.astype(np.int64)
            corners = vertices[faces]
            outward = np.einsum("fi,fi->f", _areas(corners), corners.mean(axis=1) - vertices.mean(axis=0))
            faces = np.where(outward[:, None] > 0, faces, faces[:, ::-1])
    return smooth_mesh(vertices, faces, np.tile(np.array(colour), (len(faces), 1)))


def _box(size: Vector3) -> tuple[Array, Indices]:
    vertices = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    # Each side has its own vertices: a box has no smooth edge.
    faces = [(4 * k + a, 4 * k + b, 4 * k + c) for k in range(6) for a, b, c in ((0, 1, 2), (0, 2, 3))]
    return vertices[np.array(quads).ravel()] * np.array(size), np.array(faces, dtype=np.int64)


def _surface_of_revolution(profile: list[tuple[float, float]], around: int) -> tuple[Array, Indices]:
    """Return the surface of revolution of a profile of (radius, height), from below upwards, around z."""
    angles = np.arange(around) * (2 * math.pi / around)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices = np.concatenate([np.column_stack([ring * r, np.full(around, z)]) for r, z in profile])
    faces: list[tuple[int, int, int]] = []
    for level in range(len(profile) - 1):
        for k in range(around):
            a, b = level * around + k, level * around + (k + 1) % around
            c, d = a + around, b + around
            if profile[level][0] > 0:
                faces.append((a, b, d))
            if profile[level + 1][0] > 0:
                faces.append((a, d, c))
    return vertices, np.array(faces, dtype=np.int64)
