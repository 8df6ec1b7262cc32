"""Outlines of bodies seen from above: distances between them, and the height of the support below a point."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from picktree.world import Array, Box, Cylinder, Pose, Quaternion, Shape, Sphere, bottom, corners, top
from picktree.world.scene import Fixture

Point: TypeAlias = tuple[float, float]
FLOOR_DEPTH = 0.75
"""Depth of the room's floor below the lowest of robot base and fixtures, m."""


@dataclass(frozen=True, slots=True)
class Footprint:
    """A convex polygon, counter-clockwise about `centre`, grown by `radius`; a circle is one point."""

    polygon: tuple[Point, ...]
    radius: float
    centre: Point
    reach: float
    """Radius of the circle about the centre that encloses it, m."""

    def at(self, centre: Sequence[float] | Array) -> Footprint:
        """Return the outline moved to another centre."""
        x, y = float(centre[0]), float(centre[1])
        return Footprint(self.polygon, self.radius, (x, y), self.reach)


def footprint(shape: Shape, orientation: Quaternion) -> Footprint:
    """Return the outline of `shape` turned by `orientation`, centred at the origin."""
    rotation = Pose(orientation=orientation).rotation()
    match shape:
        case Sphere(radius):
            return Footprint(((0.0, 0.0),), radius, (0.0, 0.0), radius)
        case Cylinder(radius, _) if abs(rotation[2, 2]) > 0.999:
            return Footprint(((0.0, 0.0),), radius, (0.0, 0.0), radius)
        case _:
            points = (corners(shape) @ rotation.T)[:, :2]
            outline = _hull(points)
            return Footprint(outline, 0.0, (0.0, 0.0), max(math.hypot(*p) for p in outline))


def _hull(points: Array) -> tuple[Point, ...]:
    """Compute the convex hull of points (n, 2), counter-clockwise (Andrew's monotone chain, 1979)."""
    ordered = sorted({(round(float(x), 9), round(float(y), 9)) for x, y in points})
    halves: list[list[Point]] = []
    for sequence in (ordered, ordered[::-1]):
        chain: list[Point] = []
        for p in sequence:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0.0:
                chain.pop()
            chain.append(p)
        halves.append(chain[:-1])
    return (*halves[0], *halves[1])


def _turn(a: Point, b: Point, c: Point) -> float:
    """Return a positive number when a → b → c turns left."""
    return (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])


def distance(a: Footprint, b: Footprint) -> float:
    """Return the free distance of two outlines, m; 0 or less when they overlap."""
    one, other = _placed(a), _placed(b)
    apart = max(_separation(one, other), _separation(other, one))
    if apart <= 0.0 and max(len(one), len(other)) > 1:
        return -a.radius - b.radius
    return min(_nearest(one, other), _nearest(other, one)) - a.radius - b.radius


def _placed(outline: Footprint) -> list[Point]:
    cx, cy = outline.centre
    return [(x + cx, y + cy) for x, y in outline.polygon]


def _separation(polygon: list[Point], points: list[Point]) -> float:
    """Return the greatest separation of all points from one edge of the polygon, m; negative when no edge
    separates them."""
    best = -math.inf
    for (ax, ay), (bx, by) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        nx, ny = by - ay, ax - bx
        best = max(best, min((x - ax) * nx + (y - ay) * ny for x, y in points))
    return best


def _nearest(points: list[Point], polygon: list[Point]) -> float:
    """Return the least distance of the points to the polygon's edges, m."""
    least = math.inf
    for (ax, ay), (bx, by) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        dx, dy = bx - ax, by - ay
        square = max(dx * dx + dy * dy, 1e-18)
        for x, y in points:
            share = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / square))
            least = min(least, math.hypot(x - ax - share * dx, y - ay - share * dy))
    return least


def floor_height(fixtures: Iterable[Fixture], base_height: float) -> float:
    """Return the height of the room's floor in the world, m; `base_height` is that of the robot's base."""
    return min([base_height, *(bottom(f.shape, f.pose) for f in fixtures)]) - FLOOR_DEPTH


def support_height(fixtures: Iterable[Fixture], x: float, y: float) -> float | None:
    """Return the height of the highest level top of a fixture at (x, y) in the world, m; None when there is
    none."""
    tops: list[float] = []
    for fixture in fixtures:
        rotation = fixture.pose.rotation()
        local = rotation.T @ (np.array([x, y, fixture.pose.position[2]]) - fixture.pose.position)
        if abs(rotation[2, 2]) < 0.999:
            continue
        match fixture.shape:
            case Box((width, depth, _)):
                covers = abs(local[0]) <= width / 2 and abs(local[1]) <= depth / 2
            case Cylinder(radius, _):
                covers = math.hypot(local[0], local[1]) <= radius
            case _:
                covers = False
        if covers:
            tops.append(top(fixture.shape, fixture.pose))
    return max(tops, default=None)
