"""Place candidates over a destination bin for an object in a given grasp."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...cell.handover import PlaceCandidate
from ...world.belief.planning_scene import BeliefObject
from ...world.scene.description import Bin
from ...world.shapes import Shape, extents
from ...world.values import Array, ObjectId, Pose
from .bin_spots import RELEASE_HEIGHT_STEPS, RELEASE_YAWS, BinCell, free_cells, heap_heights, release_poses

if TYPE_CHECKING:
    from ...cell.world import World

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
    heights = heap_heights(bin_, world.scene.objects, None if seen is None else seen.cells)
    return BinTarget(bin_, heights, tuple(free_cells(bin_, heights, belief.shape, belief.pose.rotation())))


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
