"""Depth that nothing known explains becomes boxes to keep clear of."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ..shapes import Box
from ..values import Array, Pose
from . import hues
from .blobs import Picture, Pixels, connected
from .view import Unexplained

RAISED = 0.012
"""Grey depth must stand out by this to be something, m."""
LEAST = 20
"""Fewer pixels than this are noise."""
LOW = 0.004
"""What is flatter than this is a mark on the table, m."""
BESIDE_ARM = 60
"""A patch beside the robot needs so many pixels: the model's edge leaves slivers."""


def grey(
    picture: Picture, backdrop: Array, robot: NDArray[np.bool_], inside_bins: NDArray[np.bool_]
) -> list[tuple[Pixels, Pixels]]:
    """Patches of unsaturated depth in front of the `backdrop` (h, w) that are nothing known."""
    raised = (picture.depth > 0) & np.isfinite(backdrop) & (picture.label == 0)
    raised &= backdrop - picture.depth > RAISED
    raised &= ~picture.blocked & ~inside_bins
    if int(raised.sum()) < LEAST:
        return []
    items = cv2.dilate((picture.owner > 0).astype(np.uint8), np.ones((5, 5), np.uint8))
    opened = cv2.morphologyEx(
        (raised & (items == 0)).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)
    )
    beside = cv2.dilate(robot.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.bool_)
    return [
        (rows, columns)
        for rows, columns in connected(opened.astype(np.bool_), LEAST)
        if len(rows) >= BESIDE_ARM or not beside[rows, columns].any()
    ]


def boxed(picture: Picture, rows: Pixels, columns: Pixels, support: float) -> Unexplained | None:
    """The upright box about a patch, from its support up; None when it is as flat as the support."""
    depths = picture.depth[rows, columns]
    seen = depths > 0
    if int(seen.sum()) < 4:
        return None
    rows, columns, depths = rows[seen], columns[seen], depths[seen]
    rays = picture.sight.directions(np.stack([columns, rows], axis=1).astype(np.float64))
    points = picture.sight.origin + rays * depths[:, None]
    top = float(np.percentile(points[:, 2], 95.0))
    if top - support < LOW:
        return None
    (x, y), (long, wide), turn = cv2.minAreaRect((points[:, :2] * 1000).astype(np.float32))
    pixel = float(np.median(depths)) / picture.sight.intrinsics.fx
    size = (long / 1000 + pixel, wide / 1000 + pixel, top - support)
    middle = (x / 1000, y / 1000, (top + support) / 2)
    labels = picture.label[rows, columns]
    label = int(np.bincount(labels).argmax())
    return Unexplained(
        Box(size), Pose.from_rpy(middle, (0.0, 0.0, math.radians(turn))), hues.NAMES[label] or "grey"
    )
