"""Views made of numbers: a camera that looks straight down from 1 m, 100 pixels to the metre on the table."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from picktree.robot.perception import PosedCamera, segmentation
from picktree.robot.perception.view import PerceivedView, UnexplainedPatch
from picktree.world import Array, Box, Intrinsics, Pose

HEIGHT = 1.0
WIDE, HIGH = 60, 40
LENS = Intrinsics(WIDE, HIGH, 100.0, 100.0, 30.0, 20.0)
SIGHT = PosedCamera.at(LENS, Pose((0.0, 0.0, HEIGHT), (1.0, 0.0, 0.0, 0.0)))
"""Pixel (u, v) shows x = 0.01 (u - 30), y = 0.01 (20 - v) on the table at z = 0."""


def flat(points: Array) -> Array:
    return np.zeros(len(points))


def synthetic_view(
    depth: Array | float = HEIGHT,
    *,
    reach: Array | None = None,
    label: Array | None = None,
    blocked: Array | None = None,
    supports: Callable[[Array], Array] = flat,
    robot: Callable[[Array, float], NDArray[np.bool_]] | None = None,
) -> PerceivedView:
    """`depth` (h, w): of the picture, m; `reach` the same unless it is said."""
    seen = np.broadcast_to(np.asarray(depth, dtype=np.float64), (HIGH, WIDE)).copy()
    free = np.where(seen > 0, seen, np.inf) if reach is None else reach
    colours = np.zeros((HIGH, WIDE), dtype=np.uint8) if label is None else label.astype(np.uint8)
    masked = np.zeros((HIGH, WIDE), dtype=np.bool_) if blocked is None else blocked
    return PerceivedView(
        "overhead", 1.0, (), (), MappingProxyType({}), SIGHT, seen, colours, masked,
        free.astype(np.float32), supports, robot or (lambda points, _: np.zeros(len(points), dtype=np.bool_)),
    )  # fmt: skip


def patch_of(*pixels: tuple[int, int], colour: str = "grey") -> UnexplainedPatch:
    """Pixels (row, column)."""
    rows, columns = np.array(pixels, dtype=np.intp).T
    return UnexplainedPatch(Box((0.1, 0.1, 0.1)), Pose(), colour, rows, columns)


def painted(colour: str) -> Array:
    return np.full((HIGH, WIDE), segmentation.label_of(colour))


def raised(by: float, *where: tuple[slice, slice]) -> Array:
    """Depth of the table, and of what stands out `by` m of it there."""
    depth = np.full((HIGH, WIDE), HEIGHT)
    for each in where:
        depth[each] -= by
    return depth
