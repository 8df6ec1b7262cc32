"""Release poses: cells of a bin over the lowest part of its heap, points on fixtures, place candidates."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from picktree.robot import PlaceCandidate
from picktree.world import Array, BeliefObject, ObjectId, Pose, Shape, Sphere, corners, extents, top
from picktree.world.scene import Bin

from .pick_place_motions import lowering

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.planning import SceneQueries


CELLS_PER_SIDE = 3
"""Cells of a bin along each side."""
RELEASE_RIM_HEIGHT = 0.020
"""Height of the object's bottom above the rim at the release, m."""
RELEASE_HEIGHT_STEPS = (0.0, 0.03, 0.06, 0.10)
"""Heights added to the release when nothing lower is free, m."""
RELEASE_YAWS = 8
MAX_PLACE_PENETRATION = 0.001
"""Penetration at which a place counts as taken, m: believed poses are no better."""
PLACE_TEST_HEIGHT = 0.002
"""Height above its place at which an object is tested, m, so that its support does not count."""


@dataclass(frozen=True, slots=True)
class BinCell:
    """Cell of a bin: centre (x, y) in the world, and height of the heap above the bin's floor, m."""

    name: str
    centre: tuple[float, float]
    height: float


def heap_heights(bin_: Bin, objects: Sequence[BeliefObject], seen: Array | None) -> Array:
    """Return the height of the heap in each cell above the bin's floor, (3, 3) m.

    The higher one of the camera's measurement (`seen`, NaN where it saw nothing) and of the believed objects.
    """
    heights = (
        np.zeros((CELLS_PER_SIDE, CELLS_PER_SIDE)) if seen is None else np.nan_to_num(seen, nan=0.0).copy()
    )
    low, high = bin_.inside()
    to_bin = bin_.pose.inverse()
    for belief in objects:
        if belief.place == bin_.id:
            x, y, _ = (to_bin @ belief.pose).position
            row = int(np.clip((x - low[0]) / (high[0] - low[0]) * CELLS_PER_SIDE, 0, CELLS_PER_SIDE - 1))
            column = int(np.clip((y - low[1]) / (high[1] - low[1]) * CELLS_PER_SIDE, 0, CELLS_PER_SIDE - 1))
            above = top(belief.shape, belief.pose) - bin_.pose.position[2] - bin_.wall
            heights[row, column] = max(heights[row, column], above)
    return heights


def free_cells(
    bin_: Bin, heights: Array, shape: Shape, rotation: Array, objects: Sequence[BeliefObject] = ()
) -> list[BinCell]:
    """Return the cells whose heap leaves room below the rim, lowest first; of equals those nearer to the
    middle first.

    The centre is moved inwards so that the object (its shape turned by `rotation`) clears the walls. Believed
    `objects` that reach from other cells below it count as its heap.
    """
    low, high = bin_.inside()
    radius = _horizontal_radius(shape, rotation)
    below = [_footprint(bin_, belief) for belief in objects if belief.place == bin_.id]
    found: list[tuple[float, float, BinCell]] = []
    for row in range(CELLS_PER_SIDE):
        for column in range(CELLS_PER_SIDE):
            height = float(heights[row, column])
            if height > high[2] - low[2]:
                continue
            local: list[float] = []
            for axis, k in ((0, row), (1, column)):
                span = high[axis] - low[axis]
                centre = low[axis] + (k + 0.5) * span / CELLS_PER_SIDE
                room = max(0.0, span / 2 - radius - 0.008)
                local.append(min(max(centre, -room), room))
            x, y, _ = bin_.pose.apply(np.array([local[0], local[1], 0.0]))
            for least, most, above in below:
                beside = np.maximum(0.0, np.maximum(least - local, local - most))
                height = max(height, above if float(np.linalg.norm(beside)) < radius else 0.0)
            spot = BinCell(f"cell {row},{column}", (float(x), float(y)), height)
            found.append((round(height / 0.015), math.hypot(row - 1, column - 1), spot))
    return [spot for _, _, spot in sorted(found, key=lambda f: (f[0], f[1], f[2].name))]


def _horizontal_radius(shape: Shape, rotation: Array) -> float:
    """Return the radius of the vertical cylinder about the object's origin that contains it, m."""
    if isinstance(shape, Sphere):
        return shape.radius
    return float(np.linalg.norm((corners(shape) @ rotation.T)[:, :2], axis=1).max())


def _footprint(bin_: Bin, belief: BeliefObject) -> tuple[Array, Array, float]:
    """Return the corners (2,), (2,) of an object's footprint in the bin's frame, and its top above the floor,
    m."""
    there = bin_.pose.inverse() @ belief.pose
    low, high = extents(belief.shape, there.rotation())
    x, y, z = there.position
    return np.array((x, y)) + low[:2], np.array((x, y)) + high[:2], z + float(high[2]) - bin_.wall


def release_poses(
    bin_: Bin, spot: BinCell, shape: Shape, object_in_tcp: Pose, higher: float = 0.0
) -> tuple[Pose, ...]:
    """Return TCP poses, pointing down at several yaws, with the object over the cell and above the rim."""
    rim = bin_.pose.position[2] + bin_.size[2]
    return put_down_poses((*spot.centre, rim + RELEASE_RIM_HEIGHT + higher), shape, object_in_tcp)


def put_down_poses(point: tuple[float, float, float], shape: Shape, object_in_tcp: Pose) -> tuple[Pose, ...]:
    """Return TCP poses, pointing down at several yaws, with the object's underside centred on a point, m."""
    poses: list[Pose] = []
    for k in range(RELEASE_YAWS):
        tcp = Pose.from_rpy((0.0, 0.0, 0.0), (math.pi, 0.0, 2 * math.pi * k / RELEASE_YAWS))
        held = tcp @ object_in_tcp
        x, y, z = held.position
        low = float(extents(shape, held.rotation())[0][2])
        poses.append(tcp.shifted((point[0] - x, point[1] - y, point[2] - low - z)))
    return tuple(poses)


def blocked(queries: SceneQueries, held: BeliefObject, tcp_in_world: Pose) -> str | None:
    """Return the id of the body that penetrates the held object with the TCP at that pose. None: the place is
    free."""
    assert held.object_in_tcp is not None
    there = tcp_in_world.shifted((0.0, 0.0, PLACE_TEST_HEIGHT)) @ held.object_in_tcp
    contacts = queries.free(held.shape, there, ignore=(held.id,))
    return next((c.b for c in contacts if c.distance < -MAX_PLACE_PENETRATION), None)


MAX_CELLS_TRIED = 4
"""Maximum number of cells of a bin at each height, lowest first."""
CELL_COST, STEP_COST = 0.1, 2.0
"""Costs of the next cell, and of the next higher release, s."""
RIM_CLEARANCE = 0.012
"""Clearance of the finger tips above the rim where the fingers open, m. Closer, the straight way out touches
it."""
HEAP_CLEARANCE = 0.015
"""Clearance of the object's underside above the highest known part of the heap without contact sensing, m."""


@dataclass(frozen=True, slots=True)
class BinTarget:
    """Bin with its present heap, and the cells for an object, best first; no cells: it is full."""

    bin: Bin
    heights: Array
    """Heights of the heap above the bin's floor, (3, 3) m."""
    cells: tuple[BinCell, ...]


def bin_target(world: World, belief: BeliefObject, into: ObjectId) -> BinTarget:
    """Return the bin, by observation and belief, for an object in its present orientation."""
    bin_ = world.scene.bins[into]
    seen = world.vision.bins.get(into)
    objects = [o for o in world.scene.objects if o.id != belief.id]
    heights = heap_heights(bin_, objects, None if seen is None else seen.cells)
    cells = free_cells(bin_, heights, belief.shape, belief.pose.rotation(), objects)
    return BinTarget(bin_, heights, tuple(cells))


@dataclass(frozen=True, slots=True)
class ReleaseLevel:
    """One cell at one height: place candidates differ in the rotation of the hand."""

    spot: BinCell
    higher: float
    cost: float
    """Cost, s."""

    @property
    def name(self) -> str:
        more = f" {self.higher * 1000:.0f} mm higher" if self.higher else ""
        return f"{self.spot.name}{more}"


def levels(target: BinTarget) -> Iterator[ReleaseLevel]:
    """Yield the levels: the lowest release over the best cell first."""
    for step, higher in enumerate(RELEASE_HEIGHT_STEPS):
        for k, spot in enumerate(target.cells[:MAX_CELLS_TRIED]):
            yield ReleaseLevel(spot, higher, step * STEP_COST + k * CELL_COST)


def place_candidates(
    world: World, target: BinTarget, level: ReleaseLevel, shape: Shape, object_in_tcp: Pose
) -> Sequence[PlaceCandidate]:
    """Return the place candidates of a level: the hand points down, at several yaws."""
    poses = release_poses(target.bin, level.spot, shape, object_in_tcp, level.higher)
    return tuple(
        PlaceCandidate(
            target.bin.id,
            level.spot.name,
            level.spot.height,
            above,
            free_drop_height(world, target, above, shape, object_in_tcp),
            f"{target.bin.id} {level.name} turned {360 * k // RELEASE_YAWS}",
        )
        for k, above in enumerate(poses)
    )


def free_drop_height(
    world: World, target: BinTarget, above: Pose, shape: Shape, object_in_tcp: Pose
) -> float:
    """Return the straight descent over a bin without contact sensing, m, at least 0.

    It ends at the least clearance of the finger tips above the rim, or of the object above the heap. Items
    tumble: an object believed in one cell may be in the next.
    """
    bin_ = target.bin
    held = above @ object_in_tcp
    low = held.position[2] + float(extents(shape, held.rotation())[0][2])
    floor = bin_.pose.position[2] + bin_.wall
    tips = above.position[2] - world.robot.description.gripper.tip
    rim = bin_.pose.position[2] + bin_.size[2]
    down_to_rim = tips - rim - max(RIM_CLEARANCE, world.handling.rim_clearance)
    down_to_heap = low - floor - float(np.max(target.heights)) - HEAP_CLEARANCE
    return max(0.0, min(down_to_rim, down_to_heap))


def opens_freely(
    world: World, landing: PlaceCandidate, belief: BeliefObject, object_in_tcp: Pose, width: float
) -> bool:
    """Return whether the hand touches nothing believed at the release of an object that it holds.

    The hand is at the end of `lower`, and its fingers open from `width`, m.
    """
    target = world.scene.bins[landing.into]
    low = float(extents(belief.shape, (landing.above @ object_in_tcp).rotation())[0][2])
    low += (landing.above @ object_in_tcp).position[2]
    way = max(0.0, lowering(world, target, landing.above.position[2], low))
    opening = min(width + world.handling.release, world.robot.description.gripper.max_width)
    there = landing.above.shifted((0.0, 0.0, -way))
    return not world.queries.hand_contacts(there, opening, ignore=(belief.id,))
