"""Background model: expected depth of fixtures and bins without any item, and support surfaces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from picktree.world import Array, Box, Pose, Shape, corners, heap_geometry, ray_hits, top
from picktree.world.scene import NO_UNCERTAINTY, Bin, Fixture, SceneDescription

from . import segmentation
from .camera_geometry import PosedCamera
from .hole_mouths import spread

WALL_MARGIN = 0.012
"""Distance from a bin's wall within which depth may be that of the wall, m."""
FIXTURE_MARGIN = 0.006
"""The same distance for the sides of fixtures, m."""
SUPPORT_TOLERANCE = 0.005
"""Depth error by which an item on a surface may be measured below it, m."""
MIN_FRONT_DEPTH = 0.004
"""Distance in front of a wall or fixture from which depth belongs to something else, m."""


@dataclass(frozen=True, eq=False)
class BackgroundModel:
    """Expected image of the empty scene, as arrays (h, w)."""

    depth: NDArray[np.float64]
    """Depth of fixtures and bins, m; elsewhere that of the plane of the table; inf above the horizon."""
    guard: NDArray[np.float64]
    """Depth of walls and of fixtures other than the table, swollen by their margins, m; inf elsewhere."""
    label: NDArray[np.uint8]
    """Label of the painted colour, see `segmentation.LABEL_NAMES`."""
    table: NDArray[np.bool_]
    """Pixels where the table top is seen."""
    in_bin: NDArray[np.bool_]
    """Pixels where the floor or the walls of a bin are seen."""

    @classmethod
    def of(
        cls, description: SceneDescription, sight: PosedCamera, table: Fixture | None, table_z: float
    ) -> BackgroundModel:
        """Render the model for a camera. `table_z` is the height of the ground where no fixture is seen,
        m."""
        scene = _Scene(sight)
        belts = {belt.id for belt in description.belts}
        for fixture in description.fixtures:
            scene.paint(fixture.shape, fixture.pose, fixture.colour, _TABLE if fixture is table else _FIXTURE)
            if fixture is not table:
                scene.shield(*_possible_extent(fixture), FIXTURE_MARGIN, belt=fixture.id in belts)
        for bin_ in description.bins:
            floor, *walls = bin_.parts()
            scene.paint(*floor, bin_.colour, _BIN)
            for shape, pose in walls:
                scene.paint(shape, pose, bin_.colour, _BIN)
                scene.shield(shape, pose, WALL_MARGIN)
        scene.ground(table_z)
        return cls(scene.depth, scene.guard, scene.label, scene.owner == _TABLE, scene.owner == _BIN)


def _possible_extent(fixture: Fixture) -> tuple[Shape, Pose]:
    """Grow the fixture's shape by the uncertainty of its pose."""
    if not isinstance(fixture.shape, Box) or fixture.uncertainty == NO_UNCERTAINTY:
        return fixture.shape, fixture.pose
    x, y, z = fixture.shape.size
    aside, up = spread(fixture), fixture.uncertainty.angle * float(np.hypot(x, y)) / 2
    # The underside stays: its support hides it.
    grown = Box((x + 2 * aside, y + 2 * aside, z + up))
    return grown, fixture.pose @ Pose((0.0, 0.0, up / 2))


_NOTHING, _TABLE, _FIXTURE, _BIN = range(4)


class _Scene:
    """Arrays (h, w) into which shapes are rendered."""

    def __init__(self, sight: PosedCamera) -> None:
        self._sight = sight
        self._rays = sight.all_directions()
        size = (sight.intrinsics.height, sight.intrinsics.width)
        self.depth = np.full(size, np.inf)
        self.guard = np.full(size, np.inf)
        self.label = np.zeros(size, dtype=np.uint8)
        self.owner = np.full(size, _NOTHING, dtype=np.uint8)

    def paint(self, shape: Shape, pose: Pose, colour: str, owner: int) -> None:
        window, depth = self._cast(shape, pose)
        nearer = depth < self.depth[window]
        self.depth[window][nearer] = depth[nearer]
        self.label[window][nearer] = segmentation.label_of(colour)
        self.owner[window][nearer] = owner

    def shield(self, shape: Shape, pose: Pose, margin: float, *, belt: bool = False) -> None:
        """Add a shape to the guard. With `belt` only the rim of its top is kept: items lie on a belt as on a
        table."""
        swollen = shape
        if isinstance(shape, Box):
            x, y, z = shape.size
            swollen = Box((x + 2 * margin, y + 2 * margin, z))
        window, depth = self._cast(swollen, pose)
        if belt and isinstance(shape, Box):
            x, y, z = shape.size
            face = Box((x - 2 * margin, y - 2 * margin, margin))
            inner, top = self._cast(face, pose @ Pose((0.0, 0.0, (z - margin) / 2)))
            whole = np.full(self.guard.shape, np.inf)
            whole[window] = depth
            whole[inner][np.isfinite(top)] = np.inf
            depth = whole[window]
        np.minimum(self.guard[window], depth, out=self.guard[window])

    def _cast(self, shape: Shape, pose: Pose) -> tuple[tuple[slice, slice], Array]:
        """Compute the depths of the shape in a window of the picture that contains it."""
        height, width = self._sight.intrinsics.height, self._sight.intrinsics.width
        points = pose.apply(corners(shape))
        window = (slice(0, 0), slice(0, 0))
        before = self._sight.before(points)
        if len(before):
            pixels = self._sight.pixels(before)
            (u0, v0), (u1, v1) = np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0)) + 1
            rows = (int(np.clip(v, 0, height)) for v in (v0, v1))
            columns = (int(np.clip(u, 0, width)) for u in (u0, u1))
            window = (slice(*rows), slice(*columns))
        rays = self._rays[window]
        depth = ray_hits(
            shape, pose.rotation(), np.array(pose.position), self._sight.origin, rays.reshape(-1, 3)
        )
        return window, depth.reshape(rays.shape[:2])

    def ground(self, height: float) -> None:
        """Set the depth to a level plane at `height` where no fixture is seen: anything below it is
        irrelevant."""
        falling = self._rays[:, :, 2]
        down = falling < -1e-6
        plane = np.where(down, (height - self._sight.origin[2]) / np.where(down, falling, -1.0), np.inf)
        self.depth = np.where(np.isinf(self.depth), plane, self.depth)


@dataclass(frozen=True, slots=True)
class SupportSurface:
    """Level surface on which things can lie."""

    place: str
    """`table` or a bin's id."""
    height: float
    """Height in the world, m."""
    in_bin: bool
    heaped: bool = False
    """Whether things there are picked from a heap, without being recognised."""


class SupportSurfaces:
    """Support surfaces of a scene: tops of fixtures, floors of bins."""

    def __init__(
        self,
        fixtures: tuple[Fixture, ...],
        bins: tuple[Bin, ...],
        regions: Mapping[str, heap_geometry.HeapRegion],
    ) -> None:
        """`regions`: places of heaps, by tote or fixture."""
        self._piles = [region for name, region in regions.items() if name not in {str(b.id) for b in bins}]
        self._bins = [(b, _Footprint(b.pose, b.size[0], b.size[1])) for b in bins]
        self._tops = [
            (top(f.shape, f.pose), _Footprint(f.pose, f.shape.size[0], f.shape.size[1]))
            for f in fixtures
            if isinstance(f.shape, Box)
        ]

    def under(self, x: float, y: float, below: float) -> SupportSurface:
        """Return the bin whose outside contains (x, y), else the highest fixture there whose top is not above
        `below`. Without either the height is 0."""
        for bin_, outside in self._bins:
            if outside.covers(x, y):
                return SupportSurface(bin_.id, bin_.pose.position[2] + bin_.wall, True, bin_.is_tote)
        tops = [height for height, area in self._tops if height <= below and area.covers(x, y)]
        height = max(tops, default=0.0)
        point = np.array([[x, y, height]])
        return SupportSurface("table", height, False, any(bool(p.covers(point)[0]) for p in self._piles))

    def supports(self, points: Array) -> Array:
        """Compute how far down something at each point (n, 3) of the world may reach unseen, (n,), m.

        That is the rim of a bin, the highest fixture below the point, or else the height 0.
        """
        x, y, z = points.T
        heights = np.full(len(points), -np.inf)
        for height, area in self._tops:
            under = area.covers(x, y) & (height <= z + SUPPORT_TOLERANCE)
            heights[under] = np.maximum(heights[under], height)
        heights[np.isinf(heights)] = 0.0
        for bin_, outside in self._bins:
            heights[outside.covers(x, y)] = bin_.pose.position[2] + bin_.size[2]
        return heights

    def in_heap(self, points: Array, over: float) -> NDArray[np.bool_]:
        """Select the points (n, 3) of the world that lie over a bin, at most `over` m above its rim, or in a
        pile."""
        x, y, z = points.T
        found = np.zeros(len(points), dtype=np.bool_)
        for bin_, outside in self._bins:
            found |= outside.covers(x, y) & (z < bin_.pose.position[2] + bin_.size[2] + over)
        for region in self._piles:
            found |= region.covers(points)
        return found


class _Footprint:
    """Upright rectangle, seen from above."""

    def __init__(self, pose: Pose, long: float, wide: float) -> None:
        self._x, self._y = pose.position[:2]
        (self._xx, self._xy), (self._yx, self._yy) = pose.rotation()[:2, :2].tolist()
        self._half = (long / 2, wide / 2)

    def covers(self, x: Array | float, y: Array | float) -> NDArray[np.bool_]:
        """Whether a point, or each of many points (n,), (n,), lies inside."""
        dx, dy = x - self._x, y - self._y
        along = np.abs(dx * self._xx + dy * self._yx) <= self._half[0]
        return along & (np.abs(dx * self._xy + dy * self._yy) <= self._half[1])


def table_of(description: SceneDescription) -> Fixture | None:
    """Return the fixture with the largest level top; None without a box."""
    boxes = [f for f in description.fixtures if isinstance(f.shape, Box)]
    return max(
        boxes,
        key=lambda f: f.shape.size[0] * f.shape.size[1] if isinstance(f.shape, Box) else 0.0,
        default=None,
    )
