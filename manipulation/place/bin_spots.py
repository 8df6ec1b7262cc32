"""Places in a bin and poses of a release: over the lowest part of the heap."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...world.belief.planning_scene import BeliefObject
from ...world.scene.description import Bin
from ...world.shapes import Shape, extents, top
from ...world.values import Array, Pose

if TYPE_CHECKING:
    from ...planning.collision.scene_queries import SceneQueries

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


def free_cells(bin_: Bin, heights: Array, shape: Shape, rotation: Array) -> list[BinCell]:
    """Return the cells whose heap leaves room below the rim, lowest first; of equals those nearer to the
    middle first.

    The centre is moved inwards so that the object (its shape turned by `rotation`) clears the walls.
    """
    low, high = bin_.inside()
    reach = float(np.linalg.norm(extents(shape, rotation)[1][:2]))
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
                room = max(0.0, span / 2 - reach - 0.008)
                local.append(min(max(centre, -room), room))
            x, y, _ = bin_.pose.apply(np.array([local[0], local[1], 0.0]))
            spot = BinCell(f"cell {row},{column}", (float(x), float(y)), height)
            found.append((round(height / 0.015), math.hypot(row - 1, column - 1), spot))
    return [spot for _, _, spot in sorted(found, key=lambda f: (f[0], f[1], f[2].name))]


def release_poses(
    bin_: Bin, spot: BinCell, shape: Shape, object_in_tcp: Pose, higher: float = 0.0
) -> tuple[Pose, ...]:
    """Return TCP poses, pointing down at several yaws, with the object over the cell and above the rim."""
    rim = bin_.pose.position[2] + bin_.size[2]
    poses: list[Pose] = []
    for k in range(RELEASE_YAWS):
        tcp = Pose.from_rpy((0.0, 0.0, 0.0), (math.pi, 0.0, 2 * math.pi * k / RELEASE_YAWS))
        held = tcp @ object_in_tcp
        low = float(extents(shape, held.rotation())[0][2])
        offset = np.array(held.position)
        poses.append(
            tcp.shifted(
                (
                    spot.centre[0] - float(offset[0]),
                    spot.centre[1] - float(offset[1]),
                    rim + RELEASE_RIM_HEIGHT + higher - low - float(offset[2]),
                )
            )
        )
    return tuple(poses)


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
