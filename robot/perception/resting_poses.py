"""Stable poses of the catalogue's items on a level support."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.files import disk_cache
from picktree.world import (
    Array,
    Box,
    CompoundMesh,
    ConvexMesh,
    Cylinder,
    Pose,
    Shape,
    Sphere,
    convex_hull,
    half_spaces,
    inside,
    shapes,
    top_heights,
)
from picktree.world.scene import CatalogueEntry

CANVAS = 512
"""Pixels of the longer side of the picture in which covered area is counted."""


def next_corners(polygon: Array) -> Array:
    """Return the corner (k, 2) that follows each one of a polygon."""
    return np.concatenate([polygon[1:], polygon[:1]])


def polygon_area(polygon: Array) -> float:
    """Return the area of a polygon, corners (k, 2), in squares of their unit."""
    following = next_corners(polygon)
    return 0.5 * abs(float((polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1]).sum()))


def covered_area(polygons: Sequence[Array]) -> float:
    """Return the area that convex polygons, corners (k, 2) each, cover together: of several to about 1 %."""
    if len(polygons) == 1:
        return polygon_area(polygons[0])
    together = np.concatenate(polygons)
    low, high = together.min(axis=0), together.max(axis=0)
    scale = CANVAS / max(float((high - low).max()), 1e-9)
    canvas = np.zeros((CANVAS + 1, CANVAS + 1), np.uint8)
    for polygon in polygons:
        cv2.fillConvexPoly(canvas, np.asarray(np.round((polygon - low) * scale), np.int32), 1)
    # A filled polygon has the pixels of its border, too: half of a pixel more on all sides.
    edge = cv2.erode(canvas, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return float(int(canvas.sum()) + int(edge.sum())) / 2.0 / scale**2


LOOK_TOLERANCE = 0.01
"""Difference of two outlines that look the same, as a share of the largest extent of a body."""
CIRCLE_CORNERS = 16
"""Number of corners of the polygon that approximates a circle."""
TOP_CELLS, LEAST_TOP_QUANTILE = 24, 0.5
"""Cells along each side of a body's height map, and the quantile of its heights that its top may seem to be.
Sides that are seen from aslant add to the lower ones."""


@dataclass(frozen=True, eq=False)
class StablePose:
    """Catalogue entry lying on one of its faces, up to a turn `yaw` about the vertical."""

    entry: CatalogueEntry
    rotation: Array
    """Orientation at yaw 0 (3, 3)."""
    outline: Array
    """Points (n, 3) about the centre at yaw 0 whose hull contains the body; empty for a sphere."""
    below: float
    """Distance from the centre down to the support, m."""
    height: float
    """Height from the support to the top, m."""
    turn: float
    """Turn about the vertical that looks the same, rad; 0 for a body of revolution."""
    reach: float
    """Radius of the circle about the vertical axis that contains the body, m."""
    footprint: float
    """Area of the shadow under light from straight above, m²."""
    unlikely: float = 0.0
    """Addition to the misfit, for faces on which items are seldom found."""

    @cached_property
    def least_top(self) -> float:
        """Least height above the support of most visible points, m: a cup shows its floor."""
        mesh = self.entry.shape
        if not isinstance(mesh, CompoundMesh):
            return self.height
        low, high = self.outline[:, :2].min(axis=0), self.outline[:, :2].max(axis=0)
        share = np.arange(TOP_CELLS**2)
        steps = np.column_stack([share // TOP_CELLS, share % TOP_CELLS]) / (TOP_CELLS - 1)
        pose = Pose.from_rotation((0.0, 0.0, self.below), self.rotation)
        heights = top_heights(mesh, pose, low + (high - low) * steps)
        return float(np.quantile(heights[np.isfinite(heights)], LEAST_TOP_QUANTILE))

    @cached_property
    def parts(self) -> tuple[Array, ...]:
        """Points (n, 3) of each convex part, as `outline` has them; empty for a convex body."""
        mesh = self.entry.shape
        if not isinstance(mesh, CompoundMesh):
            return ()
        return tuple(np.array(part) @ self.rotation.T for part in mesh.parts)


def catalogue_poses(catalogue: Iterable[CatalogueEntry]) -> tuple[StablePose, ...]:
    """Return the stable poses of all entries. Those that were found before come from the disk cache."""
    entries = tuple(catalogue)
    bodies = (e.shape for e in entries)
    inputs = (str(replace(b, source="") if isinstance(b, ConvexMesh) else b) for b in bodies)
    kept = disk_cache.cached_arrays("stable-poses", inputs, _MAKERS, lambda: _encoded(entries))
    poses: list[StablePose] = []
    for n, (number, *values) in enumerate(kept["values"].tolist()):
        rotation, outline = kept[f"{n} rotation"], kept[f"{n} outline"]
        poses.append(StablePose(entries[int(number)], rotation, outline, *values))
    return tuple(poses)


_MAKERS: Final = (Path(__file__), shapes, "numpy", "scipy")
"""Code that the stable poses depend on."""


def _encoded(entries: Sequence[CatalogueEntry]) -> dict[str, Array]:
    """Return rotation and outline of each stable pose by its number, and a row with all other values."""
    arrays: dict[str, Array] = {}
    rows: list[tuple[float, ...]] = []
    for number, entry in enumerate(entries):
        for p in stable_poses(entry):
            arrays[f"{len(rows)} rotation"], arrays[f"{len(rows)} outline"] = p.rotation, p.outline
            rows.append((number, p.below, p.height, p.turn, p.reach, p.footprint, p.unlikely))
    return {**arrays, "values": np.array(rows).reshape(-1, 7)}


def stable_poses(entry: CatalogueEntry) -> tuple[StablePose, ...]:
    """Return all stable ways in which the entry can lie on a level support, up to a turn about the
    vertical."""
    shape = entry.shape
    match shape:
        case Sphere(radius):
            return (
                StablePose(
                    entry, np.eye(3), np.zeros((0, 3)), radius, 2 * radius, 0.0, radius, math.pi * radius**2
                ),
            )
        case Cylinder():
            lying = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
            return (
                _stable_pose(entry, np.eye(3), 0.0, 0.0),
                _stable_pose(entry, lying, math.pi, 0.0),
            )
        case Box(size):
            return tuple(_box_poses(entry, size))
        case ConvexMesh():
            return tuple(_mesh_poses(entry, shape))


LEAN_ANGLES = tuple(math.radians(angle) for angle in (15, 25, 35, 45, 55, 65, 75))
"""Angles between the axis of a leaning cylinder and the vertical, rad."""
LEANING_HANDICAP = 0.3
"""Addition to the misfit of a leaning item: most items lie on a face."""


@cache
def leaning_poses(entry: CatalogueEntry) -> tuple[StablePose, ...]:
    """Return the entry leaning on something else, for cylinders: nothing else rolls up another item."""
    if not isinstance(entry.shape, Cylinder):
        return ()
    turns = (Pose.from_rpy((0.0, 0.0, 0.0), (0.0, lean, 0.0)).rotation() for lean in LEAN_ANGLES)
    return tuple(
        replace(_stable_pose(entry, turn, 0.0, LEANING_HANDICAP), turn=2 * math.pi) for turn in turns
    )


def _stable_pose(entry: CatalogueEntry, rotation: Array, turn: float, unlikely: float) -> StablePose:
    outline = body_points(entry.shape) @ rotation.T
    low, high = float(outline[:, 2].min()), float(outline[:, 2].max())
    if isinstance(entry.shape, Cylinder) and turn:
        low, high = -entry.shape.radius, entry.shape.radius
    reach = float(np.hypot(outline[:, 0], outline[:, 1]).max())
    footprint = float(convex_hull(outline[:, :2]).volume)
    if isinstance(entry.shape, CompoundMesh):
        shadows = [(np.array(part) @ rotation.T)[:, :2] for part in entry.shape.parts]
        footprint = covered_area([shadow[convex_hull(shadow).vertices] for shadow in shadows])
    return StablePose(entry, rotation, outline, -low, high - low, turn, reach, footprint, unlikely)


def body_points(shape: Shape) -> Array:
    """Return points (n, 3) whose hull is the shape; a circle becomes a polygon of its area. A sphere has
    none."""
    match shape:
        case Box(size):
            signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
            return signs * np.array(size) / 2
        case Cylinder(radius, height):
            step = 2 * math.pi / CIRCLE_CORNERS
            ring = radius * math.sqrt(step / math.sin(step))
            angles = np.arange(CIRCLE_CORNERS) * step
            circle = np.stack([ring * np.cos(angles), ring * np.sin(angles)], axis=1)
            return np.concatenate(
                [np.column_stack([circle, np.full(CIRCLE_CORNERS, z)]) for z in (-height / 2, height / 2)]
            )
        case Sphere():
            return np.zeros((0, 3))
        case ConvexMesh():
            points = np.array(shape.vertices)
            return points[convex_hull(points).vertices]


def part_points(shape: Shape) -> list[Array]:
    """Return points (n, 3) of each convex part of a shape, whose hulls cover its visible surface."""
    match shape:
        case Sphere(radius):
            return [body_points(Box((2 * radius, 2 * radius, 2 * radius)))]
        case CompoundMesh(parts=parts):
            return list(map(np.array, parts))
        case _:
            return [body_points(shape)]


def _box_poses(entry: CatalogueEntry, size: tuple[float, float, float]) -> list[StablePose]:
    """Return one stable pose for each different edge length that can be vertical, the longer side along x."""
    found: list[StablePose] = []
    heights: list[float] = []
    for up in (2, 0, 1):
        if any(abs(size[up] - h) < 1e-4 for h in heights):
            continue
        heights.append(size[up])
        a, b = (i for i in range(3) if i != up)
        if size[a] < size[b]:
            a, b = b, a
        rotation = np.zeros((3, 3))
        rotation[0, a], rotation[1, b], rotation[2, up] = 1.0, 1.0, 1.0
        rotation[1] *= np.linalg.det(rotation)
        turn = math.pi / 2 if abs(size[a] - size[b]) < 1e-4 else math.pi
        slender = size[up] > 2.5 * min(size[a], size[b])
        found.append(_stable_pose(entry, rotation, turn, 0.3 if slender else 0.0))
    return found


def _mesh_poses(entry: CatalogueEntry, mesh: ConvexMesh) -> list[StablePose]:
    """Return one stable pose for each face above which the centroid is, alike ones once.

    A body rolls from a narrow facet to the next. It rests on such facets where it looks the same on the next.
    """
    normals, offsets = half_spaces(mesh)
    points = np.array(mesh.vertices)
    on_face = np.abs(points @ normals.T - offsets) < 1e-5

    @cache
    def pose_on(face: int) -> StablePose:
        rotation = _rotation_face_down(normals[face])
        return _stable_pose(entry, rotation, _symmetry_turn(mesh, rotation), 0.0)

    found: list[StablePose] = []
    for face in range(len(normals)):
        corners = np.flatnonzero(on_face[:, face])
        if len(corners) < 3:
            continue
        edges, inside = _edges_below(points[corners] @ _rotation_face_down(normals[face]).T)
        if inside.min() <= 0.0:
            continue
        one = pose_on(face)
        if any(_looks_like(one, other) for other in found):
            continue
        narrow = corners[edges[inside < MIN_SUPPORT]]
        beyond = [np.flatnonzero(on_face[edge].all(axis=0)) for edge in narrow]
        if all(any(_looks_like(one, pose_on(int(k))) for k in faces if k != face) for faces in beyond):
            found.append(one)
    return found


def _symmetry_turn(mesh: ConvexMesh, rotation: Array) -> float:
    """Return the smallest turn about the vertical that takes the body to itself, rad; 0: any turn does."""
    points = np.array(mesh.vertices) @ rotation.T
    normals, offsets = half_spaces(mesh)
    faces = normals @ rotation.T
    offsets = offsets + LOOK_TOLERANCE * float(np.ptp(points[:, :2], axis=0).max())
    if _all_inside(points, ROUND_TURNS, faces, offsets) and _fills_alike(mesh, rotation, ROUND_TURNS):
        return 0.0
    turns = (2 * math.pi / times for times in (12, 10, 8, 6, 5, 4, 3, 2))
    alike = (t for t in turns if _all_inside(points, (t,), faces, offsets))
    return next((t for t in alike if _fills_alike(mesh, rotation, (t,))), 2 * math.pi)


ROUND_TURNS = (0.05, 0.1, 0.2, 0.35, 0.55, 0.8, 1.1, 1.45)
"""Turns about the vertical after which a round body looks the same, rad."""
PART_TOLERANCE = 1.5e-3
"""Distance by which parts of a body may differ from those of the turned one, m: parts are about right."""


def _fills_alike(mesh: ConvexMesh, rotation: Array, turns: Iterable[float]) -> bool:
    """Whether the parts of a body fill the same room after each of these turns about the vertical."""
    if not isinstance(mesh, CompoundMesh):
        return True
    points = np.array([vertex for part in mesh.parts for vertex in part]) @ rotation.T
    return all(
        bool(inside(mesh, Pose(), _turned(points, turn) @ rotation, PART_TOLERANCE).all()) for turn in turns
    )


def _looks_like(one: StablePose, other: StablePose) -> bool:
    """Whether both look the same, as on equal faces of a symmetric body."""
    mesh = other.entry.shape
    assert isinstance(mesh, ConvexMesh)
    tolerance = LOOK_TOLERANCE * float(np.ptp(mesh.vertices, axis=0).max())
    if abs(one.height - other.height) > tolerance or abs(one.below - other.below) > tolerance:
        return False
    normals, offsets = half_spaces(mesh)
    normals, offsets = normals @ other.rotation.T, offsets + tolerance
    radii = np.hypot(one.outline[:, 0], one.outline[:, 1])
    far = one.outline[int(radii.argmax())]
    start = math.atan2(far[1], far[0])
    alike = np.abs(np.hypot(other.outline[:, 0], other.outline[:, 1]) - radii.max()) < tolerance
    turns = (math.atan2(to[1], to[0]) - start for to in other.outline[alike])
    return any(_all_inside(one.outline, (turn,), normals, offsets) for turn in turns)


def _turned(points: Array, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _all_inside(points: Array, turns: Iterable[float], normals: Array, offsets: Array) -> bool:
    """Whether points (n, 3) are inside of half-spaces after each of these turns about the vertical."""
    return all((_turned(points, turn) @ normals.T < offsets).all() for turn in turns)


def _rotation_face_down(normal: Array) -> Array:
    """Return a rotation that turns `normal` to (0, 0, -1)."""
    z = -normal
    x = np.eye(3)[int(np.abs(z).argmin())]
    x = x - z * float(x @ z)
    x /= np.linalg.norm(x)
    return np.asarray(np.stack([x, np.cross(z, x), z]), dtype=np.float64)


MIN_SUPPORT: Final = 1e-3
"""Distance inside the polygon of a face at which the centroid has to be above it, m."""


def _edges_below(face: Array) -> tuple[NDArray[np.intp], Array]:
    """Return the edges (k, 2) of the polygon of face (n, 3), and the distance of the origin inside each (k,),
    m."""
    hull = convex_hull(face[:, :2])
    return hull.simplices, -hull.equations[:, 2]
