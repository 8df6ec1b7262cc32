"""RRT-Connect between a start and any of several goals, shortening of the found path, and its improvement by
further searches.

Kuffner and LaValle, "RRT-Connect: an efficient approach to single-query path planning", ICRA 2000. The
nearest node is found by comparing all: in trees of some hundred nodes that costs less than a collision check.
Both trees may begin with a retreat path from their roots, see `joint_planner`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from picktree.world import Array

from .path_search import EdgeFree

MAX_EXTENSION = 1.0
"""Greatest extension of a tree, rad."""
NEAR_SHARE = 0.7
"""Share of the samples from the box that start and goal span: paths there are shorter and found sooner."""
NEAR_MARGIN = 0.5
"""Distance by which that box is wider than start and goal, rad."""
FIRST_BLOCK, MAX_BLOCK = 4, 32
"""Numbers of samples that are drawn, and compared with a tree, at once: first, and after doubling."""
MIN_GAIN = 0.005
"""Share of a path's length below which a corner is not cut."""
MIN_MOVE_GAIN = 0.015
"""Share below which a corner is not moved: that takes the checks of two whole edges."""
FIRST_CUT = 0.5
"""First distance from a corner at which it is cut, as a share of the lengths of its two edges together."""
CUT_REDUCTION = 0.7
"""Factor on that distance after a cut that was not free."""
MAX_CORNER_MOVES = 60
"""Number of attempts to move corners of a path."""
MOVE_SHARES = (0.5, 0.25)
"""Shares of the way to the straight line by which a corner is moved in all joints together."""
MAX_LENGTH_RATIO = 1.3
"""Ratio of a further path's length to the best one's above which it is not shortened."""

Rooted = tuple[Array, Sequence[Array]]
"""Root (n,) and a chain of configurations that leads away from it by free edges."""


@dataclass(frozen=True, slots=True, eq=False)
class SearchChecks:
    """Collision checks of one search."""

    edge: EdgeFree
    between: EdgeFree
    """Whether everything between two configurations that are free is free."""
    count_blocked: Callable[[Array], int]
    """Return the number of configurations (m, n) before the first that is free."""
    left: Callable[[], int]
    """Return the number of checks after which the search is given up."""


def rrt_connect(
    lower: Array,
    upper: Array,
    start: Rooted,
    goals: Sequence[Rooted],
    checks: SearchChecks,
    rng: np.random.Generator,
) -> list[Array] | None:
    """Search a path, each (n,), from start to one of the goals. None when the checks are spent first."""
    ours, theirs, samples = SearchTree([start]), SearchTree(goals), _Samples(lower, upper, start, goals, rng)
    forward = True
    for end in ours.ends:
        for other in theirs.ends:
            if checks.between(ours.points[end], theirs.points[other]):
                return ours.back(end)[::-1] + theirs.back(other)
    while left := checks.left():
        # The smaller tree grows, so that a tree in a narrow place is not left behind.
        if ours.count > theirs.count:
            ours, theirs, forward = theirs, ours, not forward
        new = _extend(ours, samples, checks, left)
        if new is None:
            continue
        met = _connect(theirs, ours.points[new], checks)
        if met is not None:
            samples.close()
            path = ours.back(new)[::-1] + theirs.back(met)
            return path if forward else path[::-1]
    samples.close()
    return None


def shorten_path(path: list[Array], edge: EdgeFree, between: EdgeFree) -> list[Array]:
    """Return a path with the same ends and free edges that is no longer.

    Corners are skipped, then cut, then moved towards the straight line between their neighbours.
    """
    known: dict[tuple[bytes, bytes], bool] = {}

    def asked_once(a: Array, b: Array) -> bool:
        key = a.tobytes(), b.tobytes()
        if key not in known:
            known[key] = between(a, b)
        return known[key]

    path = _skip_corners(_cut_corners(_skip_corners(path, asked_once), asked_once), asked_once)
    return _skip_corners(_move_corners(path, edge, between), asked_once)


def path_length(path: Sequence[Array]) -> float:
    """Return the length of a path, rad."""
    return sum(_distance(a, b) for a, b in pairwise(path))


def improve_path(
    path: list[Array],
    search: Callable[[], list[Array] | None],
    edge: EdgeFree,
    between: EdgeFree,
    give_up: Callable[[], bool],
) -> list[Array]:
    """Return the shortest of a path and of those that further searches find, shortened, before `give_up`.

    `search` returns another path with the same ends each time, or None where it has spent its own checks.
    """
    length = path_length(path)
    while not give_up():
        found = search()
        if found is None or path_length(other := _skip_corners(found, between)) > MAX_LENGTH_RATIO * length:
            continue
        other = shorten_path(other, edge, between)
        if path_length(other) < length:
            path, length = other, path_length(other)
    return path


class SearchTree:
    """Search tree: configurations by number with their parents; the roots come first."""

    def __init__(self, roots: Sequence[Rooted]) -> None:
        self.points: Array = np.empty((256, len(roots[0][0])))
        self._parents: list[int] = []
        self.count = 0
        self._block: Array = np.empty((0, 0))
        self._block_count = 0
        self._block_nearest: tuple[NDArray[np.intp], Array] = np.empty(0, np.intp), np.empty(0)
        self.ends: list[int] = []
        """Last node of each root's chain."""
        for root, _ in roots:
            self.add(root, -1)
        for k, (_, chain) in enumerate(roots):
            end = k
            for q in chain:
                end = self.add(q, end)
            self.ends.append(end)

    def add(self, q: Array, parent: int) -> int:
        if self.count == len(self.points):
            self.points = np.concatenate([self.points, np.empty_like(self.points)])
        self.points[self.count] = q
        self._parents.append(parent)
        self.count += 1
        return self.count - 1

    def nearest(self, q: Array) -> tuple[int, float]:
        """Return the nearest node and its distance, rad."""
        apart = self.points[: self.count] - q
        squared: Array = np.einsum("ij,ij->i", apart, apart)
        k = int(squared.argmin())
        return k, math.sqrt(float(squared[k]))

    def towards(self, block: Array, row: int) -> tuple[NDArray[np.intp], Array]:
        """Return the nearest nodes (m,) to the samples of a block from a row on, and their extensions' ends.

        The ends (m, n) are at most MAX_EXTENSION away. After the first time only new nodes are compared.
        """
        if block is not self._block:
            self._block, self._block_count = block, 0
            self._block_nearest = np.zeros(len(block), np.intp), np.full(len(block), np.inf)
        known, squared = self._block_nearest
        if self._block_count < self.count:
            apart = block[row:, None] - self.points[self._block_count : self.count]
            each: Array = np.einsum("kij,kij->ki", apart, apart)
            k = each.argmin(axis=1)
            least = each[np.arange(len(k)), k]
            nearer = least < squared[row:]
            known[row:][nearer] = k[nearer] + self._block_count
            squared[row:][nearer] = least[nearer]
            self._block_count = self.count
        near, samples, distance = self.points[known[row:]], block[row:], np.sqrt(squared[row:])[:, None]
        share = MAX_EXTENSION / np.maximum(distance, MAX_EXTENSION)
        return known[row:], np.where(distance <= MAX_EXTENSION, samples, near + (samples - near) * share)

    def back(self, k: int) -> list[Array]:
        """Return the branch from a node to its root; copies."""
        path = list[Array]()
        while k >= 0:
            path.append(self.points[k].copy())
            k = self._parents[k]
        return path


class _Samples:
    """Targets of the trees' growth: near start and goal, and everywhere within the limits."""

    def __init__(
        self, lower: Array, upper: Array, start: Rooted, goals: Sequence[Rooted], rng: np.random.Generator
    ) -> None:
        ends: Array = np.array([goal for goal, _ in goals])
        self._everywhere = lower, upper
        self._lower = np.maximum(np.minimum(start[0], ends) - NEAR_MARGIN, lower)
        self._upper = np.minimum(np.maximum(start[0], ends) + NEAR_MARGIN, upper)
        self._rng = rng
        self.block: Array = np.empty((0, len(lower)))
        """Samples (m, n) that were drawn at once, as far as they do not depend on each other."""
        self._count = FIRST_BLOCK
        self.row = 0
        """Number of the first of them that has not been used."""

    def fill(self) -> None:
        """Draw the next block if this one is used up."""
        if self.row == len(self.block):
            self.block, self.row = self._drawn(), 0

    def close(self) -> None:
        """Return the rest of the block to the random stream, so that the next search continues from here."""
        unused, stream = len(self.block) - self.row, self._rng.bit_generator
        if unused > 0:
            assert isinstance(stream, np.random.PCG64), "random numbers are those of numpy's default_rng"
            stream.advance(-unused * (1 + self.block.shape[1]))

    def _drawn(self) -> Array:
        """Return the next block (m, n). Draws among several goals cannot be returned: one at a time."""
        lower, upper = self._everywhere
        if len(self._lower) == 1:
            unit = self._rng.random((self._count, 1 + len(lower)))
            self._count = min(2 * self._count, MAX_BLOCK)
            near = unit[:, :1] < NEAR_SHARE
            low = np.where(near, self._lower, lower)
            return low + (np.where(near, self._upper, upper) - low) * unit[:, 1:]
        if self._rng.random() < NEAR_SHARE:
            k = int(self._rng.integers(len(self._lower)))
            lower, upper = self._lower[k], self._upper[k]
        return self._rng.uniform(lower, upper)[None]


def _extend(tree: SearchTree, samples: _Samples, checks: SearchChecks, left: int) -> int | None:
    """Extend a tree towards the first of the next samples to which the end of the extension is free, in at
    most `left` checks.

    Returns the new node's number; None: there is no such sample, or the edge is not free.
    """
    samples.fill()
    nearest, ends = tree.towards(samples.block, samples.row)
    # Most extensions fail at their end. As long as they do, the tree does not change.
    blocked = checks.count_blocked(ends[:left])
    samples.row += min(blocked + 1, len(ends), left)
    if blocked == min(len(ends), left):
        return None
    k, q = int(nearest[blocked]), ends[blocked]
    return tree.add(q, k) if checks.between(tree.points[k], q) else None


def _connect(tree: SearchTree, target: Array, checks: SearchChecks) -> int | None:
    """Grow the tree towards the target while edges are free. Returns the node from which the target is
    reached, else None."""
    k, distance = tree.nearest(target)
    while distance > MAX_EXTENSION:
        near = tree.points[k]
        q = near + (target - near) * (MAX_EXTENSION / distance)
        if not checks.edge(near, q):
            return None
        k, distance = tree.add(q, k), distance - MAX_EXTENSION
    return k if checks.between(tree.points[k], target) else None


def _skip_corners(path: list[Array], between: EdgeFree) -> list[Array]:
    """Skip corners: from each point go straight to the furthest reachable one."""
    kept, k = [path[0]], 0
    while k < len(path) - 1:
        k = next(j for j in range(len(path) - 1, k, -1) if j == k + 1 or between(path[k], path[j]))
        kept.append(path[k])
    return kept


def _cut_corners(path: list[Array], between: EdgeFree) -> list[Array]:
    """Cut corners off, the one that gains most first, each as far from its tip as is free."""
    points, shares, left = list(path), [FIRST_CUT] * len(path), MIN_GAIN * path_length(path)
    cuts: dict[tuple[int, int, int, float], _Cut] = {}

    def cut(k: int) -> _Cut:
        around = points[k - 1], points[k], points[k + 1]
        key = id(around[0]), id(around[1]), id(around[2]), shares[k]
        if key not in cuts:
            cuts[key] = _cut(*around, shares[k])
        return cuts[key]

    while len(points) > 2:
        k = max(range(1, len(points) - 1), key=lambda k: cut(k).gain)
        best = cut(k)
        if best.gain < left:
            break
        if between(best.before, best.after):
            new = [q for q in (best.before, best.after) if q is not points[k - 1] and q is not points[k + 1]]
            points[k : k + 1] = new
            shares[k : k + 1] = [FIRST_CUT] * len(new)
        else:
            shares[k] *= CUT_REDUCTION
    return points


@dataclass(frozen=True, slots=True, eq=False)
class _Cut:
    """Edge that cuts a corner off, from a point before it to one after it, and the length that it saves,
    rad."""

    gain: float
    around: tuple[Array, Array, Array]
    """Corner and its neighbours: they live as long as the cut, so their identities stay unique."""
    before: Array
    after: Array


def _cut(a: Array, corner: Array, b: Array, share: float) -> _Cut:
    to_a, to_b = _distance(a, corner), _distance(corner, b)
    off = share * (to_a + to_b)
    before = a if off >= to_a else corner + (a - corner) * (off / to_a)
    after = b if off >= to_b else corner + (b - corner) * (off / to_b)
    gain = min(off, to_a) + min(off, to_b) - _distance(before, after)
    return _Cut(gain, (a, corner, b), before, after)


def _move_corners(path: list[Array], edge: EdgeFree, between: EdgeFree) -> list[Array]:
    """Move corners towards the straight line between their neighbours, in all joints or in one of them.

    Geraerts and Overmars, "Creating high-quality paths for motion planning", IJRR 26 (2007): partial
    shortcuts.
    """
    points, left = list(path), MIN_MOVE_GAIN * path_length(path)
    failed: list[set[int]] = [set() for _ in points]
    for _ in range(MAX_CORNER_MOVES):
        moves = [
            (*_best_move(points[k - 1], points[k], points[k + 1], failed[k]), k)
            for k in range(1, len(points) - 1)
        ]
        gain, number, corner, k = max(moves, key=lambda move: move[0], default=(0.0, 0, path[0], 0))
        if gain < left:
            break
        if edge(points[k - 1], corner) and between(corner, points[k + 1]):
            points[k] = corner
            for near in (k - 1, k, k + 1):
                failed[near].clear()
        else:
            failed[k].add(number)
    return points


def _best_move(a: Array, corner: Array, b: Array, failed: set[int]) -> tuple[float, int, Array]:
    """Return the gain, rad, the number, and the result (n,) of the move of a corner that gains most."""
    to_a, to_b = _distance(a, corner), _distance(corner, b)
    straight = a + (b - a) * (to_a / max(to_a + to_b, 1e-12))
    n = len(corner)
    moved = np.repeat(corner[None], n + len(MOVE_SHARES), axis=0)
    moved[np.arange(n), np.arange(n)] = straight
    for k, share in enumerate(MOVE_SHARES, n):
        moved[k] += (straight - corner) * share
    lengths: Array = np.sqrt(np.square(moved - a).sum(axis=1)) + np.sqrt(np.square(moved - b).sum(axis=1))
    gains = to_a + to_b - lengths
    gains[list(failed)] = 0.0
    number = int(gains.argmax())
    return float(gains[number]), number, moved[number].copy()


def _distance(a: Array, b: Array) -> float:
    along = b - a
    return math.sqrt(float(along @ along))
