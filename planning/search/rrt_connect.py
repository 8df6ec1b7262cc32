"""RRT-Connect between a start and any of several goals, and shortcuts of the found path.

Kuffner and LaValle, "RRT-Connect: an efficient approach to single-query path planning", ICRA 2000. The
nearest node is found by comparing all: in trees of some hundred nodes that costs less than a collision check.
Both trees may begin with a retreat path from their roots, see `joint_planner`.
"""

from __future__ import annotations

import math
from bisect import bisect
from collections.abc import Callable, Sequence

import numpy as np

from ...world.values import Array
from .path_search import EdgeFree

MAX_EXTENSION = 1.0
"""Greatest extension of a tree, rad."""
SHORTCUT_ATTEMPTS = 120
"""Number of attempts to shorten a path between two random points."""
MAX_FAILED_SHORTCUTS = 20
"""Number of failed attempts in a row after which shortening ends."""
MIN_SHORTCUT_GAIN = 0.02
"""Share of a path's length below which a shortcut is not tried."""

Rooted = tuple[Array, Sequence[Array]]
"""Root (n,) and a chain of configurations that leads away from it by free edges."""


def rrt_connect(
    lower: Array,
    upper: Array,
    start: Rooted,
    goals: Sequence[Rooted],
    edge: EdgeFree,
    between: EdgeFree,
    give_up: Callable[[], bool],
    rng: np.random.Generator,
) -> list[Array] | None:
    """Search a path, each (n,), from start to one of the goals. None when `give_up` came true first.

    `edge` checks the second configuration, too; `between` does not.
    """
    ours, theirs = _Tree([start]), _Tree(goals)
    forward = True
    for end in ours.ends:
        for other in theirs.ends:
            if between(ours.points[end], theirs.points[other]):
                return ours.back(end)[::-1] + theirs.back(other)
    while not give_up():
        # The smaller tree grows, so that a tree in a narrow place is not left behind.
        if ours.count > theirs.count:
            ours, theirs, forward = theirs, ours, not forward
        new = _extend(ours, rng.uniform(lower, upper), edge)
        if new is None:
            continue
        met = _connect(theirs, ours.points[new], edge, between)
        if met is not None:
            path = ours.back(new)[::-1] + theirs.back(met)
            return path if forward else path[::-1]
    return None


def shortcut_path(path: list[Array], between: EdgeFree, rng: np.random.Generator) -> list[Array]:
    """Return a path with the same ends and free edges that is no longer; `between` gets free ends only."""
    known: dict[tuple[bytes, bytes], bool] = {}

    def asked_once(a: Array, b: Array) -> bool:
        key = a.tobytes(), b.tobytes()
        if key not in known:
            known[key] = between(a, b)
        return known[key]

    return _skip_corners(_cut_shortcuts(_skip_corners(path, asked_once), asked_once, rng), asked_once)


class _Tree:
    """Nodes by number: their configurations and their parents; the roots come first."""

    def __init__(self, roots: Sequence[Rooted]) -> None:
        self.points: Array = np.empty((256, len(roots[0][0])))
        self._parents: list[int] = []
        self.count = 0
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

    def back(self, k: int) -> list[Array]:
        """Return the branch from a node to its root; copies."""
        path = list[Array]()
        while k >= 0:
            path.append(self.points[k].copy())
            k = self._parents[k]
        return path


def _extend(tree: _Tree, towards: Array, edge: EdgeFree) -> int | None:
    """Add a node at most RANGE from the nearest one, if the edge is free. Returns its number, else None."""
    k, distance = tree.nearest(towards)
    near = tree.points[k]
    q = towards if distance <= MAX_EXTENSION else near + (towards - near) * (MAX_EXTENSION / distance)
    return tree.add(q, k) if edge(near, q) else None


def _connect(tree: _Tree, target: Array, edge: EdgeFree, between: EdgeFree) -> int | None:
    """Grow the tree towards the target while edges are free. Returns the node from which the target is
    reached, else None."""
    k, distance = tree.nearest(target)
    while distance > MAX_EXTENSION:
        near = tree.points[k]
        q = near + (target - near) * (MAX_EXTENSION / distance)
        if not edge(near, q):
            return None
        k, distance = tree.add(q, k), distance - MAX_EXTENSION
    return k if between(tree.points[k], target) else None


def _skip_corners(path: list[Array], between: EdgeFree) -> list[Array]:
    """Skip corners: from each point go straight to the furthest reachable one."""
    kept, k = [path[0]], 0
    while k < len(path) - 1:
        k = next(j for j in range(len(path) - 1, k, -1) if j == k + 1 or between(path[k], path[j]))
        kept.append(path[k])
    return kept


def _cut_shortcuts(path: list[Array], between: EdgeFree, rng: np.random.Generator) -> list[Array]:
    """Cut a path short between random points.

    Geraerts and Overmars, "Creating high-quality paths for motion planning", IJRR 26 (2007).
    """
    failed, along = 0, _cumulative_lengths(path)
    for low, high in np.sort(rng.random((SHORTCUT_ATTEMPTS, 2)), axis=1).tolist():
        if len(path) < 3 or failed == MAX_FAILED_SHORTCUTS:
            break
        low, high = low * along[-1], high * along[-1]
        i, j = bisect(along, low) - 1, min(bisect(along, high) - 1, len(path) - 2)
        if i == j:
            continue
        a = path[i] + (path[i + 1] - path[i]) * ((low - along[i]) / (along[i + 1] - along[i]))
        b = path[j] + (path[j + 1] - path[j]) * ((high - along[j]) / (along[j + 1] - along[j]))
        if high - low - math.sqrt(float((b - a) @ (b - a))) < MIN_SHORTCUT_GAIN * along[-1]:
            continue
        if between(a, b):
            path, failed = [*path[: i + 1], a, b, *path[j + 1 :]], 0
            along = _cumulative_lengths(path)
        else:
            failed += 1
    return path


def _cumulative_lengths(path: list[Array]) -> list[float]:
    """Return the length of the path up to each point, rad."""
    steps: Array = np.diff(np.array(path), axis=0)
    return [0.0, *np.cumsum(np.sqrt(np.einsum("ij,ij->i", steps, steps))).tolist()]
