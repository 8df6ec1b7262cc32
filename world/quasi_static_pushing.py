"""Quasi-static planar pushing: motion of bodies on a table that a tool, or another body, pushes.

The planner of push strokes (`manipulation.push.singulation`) and the kinematic backend
(`simulation.kinematic.contact_forces`) share this model. A run on the kinematic backend therefore does not
test the model itself; the physics backend does, with pybullet's contacts.

Bodies are seen from above and have no inertia. They are moved out of the tool, and out of each other, by the
least effort. A rotation by one radian costs as much as a translation by the root mean square distance of the
underside's points. This approximates the ellipsoidal limit surface of friction (Howe and Cutkosky, "Practical
force-motion models for sliding manipulation", IJRR 15, 1996). Contacts are solved by projections, one after
the other (Müller et al., "Position based dynamics", 2007).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

from .planar_geometry import PlanarOutline, PlanarPose

MAX_SOLVER_ROUNDS = 8
"""Greatest number of rounds over all contacts."""
MAX_RESIDUAL_DEPTH = 1e-5
"""Greatest depth that remains, m."""
MAX_CONTACT_DEPTH = 0.004
"""Greatest depth in the tool of a body that was reached from the side, m."""

Point: TypeAlias = tuple[float, float]
Edge: TypeAlias = tuple[Point, Point, Point]
"""Both ends and the outward normal."""


@dataclass(frozen=True, slots=True)
class _Contact:
    """Contact: a point in the world, the unit vector that leads the second body out of the first, and the
    depth, m."""

    at: Point
    out: Point
    depth: float


class _Slider:
    """One outline and its pose in the plane."""

    def __init__(self, shape: PlanarOutline, at: PlanarPose, *, fixed: bool) -> None:
        self.at = at
        self.radius = shape.radius
        self.fixed = fixed
        self.reach = shape.reach
        self._shape = shape
        self._points: list[Point] | None = None
        self._edges: list[Edge] | None = None

    @cached_property
    def _square(self) -> float:
        """Mean square of the distance of the points from the origin, m²."""
        return max(self._shape.inertia(), 1e-9)

    @property
    def points(self) -> list[Point]:
        """Corners in the world, counter-clockwise."""
        if self._points is None:
            c, s, x, y = math.cos(self.at.yaw), math.sin(self.at.yaw), self.at.x, self.at.y
            self._points = [(x + c * a - s * b, y + s * a + c * b) for a, b in self._shape.corners.tolist()]
        return self._points

    @property
    def edges(self) -> list[Edge]:
        """Edges in the world that have a length, counter-clockwise."""
        if self._edges is None:
            points, found = self.points, list[Edge]()
            for (ax, ay), (bx, by) in zip(points, (*points[1:], points[0]), strict=True):
                dx, dy = bx - ax, by - ay
                length = math.hypot(dx, dy)
                if length >= 1e-9:
                    found.append(((ax, ay), (bx, by), (dy / length, -dx / length)))
            self._edges = found
        return self._edges

    def give(self, contact: _Contact) -> float:
        """Return the displacement at a contact for a unit of effort; 0 for a fixed body."""
        if self.fixed:
            return 0.0
        lever = (contact.at[0] - self.at.x) * contact.out[1] - (contact.at[1] - self.at.y) * contact.out[0]
        return 1.0 + lever * lever / self._square

    def move(self, contact: _Contact, effort: float) -> None:
        nx, ny = contact.out
        lever = (contact.at[0] - self.at.x) * ny - (contact.at[1] - self.at.y) * nx
        turn = effort * lever / self._square
        self.at = PlanarPose(self.at.x + effort * nx, self.at.y + effort * ny, self.at.yaw + turn)
        self._points = self._edges = None


class PlanarPushModel:
    """Planar push model: named bodies on one table among static outlines."""

    def __init__(
        self,
        bodies: Mapping[str, tuple[PlanarOutline, PlanarPose]],
        still: Iterable[tuple[PlanarOutline, PlanarPose]] = (),
    ) -> None:
        self._bodies = {name: _Slider(shape, at, fixed=False) for name, (shape, at) in bodies.items()}
        self._still = [_Slider(shape, at, fixed=True) for shape, at in still]

    def where(self, name: str) -> PlanarPose:
        return self._bodies[name].at

    def press(
        self, tool: Sequence[tuple[PlanarOutline, PlanarPose]], deepest: float = MAX_CONTACT_DEPTH
    ) -> frozenset[str]:
        """Move the bodies that the tool reaches out of it, and return the names of all moved bodies.

        `tool`: outlines of the tool with their present poses. In the first round a body deeper in the tool
        than `deepest`, m, is skipped.
        """
        parts = [_Slider(shape, at, fixed=True) for shape, at in tool]
        moved: set[str] = set()
        apart: set[str] = set()
        for round_ in range(MAX_SOLVER_ROUNDS):
            worst, most = 0.0, deepest if round_ == 0 else math.inf
            for name, body in self._bodies.items():
                if name in apart and name not in moved:
                    continue
                reached = max([_separate(part, body, most) for part in parts], default=0.0)
                if reached > MAX_RESIDUAL_DEPTH:
                    moved.add(name)
                elif reached == 0.0 and most == math.inf:
                    apart.add(name)
                worst = max(worst, reached)
            worst = max(worst, self._among(moved))
            if worst < MAX_RESIDUAL_DEPTH or not moved:
                break
        return frozenset(moved)

    def _among(self, moved: set[str]) -> float:
        """Separate moved bodies from the bodies that they have entered, which then count as moved too.
        Returns the greatest depth, m."""
        worst = 0.0
        # The order of a set of names is that of their hashes, which differ between processes.
        for name in [name for name in self._bodies if name in moved]:
            body = self._bodies[name]
            for other_name, other in self._bodies.items():
                if other_name != name and not (other_name in moved and other_name < name):
                    depth = _separate(body, other)
                    if depth > MAX_RESIDUAL_DEPTH:
                        moved.add(other_name)
                    worst = max(worst, depth)
            for wall in self._still:
                worst = max(worst, _separate(wall, body))
        return worst


def _separate(one: _Slider, other: _Slider, deepest: float = math.inf) -> float:
    """Move two bodies out of each other; return how deep they were, m. Returns 0 for bodies deeper than
    `deepest`, which stay."""
    if math.hypot(one.at.x - other.at.x, one.at.y - other.at.y) > one.reach + other.reach:
        return 0.0
    contacts = _contacts(one, other)
    depth = max((c.depth for c in contacts), default=0.0)
    if depth <= MAX_RESIDUAL_DEPTH or depth > deepest:
        return 0.0 if depth > deepest else depth
    starts = (one.at, other.at)
    for contact in contacts:
        left = contact.depth - _separation(contact, starts, one, other)
        give = one.give(contact) + other.give(contact)
        if left <= 0.0 or give == 0.0:
            continue
        effort = left / give
        if not one.fixed:
            one.move(contact, -effort)
        if not other.fixed:
            other.move(contact, effort)
    return depth


def _separation(
    contact: _Contact, starts: tuple[PlanarPose, PlanarPose], one: _Slider, other: _Slider
) -> float:
    """Return the distance by which the two have separated at a contact since it was found, m."""
    (px, py), (nx, ny) = contact.at, contact.out

    def way(start: PlanarPose, now: PlanarPose) -> float:
        turn = now.yaw - start.yaw
        dx = now.x - start.x - turn * (py - start.y)
        dy = now.y - start.y + turn * (px - start.x)
        return dx * nx + dy * ny

    return way(starts[1], other.at) - way(starts[0], one.at)


def _contacts(one: _Slider, other: _Slider) -> list[_Contact]:
    """Return the contacts of two overlapping outlines; `out` leads the second out of the first."""
    a, b = one.points, other.points
    if len(a) == 1 and len(b) == 1:
        return _circle_contacts(a[0], one.radius, b[0], other.radius)
    if len(b) == 1:
        return _circle_polygon_contacts(one.edges, b[0], other.radius)
    if len(a) == 1:
        return [
            _Contact(c.at, (-c.out[0], -c.out[1]), c.depth)
            for c in _circle_polygon_contacts(other.edges, a[0], one.radius)
        ]
    return _polygon_contacts(one, other)


def _circle_contacts(a: Point, ra: float, b: Point, rb: float) -> list[_Contact]:
    dx, dy = b[0] - a[0], b[1] - a[1]
    away = math.hypot(dx, dy)
    if away >= ra + rb:
        return []
    nx, ny = (dx / away, dy / away) if away > 1e-9 else (1.0, 0.0)
    return [_Contact((a[0] + nx * ra, a[1] + ny * ra), (nx, ny), ra + rb - away)]


def _circle_polygon_contacts(edges: list[Edge], middle: Point, radius: float) -> list[_Contact]:
    """Return the contact of a round body with a polygon."""
    deepest, edge = _outermost_edge(edges, middle)
    if deepest >= radius:
        return []
    (ax, ay), (bx, by), (nx, ny) = edge
    if deepest <= 0.0:
        at = (middle[0] - nx * deepest, middle[1] - ny * deepest)
        return [_Contact(at, (nx, ny), radius - deepest)]
    dx, dy = bx - ax, by - ay
    share = ((middle[0] - ax) * dx + (middle[1] - ay) * dy) / (dx * dx + dy * dy)
    x, y = ax + min(1.0, max(0.0, share)) * dx, ay + min(1.0, max(0.0, share)) * dy
    ox, oy = middle[0] - x, middle[1] - y
    away = math.hypot(ox, oy)
    if away >= radius:
        return []
    out = (ox / away, oy / away) if away > 1e-9 else (nx, ny)
    return [_Contact((x, y), out, radius - away)]


def _outermost_edge(edges: list[Edge], at: Point) -> tuple[float, Edge]:
    """Return the edge line that a point is furthest outside of: distance, m (negative: inside), and the
    edge."""
    best, found = -math.inf, edges[0]
    for edge in edges:
        (ax, ay), _, (nx, ny) = edge
        off = (at[0] - ax) * nx + (at[1] - ay) * ny
        if off > best:
            best, found = off, edge
    return best, found


def _polygon_contacts(one: _Slider, other: _Slider) -> list[_Contact]:
    """Return the contacts of two polygons along the axis of least overlap, at the corners of either inside
    the other."""
    a, b = one.points, other.points
    depth, out = math.inf, (1.0, 0.0)
    for edges, points, sign in ((one.edges, b, 1.0), (other.edges, a, -1.0)):
        for (ax, ay), _, (nx, ny) in edges:
            off = -min([(x - ax) * nx + (y - ay) * ny for x, y in points])
            if off <= 0.0:
                return []
            if off < depth - 1e-9:
                depth, out = off, (sign * nx, sign * ny)
    nx, ny = out
    front = max(x * nx + y * ny for x, y in a)
    back = min(x * nx + y * ny for x, y in b)
    found = [_Contact((x, y), out, front - (x * nx + y * ny)) for x, y in b if _inside(a, x, y)] + [
        _Contact((x, y), out, x * nx + y * ny - back) for x, y in a if _inside(b, x, y)
    ]
    if found:
        return [c for c in found if c.depth > 0.0]
    x, y = max(a, key=lambda p: p[0] * nx + p[1] * ny)
    return [_Contact((x, y), out, depth)]


def _inside(polygon: list[Point], x: float, y: float) -> bool:
    for k, (ax, ay) in enumerate(polygon):
        bx, by = polygon[(k + 1) % len(polygon)]
        if (bx - ax) * (y - ay) - (by - ay) * (x - ax) < -1e-12:
            return False
    return True
