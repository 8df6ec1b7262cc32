"""Straight edges in joint space: cut into small steps and asked about from the middle outwards."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from ..values import Array

RESOLUTION = 0.03
"""Greatest step along an edge, rad (Euclidean over the joints)."""


def edge_free(free: Callable[[Array], bool], a: Array, b: Array, resolution: float = RESOLUTION) -> bool:
    """Whether all steps from a (exclusive) to b (inclusive), both (n,), are free."""
    along = b - a
    count = max(1, int(np.ceil(float(np.linalg.norm(along)) / resolution)))
    return all(free(a + along * share) for share in _shares(count))


@lru_cache(maxsize=512)
def _shares(count: int) -> tuple[float, ...]:
    """1/count … 1: the end first, then halves, quarters, … because collisions come in stretches."""
    order = [count]
    left, queue = set(range(1, count)), [(0, count)]
    while left:
        low, high = queue.pop(0)
        middle = (low + high) // 2
        if middle in left:
            order.append(middle)
            left.remove(middle)
        if high - low > 1:
            queue += [(low, middle), (middle, high)]
    return tuple(k / count for k in order)
