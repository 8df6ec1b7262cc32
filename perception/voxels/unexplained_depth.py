"""Depth that nothing known explains: patches of the picture that show something to keep clear of."""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from ...world.shapes import Box
from ...world.values import Array, Pose
from ..fitting.view import Unexplained
from ..segmentation import hues
from ..segmentation.blobs import Picture, Pixels, connected

RAISED = 0.012
"""Grey depth must stand out by this to be something, m."""
LEAST = 20
"""Fewer pixels than this are noise."""
LOW = 0.004
"""What is flatter than this is a mark on the table, m."""
ALIKE, BACKING = 0.02, 3
"""So many of the eight neighbours must have the same depth within so much, m."""
BESIDE_ARM = 60
"""A patch beside the robot needs so many pixels: the model's edge leaves slivers."""


def grey(
    picture: Picture, backdrop: Array, robot: NDArray[np.bool_], in_heap: Callable[[Array], NDArray[np.bool_]]
) -> list[tuple[Pixels, Pixels]]:
    """Patches of unsaturated depth in front of the `backdrop` (h, w) that are nothing known; points
    (n, 3) of the world that are `in_heap`, in a bin, are none."""
    raised = (picture.depth > 0) & np.isfinite(backdrop) & (picture.label == 0)
    raised &= backdrop - picture.depth > RAISED
    raised &= ~picture.blocked
    if int(raised.sum()) < LEAST:
        return []
    rows, columns = np.nonzero(raised)
    raised[rows, columns] = ~in_heap(points_of(picture, rows, columns))
    items = cv2.dilate((picture.owner > 0).astype(np.uint8), np.ones((5, 5), np.uint8))
    opened = cv2.morphologyEx(
        (raised & (items == 0) & _backed(picture.depth, raised)).astype(np.uint8),
        cv2.MORPH_OPEN,
        np.ones((3, 3), np.uint8),
    )
    beside = cv2.dilate(robot.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.bool_)
    return [
        (rows, columns)
        for rows, columns in connected(opened.astype(np.bool_), LEAST)
        if len(rows) >= BESIDE_ARM or not beside[rows, columns].any()
    ]


def _backed(depth: Array, raised: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels with enough neighbours of their own depth: at edges a sensor may mix near and far, and such a
    pixel hangs alone between the two."""
    h, w = depth.shape
    padded = np.pad(np.where(raised, depth, 0.0), 1)
    backing = np.zeros(depth.shape, dtype=np.int8)
    for dy in (0, 1, 2):
        for dx in (0, 1, 2):
            if (dy, dx) != (1, 1):
                backing += np.abs(padded[dy : dy + h, dx : dx + w] - depth) < ALIKE
    return raised & (backing >= BACKING)


def boxed(picture: Picture, rows: Pixels, columns: Pixels, support: float) -> Unexplained | None:
    """What a patch shows, with the upright box about it, from its support up; None when it is as flat as the
    support."""
    depths = picture.depth[rows, columns]
    seen = depths > 0
    if int(seen.sum()) < 4:
        return None
    rows, columns, depths = rows[seen], columns[seen], depths[seen]
    points = points_of(picture, rows, columns)
    top = float(np.percentile(points[:, 2], 95.0))
    if top - support < LOW:
        return None
    (x, y), (long, wide), turn = cv2.minAreaRect((points[:, :2] * 1000).astype(np.float32))
    pixel = float(np.median(depths)) / picture.sight.intrinsics.fx
    size = (long / 1000 + pixel, wide / 1000 + pixel, top - support)
    middle = (x / 1000, y / 1000, (top + support) / 2)
    labels = picture.label[rows, columns]
    label = int(np.bincount(labels).argmax())
    pose = Pose.from_rpy(middle, (0.0, 0.0, math.radians(turn)))
    return Unexplained(Box(size), pose, hues.NAMES[label] or "grey", rows, columns)


def points_of(picture: Picture, rows: Pixels, columns: Pixels) -> Array:
    """What the pixels show in the world (n, 3), m."""
    rays = picture.sight.directions(np.stack([columns, rows], axis=1).astype(np.float64))
    return picture.sight.origin + rays * picture.depth[rows, columns][:, None]
