"""Collision boxes of a measured gripper: around the hand and around a finger, in the TCP frame."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.spatial import ConvexHull

from ...world.shapes import Box
from ...world.values import Array, Pose

HAND_BOX_COUNT = 3
"""Number of boxes along the hand, which mostly tapers."""


def hand_boxes(
    static: list[Array], swept: list[Array], top: float, widest: float
) -> tuple[tuple[Box, Pose], ...]:
    """Return boxes around the hand behind its palm, and around parts that protrude beside the open
    fingers."""
    boxes: list[tuple[Box, Pose]] = []
    below = [points[points[:, 2] <= top] for points in swept]
    points = (
        np.concatenate([*static, *(b for b in below if len(b))]) if static or any(map(len, below)) else None
    )
    if points is not None and len(points) >= 4:
        bottom = float(points[:, 2].min())
        edges = _hull_edges(points)
        count = HAND_BOX_COUNT if top - bottom > 0.03 else 1
        bounds = np.linspace(top, bottom, count + 1)
        for high, low in pairwise(bounds.tolist()):
            inside = _between(edges, low, high)
            if len(inside):
                boxes.append(_box(inside.min(axis=0), inside.max(axis=0), low, high))
    for side in (1.0, -1.0):
        beside = [p[(p[:, 2] > top) & (side * p[:, 1] >= widest / 2)] for p in swept]
        beside = [p for p in beside if len(p)]
        if beside:
            whole = np.concatenate(beside)
            low, high = whole.min(axis=0), whole.max(axis=0)
            boxes.append(_box(low, high, float(low[2]), float(high[2])))
    if not boxes:
        boxes.append((Box((0.04, 0.04, 0.02)), Pose((0.0, 0.0, top - 0.01))))
    return tuple(boxes)


def finger_box(fingers: list[Array], widths: list[float]) -> tuple[Box, Pose]:
    """Return a box around the +y finger at all openings, each moved back by half of the opening."""
    moved = np.concatenate(
        [points - [0.0, width / 2, 0.0] for points, width in zip(fingers, widths, strict=True)]
    )
    low, high = moved.min(axis=0), moved.max(axis=0)
    low[1] = max(low[1], 0.0)
    return _box(low, high, float(low[2]), float(high[2]))


def _box(low: Array, high: Array, bottom: float, top: float) -> tuple[Box, Pose]:
    size = (float(high[0] - low[0]), float(high[1] - low[1]), top - bottom)
    centre = (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2, (bottom + top) / 2)
    return Box((max(size[0], 1e-3), max(size[1], 1e-3), max(size[2], 1e-3))), Pose(centre)


def _hull_edges(points: Array) -> Array:
    """Return the edges (m, 2, 3) of the convex hull."""
    try:
        hull = ConvexHull(points)
    except (RuntimeError, ValueError):
        return np.stack([points, points], axis=1)
    pairs = np.concatenate([hull.simplices[:, [0, 1]], hull.simplices[:, [1, 2]], hull.simplices[:, [2, 0]]])
    return points[pairs]


def _between(edges: Array, low: float, high: float) -> Array:
    """Return points (k, 3) of the edges' parts between two heights."""
    found: list[Array] = []
    for z in (low, high):
        a, b = edges[:, 0], edges[:, 1]
        across = (a[:, 2] - z) * (b[:, 2] - z) < 0
        share = (z - a[across, 2]) / (b[across, 2] - a[across, 2])
        found.append(a[across] + share[:, None] * (b[across] - a[across]))
    ends = edges.reshape(-1, 3)
    found.append(ends[(ends[:, 2] >= low - 1e-9) & (ends[:, 2] <= high + 1e-9)])
    return np.concatenate(found)
