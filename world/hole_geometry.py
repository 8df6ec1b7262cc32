"""Holes: the solid of a box with holes as convex pieces and visible surface, and the one rule which item
belongs into which hole.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TypeAlias

import numpy as np

from picktree.world.scene import Fixture, Hole

from .causes import Failure, world
from .planning_scene import PlanningScene
from .shapes import Box, ConvexMesh, Cylinder, Shape, Sphere, convex_hull
from .values import Array, Pose

ROUND_HOLE_SIDES = 32
"""Sides of a round hole's outline; the circle that counts touches each of them from inside."""
MIN_WALL = 0.001
"""Least wall between two holes' mouths, and from one to the sides of the box, m."""
MIN_AREA = 1e-10
"""Area below which a polygon counts as empty, m²."""
Polygon: TypeAlias = Array
"""Corners (n, 2), counter-clockwise and convex, in the fixture's frame, m."""


@dataclass(frozen=True, slots=True)
class InterlockedHoles:
    """Holes of one box that no straight cut parts from one another."""

    holes: tuple[Hole, ...]


def outline(hole: Hole, grown: float = 0.0) -> Polygon:
    """Return the walls from above, in the fixture's frame, moved outwards by `grown` m."""
    if hole.form == "round":
        reach = (hole.size[0] / 2 + grown) / math.cos(math.pi / ROUND_HOLE_SIDES)
        angles = (np.arange(ROUND_HOLE_SIDES) + 0.5) * (2 * math.pi / ROUND_HOLE_SIDES)
        corners = reach * np.column_stack([np.cos(angles), np.sin(angles)])
    else:
        x, y = hole.size[0] / 2 + grown, hole.size[1] / 2 + grown
        corners = np.array([(x, y), (-x, y), (-x, -y), (x, -y)])
    turn = hole.pose.rotation()[:2, :2]
    return corners @ turn.T + np.array(hole.pose.position[:2])


def convex_pieces(fixture: Fixture) -> tuple[tuple[ConvexMesh, Pose], ...]:
    """Return convex pieces that together are the solid of the fixture, with their poses in its frame.

    The fixture is a box, and its holes were checked on reading.
    """
    assert isinstance(fixture.shape, Box)
    return _bored(fixture.shape, fixture.holes)


def layered_pieces(box: Box, holes: Sequence[Hole]) -> tuple[tuple[ConvexMesh, Pose], ...]:
    """Return the same solid as other pieces, cut also at the height of each bottom. No face of a piece is
    then partly hidden by another piece."""
    return _bored(box, tuple(holes), layers=True)


@cache
def _bored(box: Box, holes: tuple[Hole, ...], *, layers: bool = False) -> tuple[tuple[ConvexMesh, Pose], ...]:
    plots = partition_top(box, holes)
    assert not isinstance(plots, InterlockedHoles)
    pieces: list[tuple[ConvexMesh, Pose]] = []
    top = box.size[2] / 2
    for plot, hole in plots:
        if hole is None:
            pieces.append(_prism(plot, -top, top))
            continue
        bottom = top - hole.depth
        if bottom < -top + 1e-6:
            pieces += _wedges(plot, hole, -top, top)
            continue
        pieces.append(_prism(outline(hole), -top, bottom))
        if layers:
            pieces += _wedges(plot, replace(hole, chamfer=0.0), -top, bottom)
        pieces += _wedges(plot, hole, bottom if layers else -top, top)
    return tuple(pieces)


def partition_top(box: Box, holes: Sequence[Hole]) -> list[tuple[Polygon, Hole | None]] | InterlockedHoles:
    """Return the box from above, cut into polygons with at most one hole each."""
    x, y, _ = box.size
    whole = np.array([(x, y), (-x, y), (-x, -y), (x, -y)]) / 2
    return _parted(whole, tuple(holes))


def _parted(plot: Polygon, holes: tuple[Hole, ...]) -> list[tuple[Polygon, Hole | None]] | InterlockedHoles:
    if len(holes) < 2:
        return [(plot, holes[0] if holes else None)]
    cut = _cut(holes)
    if cut is None:
        return InterlockedHoles(holes)
    normal, at = cut
    below = tuple(h for h in holes if float(np.dot(h.pose.position[:2], normal)) < at)
    above = tuple(h for h in holes if h not in below)
    parts: list[tuple[Polygon, Hole | None]] = []
    for side, inside in ((1.0, below), (-1.0, above)):
        found = _parted(_clipped(plot, side * normal, side * at), inside)
        if isinstance(found, InterlockedHoles):
            return found
        parts += found
    return parts


def _cut(holes: Sequence[Hole]) -> tuple[Array, float] | None:
    """Return unit normal (2,) and offset of the line through the widest gap between the holes' mouths.
    None when no line along the sides of the box or of a hole passes between them."""
    best: tuple[float, Array, float] | None = None
    yaws = {0.0, *(_yaw(hole) for hole in holes)}
    mouths = [outline(hole, hole.chamfer) for hole in holes]
    for yaw in sorted(yaws):
        for normal in (
            np.array([math.cos(yaw), math.sin(yaw)]),
            np.array([-math.sin(yaw), math.cos(yaw)]),
        ):
            spans = sorted((float((m @ normal).min()), float((m @ normal).max())) for m in mouths)
            reach = spans[0][1]
            for low, high in spans[1:]:
                if low - reach > (best[0] + 1e-9 if best is not None else 1e-6):
                    best = (low - reach, normal, (low + reach) / 2)
                reach = max(reach, high)
    return None if best is None else best[1:]


def wall_thickness(one: Hole, other: Hole) -> float:
    """Return the thickness of the wall between the mouths of two holes, chamfers included, m; 0 or less where
    they overlap.

    Exact when a nearest point is on a side; a little too small between two corners.
    """
    mouths = (outline(one, one.chamfer), outline(other, other.chamfer))
    best = -math.inf
    for mine, theirs in (mouths, mouths[::-1]):
        for k in range(len(mine)):
            normal = _outward(mine[k - 1], mine[k])
            best = max(best, float((theirs @ normal).min() - mine[k] @ normal))
    return best


def _yaw(hole: Hole) -> float:
    rotation = hole.pose.rotation()
    return math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))


def _wedges(plot: Polygon, hole: Hole, low: float, high: float) -> list[tuple[ConvexMesh, Pose]]:
    """Return the pieces of a plot around its hole, between two heights."""
    corners = outline(hole)
    pieces: list[tuple[ConvexMesh, Pose]] = []
    for k in range(len(corners)):
        one, other = corners[k], corners[(k + 1) % len(corners)]
        outward = _outward(one, other)
        before, after = _outward(corners[k - 1], one), _outward(other, corners[(k + 2) % len(corners)])
        # Along a bisector the distance to both sides that meet there is the same.
        cuts = ((before - outward, one), (after - outward, other), (-outward, one))
        wedge = plot
        for normal, point in cuts:
            wedge = _clipped(wedge, normal, float(normal @ point))
        if _area(wedge) < MIN_AREA:
            continue
        if hole.chamfer <= 0.0:
            pieces.append(_prism(wedge, low, high))
            continue
        bevelled = _clipped(wedge, -outward, float(-outward @ one) - hole.chamfer)
        heights = ((wedge, low), (wedge, high - hole.chamfer), (bevelled, high))
        pieces.append(_hull(heights))
    return pieces


def _outward(one: Array, other: Array) -> Array:
    """Unit normal (2,) to the right of the side from one corner to the next."""
    x, y = other - one
    return np.array([y, -x]) / math.hypot(x, y)


def _clipped(polygon: Polygon, normal: Array, most: float) -> Polygon:
    """Return the part of a convex polygon with `normal` · point ≤ `most` (Sutherland and Hodgman, 1974)."""
    kept: list[Array] = []
    distances = polygon @ normal - most
    for k in range(len(polygon)):
        here, there = float(distances[k - 1]), float(distances[k])
        if (here < 0.0 < there) or (there < 0.0 < here):
            share = here / (here - there)
            kept.append(polygon[k - 1] + share * (polygon[k] - polygon[k - 1]))
        if there <= 0.0:
            kept.append(polygon[k])
    return np.array(kept).reshape(-1, 2)


def _area(polygon: Polygon) -> float:
    if len(polygon) < 3:
        return 0.0
    x, y = polygon.T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def _prism(polygon: Polygon, low: float, high: float) -> tuple[ConvexMesh, Pose]:
    return _hull(((polygon, low), (polygon, high)))


def _hull(levels: Iterable[tuple[Polygon, float]]) -> tuple[ConvexMesh, Pose]:
    """Return the hull of polygons at heights, about the middle of its corners."""
    corners = np.unique(np.vstack([np.column_stack([p, np.full(len(p), z)]) for p, z in levels]), axis=0)
    x, y, z = (float(c) for c in corners.mean(axis=0))
    around = corners - (x, y, z)
    return ConvexMesh(tuple((float(a), float(b), float(c)) for a, b, c in around), ""), Pose((x, y, z))


VISIBILITY_OFFSET = 1e-6
"""A face is seen unless this much above its middle is inside another piece, m."""
TOLERANCE = 1e-8
"""Distance outside a piece up to which a point counts as inside, m: faces of pieces meet."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Triangles in the box's frame, counter-clockwise from outside, each with corners of its own."""

    corners: Array
    """(3n, 3), m"""
    normals: Array
    """(3n, 3), of the corner's triangle."""


@cache
def surface(box: Box, holes: tuple[Hole, ...]) -> Surface:
    """Return the visible surface of a box with holes, their insides included."""
    solids = [at.apply(np.array(piece.vertices)) for piece, at in layered_pieces(box, holes)]
    hulls = [(points, convex_hull(points)) for points in solids]
    corners: list[Array] = []
    normals: list[Array] = []
    for n, (points, hull) in enumerate(hulls):
        outward = hull.equations[:, :3]
        triangles = points[hull.simplices]
        # Where the corners run clockwise from outside two of them change places.
        across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        clockwise = np.einsum("ij,ij->i", across, outward) < 0.0
        triangles[clockwise] = triangles[clockwise][:, ::-1]
        above = triangles.mean(axis=1) + VISIBILITY_OFFSET * outward
        hidden = np.zeros(len(triangles), dtype=np.bool_)
        for other, (_, solid) in enumerate(hulls):
            if other != n:
                hidden |= (solid.equations[:, :3] @ above.T + solid.equations[:, 3:] < TOLERANCE).all(axis=0)
        corners.append(triangles[~hidden].reshape(-1, 3))
        normals.append(np.repeat(outward[~hidden], 3, axis=0))
    return Surface(np.vstack(corners), np.vstack(normals))


Slack: TypeAlias = tuple[float, float]
"""Excess of the hole's width over the item's, along the hole's long side and across, m."""


def hole_clearance(hole: Hole, shape: Shape) -> Slack | None:
    """Return the clearance of an item in the hole, on both sides together; negative where it is too wide.
    None when their forms do not fit. Cylinders and spheres go into round holes, boxes into square holes and
    slots, meshes into none."""
    match shape:
        case Cylinder(radius, _) | Sphere(radius) if hole.form == "round":
            return hole.size[0] - 2 * radius, hole.size[1] - 2 * radius
        case Box((x, y, _)) if hole.form != "round":
            long, wide = max(hole.size), min(hole.size)
            return long - max(x, y), wide - min(x, y)
        case _:
            return None


def fits_hole(hole: Hole, shape: Shape) -> bool:
    """Whether an item of that shape goes into the hole with room on every side."""
    left = hole_clearance(hole, shape)
    return left is not None and min(left) > 0.0


def tightest_hole(holes: Iterable[Hole], shape: Shape) -> Hole | None:
    """Return the tightest hole that the item fits; None when it fits none."""
    loose = [
        (max(hole_clearance(hole, shape) or (0.0, 0.0)), n, hole)
        for n, hole in enumerate(holes)
        if fits_hole(hole, shape)
    ]
    return min(loose)[2] if loose else None


def named_holes(fixtures: Iterable[Fixture], name: str) -> tuple[Hole, ...] | None:
    """Return the holes of a name such as `board` or `board/left`: all holes of a fixture, or one. None for
    any other name."""
    for fixture in fixtures:
        if fixture.holes and fixture.id == name:
            return fixture.holes
        for hole in fixture.holes:
            if hole.id == name:
                return (hole,)
    return None


def find_hole(scene: PlanningScene, hole_id: str) -> tuple[Fixture, Hole]:
    """Return the hole of that id and its fixture. Raises Failure(world.unknown_object)."""
    for fixture in scene.fixtures.values():
        for hole in fixture.holes:
            if hole.id == hole_id:
                return fixture, hole
    known = [str(hole.id) for fixture in scene.fixtures.values() for hole in fixture.holes]
    raise Failure(world.UNKNOWN_OBJECT, f"the scene has no hole {hole_id!r}", object=hole_id, known=known)


def hole_in_world(scene: PlanningScene, hole_id: str) -> Pose:
    """Return the believed pose of the middle of the hole's mouth; z points out of the hole.

    Raises Failure(world.unknown_object).
    """
    fixture, hole = find_hole(scene, hole_id)
    return fixture.pose @ hole.pose


def occupied(scene: PlanningScene, hole_id: str) -> bool:
    """Whether an object is believed to be in the hole."""
    return any(o.place == hole_id for o in scene.objects)


def fitting_hole(scene: PlanningScene, object_id: str, into: str | None = None) -> Hole | None:
    """Return the free hole into which the object fits with the least clearance.

    `into` is a fixture with holes, or one hole; default: the object's destination. None when it has no holes,
    or no free hole that fits the object. Raises Failure(world.unknown_object).
    """
    target = into if into is not None else scene.destination(object_id)
    holes = None if target is None else named_holes(scene.fixtures.values(), target)
    if holes is None:
        return None
    taken = {o.place for o in scene.objects if o.id != object_id}
    return tightest_hole((hole for hole in holes if hole.id not in taken), scene.get(object_id).shape)
