"""Unknown obstacles as voxel volumes of the belief: unexplained depth adds cells, rays that pass remove them,
hidden cells stay.

A cell is occupied when something unexplained was seen in it or above it, and no ray has passed it since.
Cells stay where the picture shows nothing of them: behind the robot, behind nearer bodies, out of the view.
What is seen for the first time may go on there: cells beside it behind the robot, or out of the view, are
occupied until rays pass them, or until nothing that was seen is left beside them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ...world.belief.planning_scene import BeliefObject, PlanningScene
from ...world.shapes import inside
from ...world.values import ObjectId
from .space_carving import (
    CELL_SIZE,
    NO_CELLS,
    Indices,
    Keys,
    adjacent_cells,
    cell_centres,
    cell_indices,
    cells_of,
    in_picture,
    obstacle_from_cells,
    occupied_cells,
    retained_cells,
    supposed_cells_of,
    surface_of,
    unseen_cells,
)
from .view import PerceivedView, UnexplainedPatch

Grid = NDArray[np.bool_]
Span = tuple[Indices, Indices]
"""First cell of a box and the one after its last, (3,) each."""


def merge_cells(packed: Keys) -> list[Span]:
    """Cover the cells with boxes that contain nothing else.

    Greedy: from the first cell that is not covered yet the larger of two boxes is taken. One grows upwards
    and then along x and y, the other along y and x. Boxes may overlap, which reduces their number.
    """
    if not len(packed):
        return []
    cells = cell_indices(packed)
    origin = cells.min(axis=0)
    filled: Grid = np.zeros(tuple(cells.max(axis=0) - origin + 1), dtype=np.bool_)
    filled[tuple((cells - origin).T)] = True
    left = filled.copy()
    spans: list[Span] = []
    while left.any():
        seed = np.array(np.unravel_index(int(left.argmax()), left.shape), dtype=np.int64)
        low, high = max((_grow_box(filled, seed, order) for order in ((2, 0, 1), (2, 1, 0))), key=_volume)
        left[tuple(slice(a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True))] = False
        spans.append((low, high))
    return [(low + origin, high + origin) for low, high in spans]


def _grow_box(filled: Grid, seed: Indices, order: tuple[int, ...]) -> Span:
    """Grow the box about one cell along the axes in this order, as long as all of it is filled."""
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


MIN_OBSTACLE_CELLS = 6
"""Least number of connected cells in which something was seen; fewer are noise."""
SAME_OBSTACLE_DISTANCE = 0.05
"""Distance to a former obstacle that left its place, within which an unexplained body is the same obstacle,
m."""
ITEM_MARGIN = 0.003
"""Distance from a recognised item within which the middles of cells belong to it, m."""
MAX_NOISE_SHARE = 0.03
"""Greatest share of new cells at the surface that is put down to noise."""
MIN_ITEM_SHARE = 0.4
"""Least share of an obstacle's cells in a recognised item at which the obstacle was that item."""

REASON_FIRST_SEEN = "depth that nothing explains"
REASON_SEEN_AGAIN = "seen again"
REASON_GREW = "more of it was seen"
REASON_CLEARED = "rays pass through parts of it"
REASON_CHANGED = "it was seen to take up other space"
REASON_GONE = "its place was seen without it"


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Connected cells, and the patches of the view that show them."""

    cells: Keys
    patches: tuple[UnexplainedPatch, ...]


def update_volumes(
    scene: PlanningScene,
    view: PerceivedView,
    patches: Sequence[UnexplainedPatch],
    items: Sequence[BeliefObject],
    now: float,
) -> list[ObjectId]:
    """Update the obstacles of `scene` with a view; `items` are those that the view shows. Returns the ids of
    removed obstacles."""
    former = {o.id: cells_of(o) for o in scene.objects if o.role == "obstacle" and not o.attached}
    if not former and not patches:
        return []
    new = _outside_items(occupied_cells(view, patches), items)
    kept = {
        name: _outside_items(retained_cells(view, _unless_item(cells, items)), items)
        for name, cells in former.items()
    }
    hidden = _hidden_parts(scene, view, new, former.values())
    still = np.concatenate([NO_CELLS, *kept.values()])
    before = _supposed(scene, former)
    # A pixel at the border reaches beyond the picture. No ray would ever pass what it takes up there.
    shown = np.union1d(new[in_picture(view, new)], np.setdiff1d(still, before))
    cells = np.unique(np.concatenate([new, hidden, still]))
    supposed = np.setdiff1d(np.union1d(cells, before), shown)
    seen = _components(cells, supposed, view, patches)
    names = _match_former(seen, former)
    for name, each in zip(names, seen, strict=True):
        _store_obstacle(
            scene,
            name or scene.new_id("obstacle"),
            each,
            former.get(name, NO_CELLS) if name else NO_CELLS,
            supposed,
            now,
        )
    gone = [name for name in former if name not in names]
    for name in gone:
        scene.remove(name, REASON_GONE)
    return gone


def _supposed(scene: PlanningScene, names: Iterable[ObjectId]) -> Keys:
    """Return the cells of these obstacles in which nothing was seen yet."""
    return np.unique(np.concatenate([NO_CELLS, *(supposed_cells_of(scene.get(name)) for name in names)]))


def _hidden_parts(scene: PlanningScene, view: PerceivedView, new: Keys, former: Iterable[Keys]) -> Keys:
    """Return the cells that new parts of obstacles may take up where the picture shows nothing.

    What was believed before has been seen from there already, as its rim has, which comes and goes.
    """
    known = np.unique(np.concatenate([NO_CELLS, *former]))
    fresh = new[~adjacent_cells(new, known)] if len(known) else new
    items = [o for o in scene.objects if o.role == "item"]
    return _outside_items(unseen_cells(view, fresh), items) if len(fresh) else NO_CELLS


def _outside_items(cells: Keys, items: Sequence[BeliefObject]) -> Keys:
    for item in items:
        cells = cells[~inside(item.shape, item.pose, cell_centres(cells), ITEM_MARGIN)]
    return cells


def _unless_item(cells: Keys, items: Sequence[BeliefObject]) -> Keys:
    """Return no cells when they were a recognised item: cells that it hides now are not kept."""
    points = cell_centres(cells)
    for item in items:
        if inside(item.shape, item.pose, points, float(CELL_SIZE[0])).mean() > MIN_ITEM_SHARE:
            return NO_CELLS
    return cells


def _components(
    cells: Keys, supposed: Keys, view: PerceivedView, patches: Sequence[UnexplainedPatch]
) -> list[_Seen]:
    """Group cells that are connected as seen from above, the largest group first.

    What was only supposed goes with the last of what was seen beside it.
    """
    if not len(cells):
        return []
    columns = cell_indices(cells)[:, :2]
    origin = columns.min(axis=0)
    at = tuple((columns - origin).T)
    plan = np.zeros(tuple(columns.max(axis=0) - origin + 1), dtype=np.uint8)
    plan[at] = 1
    _, marks = cv2.connectedComponents(cv2.dilate(plan, np.ones((3, 3), np.uint8)), connectivity=8)
    mark = np.asarray(marks, dtype=np.intp)[at]
    groups = [cells[mark == k] for k in range(1, int(mark.max()) + 1)]
    groups = [g for g in groups if np.isin(g, supposed, invert=True).sum() >= MIN_OBSTACLE_CELLS]
    groups.sort(key=lambda g: (-len(g), int(g[0])))
    surfaces = [(patch, surface_of(view, patch)) for patch in patches]
    return [
        _Seen(g, tuple(patch for patch, surface in surfaces if len(np.intersect1d(g, surface)) > 0))
        for g in groups
    ]


def _match_former(seen: Sequence[_Seen], former: dict[ObjectId, Keys]) -> list[ObjectId | None]:
    """Match each group to the id of a former obstacle; None for a new one.

    The former obstacle that shares most cells comes first, then one close by that shares none with any.
    """
    shared = [
        (len(np.intersect1d(each.cells, cells)), n, name)
        for n, each in enumerate(seen)
        for name, cells in former.items()
    ]
    names: list[ObjectId | None] = [None] * len(seen)
    left = list(former)
    for count, n, name in sorted(shared, key=lambda s: -s[0]):
        if count > 0 and names[n] is None and name in left:
            names[n] = name
            left.remove(name)
    for n, each in enumerate(seen):
        if names[n] is None and left:
            middle = cell_centres(each.cells).mean(axis=0)
            away = {
                name: float(np.linalg.norm(cell_centres(former[name]).mean(axis=0) - middle)) for name in left
            }
            nearest = min(left, key=lambda name: (away[name], name))
            if away[nearest] < SAME_OBSTACLE_DISTANCE:
                names[n] = nearest
                left.remove(nearest)
    return names


def _store_obstacle(
    scene: PlanningScene, name: ObjectId, seen: _Seen, before: Keys, supposed: Keys, now: float
) -> None:
    known = scene.find(name)
    cells = seen.cells
    if known is not None:
        gone = np.setdiff1d(before, cells, assume_unique=True)
        # Edges come and go with the noise: cells next to occupied ones stay occupied.
        cells = np.union1d(cells, gone[adjacent_cells(gone, cells)])
        found = np.setdiff1d(np.intersect1d(supposed_cells_of(known), cells), supposed)
        if _is_unchanged(cells, before) and len(found) <= MAX_NOISE_SHARE * len(cells):
            if seen.patches:
                scene.put(replace(known, last_seen=now), REASON_SEEN_AGAIN)
            return
    assumed = np.isin(cells, supposed)
    shape, pose, blocks = obstacle_from_cells(merge_cells(cells[~assumed]), merge_cells(cells[assumed]))
    colour = _colour(seen.patches) or (known.colour if known is not None else "grey")
    last_seen = now if seen.patches or known is None else known.last_seen
    belief = BeliefObject(
        name, "obstacle", "unknown", "unknown", shape, colour, pose, 0.005, 0.1, 0.5, last_seen, blocks=blocks
    )
    scene.put(belief, _reason(cells, before))


def _is_unchanged(cells: Keys, before: Keys) -> bool:
    """Whether nothing is gone and, apart from noise at the surface, nothing is new."""
    new = np.setdiff1d(cells, before, assume_unique=True)
    if len(new) > MAX_NOISE_SHARE * len(cells) or len(cells) - len(new) < len(before):
        return False
    return bool(adjacent_cells(new, before).all())


def _reason(cells: Keys, before: Keys) -> str:
    if not len(before):
        return REASON_FIRST_SEEN
    more = len(np.setdiff1d(cells, before, assume_unique=True)) > 0
    less = len(np.setdiff1d(before, cells, assume_unique=True)) > 0
    return REASON_CHANGED if more and less else REASON_CLEARED if less else REASON_GREW


def _colour(patches: Sequence[UnexplainedPatch]) -> str | None:
    """Colour of the largest patch; None without patches."""
    largest = max(patches, key=lambda patch: len(patch.rows), default=None)
    return None if largest is None else largest.colour
