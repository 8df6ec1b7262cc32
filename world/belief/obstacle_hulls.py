"""Obstacle hulls: the blocks of an obstacle, gathered into few convex bodies for collision checks."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..shapes import OBSTACLE_VOLUME, Box, ConvexMesh, convex_hull
from ..values import Array, Vector3
from .planning_scene import ObstacleBlock

MAX_HULL_VOLUME_RATIO = 1.25
"""Greatest volume of a hull that stands for blocks, as a multiple of theirs."""
EDGE_DECIMALS = 5
"""Digits to which edges of blocks are compared, m: the belief rounds their places to a thousandth of a mm."""
_SIGNS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


@lru_cache(maxsize=64)
def hulls_of(blocks: tuple[ObstacleBlock, ...]) -> tuple[tuple[Box | ConvexMesh, Vector3], ...]:
    """Return convex bodies that contain all blocks, each with the place of its frame in theirs, m.

    A group of them whose convex hull wastes little becomes that hull; any other is divided where the bounding
    boxes of its two halves waste least.
    """
    sizes = np.array([block.size for block in blocks])
    middles = np.array([block.at for block in blocks])
    found: list[tuple[Box | ConvexMesh, Vector3]] = []
    waiting: list[NDArray[np.intp]] = [np.arange(len(blocks), dtype=np.intp)]
    while waiting:
        group = waiting.pop()
        body = _one_body(sizes[group], middles[group])
        if body is not None:
            found.append(body)
        else:
            first, second = _halves(sizes[group], middles[group])
            waiting += [group[second], group[first]]
    return tuple(found)


def _one_body(sizes: Array, middles: Array) -> tuple[Box | ConvexMesh, Vector3] | None:
    """Return the hull of blocks (n, 3), a box where it is one; None when it wastes too much."""
    corners = (middles[:, None] + _SIGNS * sizes[:, None]).reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    volume = _union(middles - sizes / 2, middles + sizes / 2)
    if float((high - low).prod()) < volume + 1e-9:
        return Box(_vector(high - low)), _vector((low + high) / 2)
    hull = convex_hull(corners)
    if float(hull.volume) > MAX_HULL_VOLUME_RATIO * volume:
        return None
    vertices = np.unique(corners[hull.vertices], axis=0)
    return ConvexMesh(tuple(_vector(vertex) for vertex in vertices), OBSTACLE_VOLUME), (0.0, 0.0, 0.0)


def _halves(sizes: Array, middles: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the numbers of the blocks (n, 3) on either side of the best cut between them."""
    low, high = middles - sizes / 2, middles + sizes / 2
    found: list[tuple[float, NDArray[np.intp], NDArray[np.intp]]] = []
    for axis in range(3):
        order = np.argsort(middles[:, axis], kind="stable")
        waste = _volumes(low[order], high[order])[:-1] + _volumes(low[order[::-1]], high[order[::-1]])[-2::-1]
        cut = int(waste.argmin())
        found.append((round(float(waste[cut]), 12), order[: cut + 1], order[cut + 1 :]))
    _, first, second = min(found, key=lambda each: each[0])
    return first, second


def _volumes(low: Array, high: Array) -> Array:
    """Return the volumes of the bounding boxes of the first, the first two, … of boxes (n, 3), (n,) m³."""
    return (np.maximum.accumulate(high) - np.minimum.accumulate(low)).prod(axis=1)


def _union(low: Array, high: Array) -> float:
    """Return the volume of boxes (n, 3) together, m³; they may overlap."""
    edges = [np.unique(np.round(np.concatenate([low[:, k], high[:, k]]), EDGE_DECIMALS)) for k in range(3)]
    filled = np.zeros([len(each) - 1 for each in edges])
    first, last = (
        [np.searchsorted(each, np.round(side[:, k], EDGE_DECIMALS)) for k, each in enumerate(edges)]
        for side in (low, high)
    )
    for x, y, z, u, v, w in zip(*first, *last, strict=True):
        filled[x:u, y:v, z:w] = 1.0
    lengths = [np.diff(each) for each in edges]
    return float(np.einsum("xyz,x,y,z->", filled, *lengths))


def _vector(numbers: Array) -> Vector3:
    x, y, z = (round(float(n), 6) for n in numbers)
    return x, y, z
