"""Few boxes for many cells: each check of a configuration costs what the boxes near the arm cost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .voxel_grid import Indices, Keys, indices

MOST = 24
"""Boxes of one obstacle at most; beyond it the pairs are joined that waste least."""

Grid = NDArray[np.bool_]
Span = tuple[Indices, Indices]
"""The first cell of a box and the one after its last, (3,) each."""


def merged(packed: Keys, most: int = MOST) -> list[Span]:
    """Boxes that cover the cells, and nothing else unless there would be more than `most`.

    Greedy: from the first cell that is not covered yet the larger of two boxes is taken, one grown upwards
    and then along x and y, the other along y and x. Boxes may overlap, which makes them fewer.
    """
    cells = indices(packed)
    origin = cells.min(axis=0)
    filled: Grid = np.zeros(tuple(cells.max(axis=0) - origin + 1), dtype=np.bool_)
    filled[tuple((cells - origin).T)] = True
    left = filled.copy()
    spans: list[Span] = []
    while left.any():
        seed = np.array(np.unravel_index(int(left.argmax()), left.shape), dtype=np.int64)
        low, high = max((_grown(filled, seed, order) for order in ((2, 0, 1), (2, 1, 0))), key=_volume)
        left[tuple(slice(a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True))] = False
        spans.append((low, high))
    while len(spans) > most:
        _join(spans)
    return [(low + origin, high + origin) for low, high in spans]


def _grown(filled: Grid, seed: Indices, order: tuple[int, ...]) -> Span:
    """The box about one cell after growing it along the axes in this order as far as all of it is filled."""
    low, high = seed.copy(), seed + 1
    for axis in order:
        sides = [slice(a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True)]
        sides[axis] = slice(None)
        others = tuple(k for k in range(3) if k != axis)
        full = np.all(filled[tuple(sides)], axis=others)
        empty = np.flatnonzero(~full)
        at = int(seed[axis])
        below, above = empty[empty < at], empty[empty > at]
        low[axis] = below[-1] + 1 if len(below) else 0
        high[axis] = above[0] if len(above) else len(full)
    return low, high


def _volume(span: Span) -> int:
    return int(np.prod(span[1] - span[0]))


def _join(spans: list[Span]) -> None:
    """Replace the two boxes by the box about both where that adds least."""
    low = np.array([span[0] for span in spans])
    high = np.array([span[1] for span in spans])
    about = np.maximum(high[:, None], high[None]) - np.minimum(low[:, None], low[None])
    own = np.prod(high - low, axis=1)
    wasted = np.prod(about, axis=2) - own[:, None] - own[None]
    wasted[np.tril_indices(len(spans))] = np.iinfo(wasted.dtype).max
    i, j = (int(k) for k in np.unravel_index(int(wasted.argmin()), wasted.shape))
    joined = np.minimum(low[i], low[j]), np.maximum(high[i], high[j])
    spans[:] = [span for k, span in enumerate(spans) if k not in (i, j)] + [joined]
