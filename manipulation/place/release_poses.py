"""Where, over the bin where it belongs, an object that is held in some way can be let go."""

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
from .bin_spots import STEPS, YAWS, BinCell, free_cells, heap_heights, release_poses

if TYPE_CHECKING:
    from ...cell.world import World

CELLS_TRIED = 4
"""Cells of a bin that are tried at each height, the lowest first."""
CELL_COST, STEP_COST = 0.1, 2.0
"""What the next best cell, and the next higher release, is worth as time, s."""
RIM_ROOM = 0.012
"""Of the finger tips above the rim where the fingers open, m: nearer, and the straight way out touches it."""
HEAP_ROOM = 0.015
"""Of the object's underside above the highest that is known of the heap, on a way that is not felt, m."""


@dataclass(frozen=True, slots=True)
class BinTarget:
    """A bin as it is filled now: where an object may go, the best cell first; none when it is full."""

    bin: Bin
    heights: Array
    """(3, 3) m above the bin's floor."""
    cells: tuple[BinCell, ...]


def bin_target(world: World, belief: BeliefObject, into: ObjectId) -> BinTarget:
    """What is seen and believed of a bin, for an object that is turned as it is now."""
    bin_ = world.scene.bins[into]
    seen = world.eyes.bins.get(into)
    heights = heap_heights(bin_, world.scene.objects, None if seen is None else seen.cells)
    return BinTarget(bin_, heights, tuple(free_cells(bin_, heights, belief.shape, belief.pose.rotation())))


@dataclass(frozen=True, slots=True)
class ReleaseLevel:
    """Landings over one cell at one height, one for each turn of the hand."""

    spot: BinCell
    higher: float
    cost: float
    """s"""

    @property
    def name(self) -> str:
        more = f" {self.higher * 1000:.0f} mm higher" if self.higher else ""
        return f"{self.spot.name}{more}"


def levels(target: BinTarget) -> Iterator[ReleaseLevel]:
    """The lowest release over the best cell first."""
    for step, higher in enumerate(STEPS):
        for k, spot in enumerate(target.cells[:CELLS_TRIED]):
            yield ReleaseLevel(spot, higher, step * STEP_COST + k * CELL_COST)


def place_candidates(
    world: World, target: BinTarget, level: ReleaseLevel, shape: Shape, object_in_tcp: Pose
) -> Sequence[PlaceCandidate]:
    """The hand points down, at several yaws."""
    poses = release_poses(target.bin, level.spot, shape, object_in_tcp, level.higher)
    return tuple(
        PlaceCandidate(
            target.bin.id,
            level.spot.name,
            level.spot.height,
            above,
            free_drop_height(world, target, above, shape, object_in_tcp),
            f"{target.bin.id} {level.name} turned {360 * k // YAWS}",
        )
        for k, above in enumerate(poses)
    )


def free_drop_height(
    world: World, target: BinTarget, above: Pose, shape: Shape, object_in_tcp: Pose
) -> float:
    """How far the hand goes straight down from over a bin without feeling its way: until the finger tips
    are as near to the rim as they may be, or the object to what may lie below. m, 0 at least

    Items tumble: what is believed to lie in one cell may lie in the next.
    """
    bin_ = target.bin
    held = above @ object_in_tcp
    low = held.position[2] + float(extents(shape, held.rotation())[0][2])
    floor = bin_.pose.position[2] + bin_.wall
    tips = above.position[2] - world.robot.description.gripper.tip
    rim = bin_.pose.position[2] + bin_.size[2]
    down_to_rim = tips - rim - max(RIM_ROOM, world.handling.rim_clearance)
    down_to_heap = low - floor - float(np.max(target.heights)) - HEAP_ROOM
    return max(0.0, min(down_to_rim, down_to_heap))
