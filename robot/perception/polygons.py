"""Areas of polygons in a plane."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from ...world.values import Array

CANVAS = 512
"""Pixels of the longer side of the picture in which covered area is counted."""


def next_corners(polygon: Array) -> Array:
    """Return the corner (k, 2) that follows each one of a polygon."""
    return np.concatenate([polygon[1:], polygon[:1]])


def polygon_area(polygon: Array) -> float:
    """Return the area of a polygon, corners (k, 2), in squares of their unit."""
    following = next_corners(polygon)
    return 0.5 * abs(float((polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1]).sum()))


def covered_area(polygons: Sequence[Array]) -> float:
    """Return the area that convex polygons, corners (k, 2) each, cover together: of several to about 1 %."""
    if len(polygons) == 1:
        return polygon_area(polygons[0])
    together = np.concatenate(polygons)
    low, high = together.min(axis=0), together.max(axis=0)
    scale = CANVAS / max(float((high - low).max()), 1e-9)
    canvas = np.zeros((CANVAS + 1, CANVAS + 1), np.uint8)
    for polygon in polygons:
        cv2.fillConvexPoly(canvas, np.asarray(np.round((polygon - low) * scale), np.int32), 1)
    # A filled polygon has the pixels of its border, too: half of a pixel more on all sides.
    edge = cv2.erode(canvas, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return float(int(canvas.sum()) + int(edge.sum())) / 2.0 / scale**2
