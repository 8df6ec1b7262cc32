"""Cutting a patch of one colour where its depth steps: what is seen of a convex body has no step in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...world.values import Array
from .blobs import Pixels, connected

STEP = 0.008
"""Depth of neighbouring pixels that differs by more than this is of two bodies, m."""
LEAST = 24
"""Fewer pixels than this are no body's."""
GROWTH = 6
"""Pixels by which the parts take back what was cut away between them."""
_SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0))


def parted(depth: Array, rows: Pixels, columns: Pixels) -> list[tuple[Pixels, Pixels]]:
    """Rows and columns of the parts of a patch; the patch itself where it has no step from side to side."""
    y, x = int(rows.min()) - 1, int(columns.min()) - 1
    size = (int(rows.max()) - y + 2, int(columns.max()) - x + 2)
    inside = np.zeros(size, dtype=np.bool_)
    inside[rows - y, columns - x] = True
    near = np.zeros(size)
    near[rows - y, columns - x] = depth[rows, columns]
    known = inside & (near > 0)
    stepped = np.zeros(size, dtype=np.bool_)
    for side in _SIDES:
        other, beside = np.roll(near, side, (0, 1)), np.roll(known, side, (0, 1))
        stepped |= known & beside & (np.abs(near - other) > STEP)
    cores = connected(known & ~stepped, LEAST)
    if len(cores) < 2:
        return [(rows, columns)]
    owner = np.zeros(size, dtype=np.int32)
    for number, (core_rows, core_columns) in enumerate(cores, start=1):
        owner[core_rows, core_columns] = number
    for _ in range(GROWTH):
        owner = _grown(owner, near, inside)
    parts = [np.nonzero(owner == number) for number in range(1, len(cores) + 1)]
    return [(part_rows + y, part_columns + x) for part_rows, part_columns in parts]


def _grown(owner: NDArray[np.int32], depth: Array, inside: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Each free pixel joins the part beside it whose depth is nearest to its own."""
    grown, best = owner.copy(), np.full(owner.shape, np.inf)
    for side in _SIDES:
        part, other = np.roll(owner, side, (0, 1)), np.roll(depth, side, (0, 1))
        off = np.where((depth > 0) & (other > 0), np.abs(depth - other), STEP)
        joins = inside & (owner == 0) & (part > 0) & (off < best)
        grown[joins], best[joins] = part[joins], off[joins]
    return grown
