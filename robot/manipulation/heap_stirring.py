"""Stirring: strokes through a heap, with a look after each, until things lie where the hand gets hold of
them.

Strokes are planned from the height map. The hand is swept over the map, as for grasps: the fingers must fit
where a stroke begins, and the palm all along it. The value of a stroke is the volume that it moves, weighted
by the gain of the new place for a grasp. Pushes that make grasps possible were planned from height maps by
Danielczuk et al. ("Linear push policies to increase grasp access for robot bin picking", CASE 2018); the
value here is another one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import (
    Array,
    BeliefObject,
    Failure,
    ObjectId,
    Pose,
    event_types,
    grasp,
    heap_geometry,
    matches,
    planar_geometry,
    planning,
    push,
)
from picktree.world.robot_model import GripperDescription

from .grasps import Block, HandShape
from .heap_pick import RIM_CLEARANCE, HeapPickTask, look_into_tote, rim_height
from .heap_views import surfaces
from .stroke_execution import (
    DRAG_STIFFNESS,
    STEP_BACK_HEIGHT,
    DragMotion,
    PushMotion,
    configuration_above_start,
    follow_course,
    move_to_start,
    samples,
    step_back,
)
from .stroke_planning import straight

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing

STROKE_DIRECTIONS = 16
"""Directions of strokes over a whole turn."""
STROKE_TILT = math.radians(30.0)
"""Angle between a leaning hand and the vertical, rad: it reaches the foot of the wall behind it."""
STROKE_LENGTHS = (0.05, 0.09, 0.13)
"""Lengths of strokes, m."""
STROKE_HEIGHTS = (0.006, 0.010, 0.016, 0.026, 0.038)
"""Heights of the finger tips above the floor, m: the lowest that is free where the stroke begins is taken."""
START_CLEARANCE, PALM_CLEARANCE = 0.003, 0.005
"""Clearance around the fingers where a stroke begins, and around the palm all along it, m."""
WALL_REACH = 0.09
"""Distance from a wall from which on it does not hinder a grasp, m."""
REACH_TILT, REACH_SHARE, REACH_VALUE = math.radians(25.0), 0.5, 0.7
"""Tilt of the hand, rad, and share of its closing directions that have room at a place from which on the
place is no better. Value of that room; the rest is for the distance from the walls."""
STIR_VALUE = 0.5
"""Value of moved volume by itself; that of coming from where the hand has no room to where it has is 1."""
PUSHED_DISTANCE = 0.015
"""Distance of the middle of the pushed things from the fingers, m."""
TOP_DEPTH, MIN_SUPPORT = 0.008, 0.5
"""Depth below the highest point under the fingers that counts as the top of a thing, m, and its least
share."""
MAX_DESCENT = 0.015
"""Greatest height of the fingers above a thing that they come down on, m."""
THING_REACH = 0.02
"""Distance up to which things move along with the fingers on them, m."""
HOOK_REACH, HOOK_RISE = 0.018, 0.008
"""Distance ahead of the fingers at which a crest holds a thing to them, and its height for a sure hold, m."""
MIN_STROKE_VALUE = 1e-6
"""Least value of a stroke, m³."""
BLOCK_EDGE = 10
"""Edge length in cells of the squares of which each has one stroke for a direction."""
Heights = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Posture:
    """Posture of the hand in a stroke."""

    name: str
    tilt: float
    """Angle between hand and vertical, rad."""
    side: int = 0
    """Direction in which the hand leans, from the push in quarter turns: 0 along it, 1 to its left."""
    open: bool = False
    """Whether the fingers are open: each reaches further to its side than the closed ones."""


POSTURES = tuple(
    Posture(f"{name}, open" if opened else name, tilt, side, opened)
    for opened in (False, True)
    for name, tilt, side in (
        ("vertical", 0.0, 0),
        ("leaning ahead", STROKE_TILT, 0),
        ("leaning left", STROKE_TILT, 1),
        ("leaning right", STROKE_TILT, -1),
    )
)
"""Postures of the hand. Fingers push with their broad side, or with the narrow one when it leans sideways;
then one follows the other."""


@dataclass(frozen=True, slots=True)
class HeapStroke:
    """Straight stroke of the fingers through a heap."""

    name: str
    start: planar_geometry.PlanarPose
    """Finger tips in the world where the stroke begins, its x axis along the stroke."""
    length: float
    """Length, m."""
    tips: float
    """Height of the finger tips in the world, m."""
    posture: Posture
    drags: bool
    """Whether the fingers come down on things behind a crest and drag them, instead of pushing them."""
    worth: float
    """Moved volume, weighted by its gain for grasps, m³."""

    def tcp_at(self, way: float, tip: float, flipped: bool) -> Pose:
        """Return the TCP pose in the world after `way` m. `tip`: reach of the finger tips beyond the TCP, m.

        Flipped by half a turn the fingers look the same.
        """
        at = self.start @ planar_geometry.PlanarPose(way, 0.0)
        yaw, tilt = at.yaw + self.posture.side * math.pi / 2, self.posture.tilt
        lean, up = np.array([math.cos(yaw), math.sin(yaw), 0.0]), np.array([0.0, 0.0, 1.0])
        z = -(math.sin(tilt) * lean + math.cos(tilt) * up)
        x = (math.cos(tilt) * lean - math.sin(tilt) * up) * (-1.0 if flipped else 1.0)
        x_, y_, z_ = np.array([at.x, at.y, self.tips]) - tip * z
        return Pose.from_rotation((x_, y_, z_), np.column_stack([x, np.cross(z, x), z]))


def heap_strokes(heap: heap_geometry.HeightMap, gripper: GripperDescription) -> list[HeapStroke]:
    """Return the strokes through a heap for which hand and fingers have room, best first."""
    hand = HandShape.of(gripper)
    there = _Surfaces.of(heap, hand)
    found: list[HeapStroke] = []
    for k in range(STROKE_DIRECTIONS):
        turned = _Turned(heap, there, 2 * math.pi * k / STROKE_DIRECTIONS)
        for posture in POSTURES:
            found += turned.strokes(hand, posture)
    return sorted(found, key=lambda one: (-one.worth, one.name))


@dataclass(frozen=True, slots=True, eq=False)
class _Surfaces:
    """Surfaces of a heap (n, m), m in the map's frame."""

    solid: Heights
    """Heights of everything: cells that were never seen are as high as the rim, and walls are enlarged."""
    things: Heights
    """Heights of the seen parts of things; the floor elsewhere."""
    ease: Heights
    """Value of a place for a grasp, 0 … 1: the room of the hand there, and the distance from the walls."""

    @classmethod
    def of(cls, heap: heap_geometry.HeightMap, hand: HandShape) -> _Surfaces:
        solid, things = surfaces(heap)
        return cls(solid, np.maximum(things, np.float32(heap.floor)), _ease(heap, hand))


def _ease(heap: heap_geometry.HeightMap, hand: HandShape) -> Heights:
    """Return the value (n, m) of each place for a grasp: where the palm has room between the walls."""
    walls = heap.walls()
    if not walls.any():
        return np.ones(walls.shape, np.float32)
    away = cv2.distanceTransform((~walls).astype(np.uint8), cv2.DIST_L2, 5) * heap.cell
    n, m = walls.shape
    x: Array = np.arange(n, dtype=np.float64) * heap.cell
    y: Array = np.arange(m, dtype=np.float64) * heap.cell
    beside = np.minimum(x, x[::-1])[:, None], np.minimum(y, y[::-1])
    palm = hand.palm[0]
    thick = palm.half_x - palm.above * math.sin(REACH_TILT)
    room = np.zeros(walls.shape)
    for yaw in (math.pi * k / STROKE_DIRECTIONS for k in range(STROKE_DIRECTIONS)):
        c, s = abs(math.cos(yaw)), abs(math.sin(yaw))
        room += (beside[0] > c * palm.outer + s * thick) & (beside[1] > s * palm.outer + c * thick)
    reach = np.minimum(1.0, room / STROKE_DIRECTIONS / REACH_SHARE)
    value = REACH_VALUE * reach + (1.0 - REACH_VALUE) * np.minimum(1.0, away / WALL_REACH)
    return np.where(walls, 0.0, value).astype(np.float32)


_Cells: TypeAlias = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns (k,) of cells of an image."""


@dataclass(frozen=True, slots=True, eq=False)
class _Offer:
    """Strokes of one length from k cells."""

    cells: _Cells
    worth: NDArray[np.floating]
    """Values (k,), m³."""
    level: Heights | np.float32
    """Heights of the tips (k,), or one for all, m."""
    length: float
    """Length, m."""


class _Turned:
    """Surfaces of a heap in an image whose columns lie along a stroke."""

    def __init__(self, heap: heap_geometry.HeightMap, surfaces: _Surfaces, yaw: float) -> None:
        self._heap, self._yaw = heap, yaw
        n, m = heap.shape
        side = math.ceil(math.hypot(n, m)) + 2
        self._centre, self._middle = (np.array([n, m]) - 1) / 2, (side - 1) / 2
        c, s = math.cos(yaw), math.sin(yaw)
        self._along, self._across = np.array([c, s]), np.array([-s, c])
        # Image coordinates are (column, row), of the map (y, x).
        matrix = np.array([[s, c, 0.0], [c, -s, 0.0]])
        matrix[:, 2] = self._centre[::-1] - matrix[:, :2] @ np.full(2, self._middle)
        flags, rim = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP, float(surfaces.solid.max())

        def turned(image: Heights, outside: float) -> Heights:
            constant = cv2.BORDER_CONSTANT
            found = cv2.warpAffine(
                image, matrix, (side, side), flags=flags, borderMode=constant, borderValue=outside
            )
            return found.astype(np.float32)

        outside = rim if heap.walls().any() else heap.floor
        self._solid = turned(surfaces.solid, outside)
        walls = np.where(heap.walls(), np.float32(heap.rim), np.float32(heap.floor))
        self._walls = turned(walls, outside)
        self._things = turned(surfaces.things, heap.floor)
        self._ease = turned(surfaces.ease, 0.0 if heap.walls().any() else 1.0)
        self._volumes_by_side: dict[tuple[bool, bool, float], tuple[Heights, Heights]] = {}

    def strokes(self, hand: HandShape, posture: Posture) -> Iterator[HeapStroke]:
        """Yield the best pushes and drags of each block of cells."""
        fingers = self._lowest(self._solid, hand, posture, fingers=True)
        palm = self._lowest(self._solid, hand, posture, fingers=False)
        # Things give way to the fingers, walls do not.
        way = np.maximum(palm, self._lowest(self._walls, hand, posture, fingers=True))
        ways = {length: self._swept(way, length) for length in STROKE_LENGTHS}
        yield from self._best(self._pushes(hand, posture, fingers, ways), posture, drags=False)
        if posture.side == 0 and not posture.open:
            yield from self._best(self._drags(hand, fingers, ways), posture, drags=True)

    def _pushes(
        self, hand: HandShape, posture: Posture, fingers: Heights, ways: Mapping[float, Heights]
    ) -> Iterator[_Offer]:
        """Yield strokes from free places."""
        below = -np.inf
        for level in (self._heap.floor + above for above in STROKE_HEIGHTS):
            begins = (fingers <= level) & (fingers > below)
            below = level
            for length, lowest in ways.items():
                cells = _cells(begins & (lowest <= level))
                if not len(cells[0]):
                    continue
                moved, eased = self._volumes(hand, posture, level)
                reach = length / self._heap.cell
                worth = (_shifted_cells(moved, cells, reach) - moved[cells]) * (
                    STIR_VALUE + self._ends(cells, length)
                )
                worth -= _shifted_cells(eased, cells, reach) - eased[cells]
                yield _Offer(cells, worth, np.float32(level), length)

    def _drags(self, hand: HandShape, fingers: Heights, ways: Mapping[float, Heights]) -> Iterator[_Offer]:
        """Yield strokes that begin on top of things."""
        cell, pad = self._heap.cell, self._box(hand.fingers[0].half_x, hand.fingers[0].outer)
        top = np.asarray(cv2.dilate(self._things, pad), np.float32)
        filled = cv2.boxFilter((self._things > top - TOP_DEPTH).astype(np.float32), -1, pad.shape[::-1])
        begins = (filled > MIN_SUPPORT) & (fingers < top + MAX_DESCENT) & (top > self._heap.floor + TOP_DEPTH)
        if not begins.any():
            return
        side = 2 * round(THING_REACH / cell) + 1
        depth = np.clip(self._things - np.float32(self._heap.floor + START_CLEARANCE), 0.0, None)
        there = cv2.boxFilter(depth, -1, (side, side), normalize=False) * np.float32(cell**2)
        # By friction alone a thing does not follow: its own friction on the floor is as great.
        rise = (_ahead(top, HOOK_REACH / cell) - top) / HOOK_RISE
        hold = np.clip(rise, 0.0, 1.0)
        for length, lowest in ways.items():
            cells = _cells(begins & (lowest <= top))
            gain = STIR_VALUE + self._ends(cells, length) - self._ease[cells]
            worth = hold[cells] * there[cells] * gain
            yield _Offer(cells, worth, fingers[cells] + np.float32(START_CLEARANCE), length)

    def _ends(self, cells: _Cells, length: float) -> Heights:
        """Return the ease where the things come to lie that a stroke from each of the cells pushes."""
        return _shifted_cells(self._ease, cells, (length + PUSHED_DISTANCE) / self._heap.cell)

    def _best(self, offered: Iterator[_Offer], posture: Posture, *, drags: bool) -> Iterator[HeapStroke]:
        """Yield the best of the offered strokes of each block of cells."""
        best = np.zeros(self._things.shape, np.float32)
        chosen = np.zeros((*best.shape, 2), np.float32)
        for offer in offered:
            better = offer.worth > best[offer.cells]
            rows, columns = (one[better] for one in offer.cells)
            best[rows, columns] = offer.worth[better]
            chosen[rows, columns, 0] = np.broadcast_to(offer.level, better.shape)[better]
            chosen[rows, columns, 1] = offer.length
        for at in _best_of_blocks(best):
            level, length = (round(float(one), 4) for one in chosen[at[0], at[1]])
            yield self._stroke(at, level, length, posture, drags, float(best[at[0], at[1]]))

    def _lowest(self, solid: Heights, hand: HandShape, posture: Posture, *, fingers: bool) -> Heights:
        """Return the lowest height of the finger tips at which fingers or palm are free of a surface, m."""
        gap, tilt, side = START_CLEARANCE if fingers else PALM_CLEARANCE, posture.tilt, posture.side
        blocks = hand.fingers if fingers else hand.palm
        lowest = np.full(solid.shape, self._heap.floor if fingers else -1.0, np.float32)
        for block in blocks:
            half = block.half_x + gap
            lean = block.above * math.sin(tilt) / self._heap.cell
            underside = block.above * math.cos(tilt) - block.half_x * math.sin(tilt)
            for low, high in _spans(block, hand, posture) if fingers else ((-block.outer, block.outer),):
                out, off = (high - low) / 2 + gap, (low + high) / 2 / self._heap.cell
                swept = cv2.dilate(solid, self._box(out, half) if side else self._box(half, out))
                swept = swept.astype(np.float32)
                # The rows of the image run to the left of the push.
                if side:
                    there = _ahead(_ahead(swept.T, side * lean).T, off)
                else:
                    there = _ahead(_ahead(swept, lean).T, off).T
                lowest = np.maximum(lowest, there - underside)
        return lowest + np.float32(gap)

    def _box(self, half_along: float, half_across: float) -> NDArray[np.uint8]:
        rows, columns = (2 * math.ceil(half / self._heap.cell) + 1 for half in (half_across, half_along))
        return np.ones((rows, columns), np.uint8)

    def _swept(self, lowest: Heights, length: float) -> Heights:
        """Return the greatest of the heights on the way of each stroke, m."""
        cells = round(length / self._heap.cell)
        return cv2.dilate(lowest, np.ones((1, cells + 1), np.uint8), anchor=(0, 0)).astype(np.float32)

    def _volumes(self, hand: HandShape, posture: Posture, level: float) -> tuple[Heights, Heights]:
        """Return the volume above the finger tips from the image's left edge to each cell, m³; and the same
        weighted by `_Surfaces.ease`. Neither depends on where a hand leans, but on which side pushes."""
        key = posture.side == 0, posture.open, level
        if key not in self._volumes_by_side:
            self._volumes_by_side[key] = self._measured(hand, posture, level)
        return self._volumes_by_side[key]

    def _measured(self, hand: HandShape, posture: Posture, level: float) -> tuple[Heights, Heights]:
        cell, finger = self._heap.cell, hand.fingers[0]
        depth = np.clip(self._things - np.float32(level + START_CLEARANCE), 0.0, None)
        spans = _spans(finger, hand, posture)
        low, high = spans[0] if posture.side == 0 else (-finger.half_x, finger.half_x)
        rows = max(1, round((high - low) / cell)) | 1
        found: list[Heights] = []
        for one in (depth, depth * self._ease):
            strip = cv2.boxFilter(one, -1, (1, rows), normalize=False)
            moved = np.cumsum(strip, axis=1) * np.float32(cell**2)
            if posture.open:
                offs = [(low + high) / 2 / cell for low, high in spans]
                # Of two fingers in line the rear one finds what the other has not moved.
                moved = (
                    _ahead(moved, min(offs)) if posture.side else sum(_ahead(moved.T, off).T for off in offs)
                )
            found.append(np.asarray(moved, np.float32))
        return found[0], found[1]

    def _stroke(
        self, at: NDArray[np.intp], level: float, length: float, posture: Posture, drags: bool, worth: float
    ) -> HeapStroke:
        heap = self._heap
        row, column = at - self._middle
        x, y = (self._centre + column * self._along + row * self._across + 0.5) * heap.cell
        point = heap.frame.apply(np.array([x, y, level]))
        ahead = heap.frame.rotation()[:2, :2] @ self._along
        start = planar_geometry.PlanarPose(float(point[0]), float(point[1]), math.atan2(ahead[1], ahead[0]))
        near = BLOCK_EDGE * heap.cell * 1000
        name = (
            f"{'drag' if drags else 'push'} {posture.name} to {math.degrees(self._yaw):.0f} deg "
            f"{length * 1000:.0f} mm from about {round(x * 1000 / near) * near:.0f} "
            f"{round(y * 1000 / near) * near:.0f}"
        )
        return HeapStroke(name, start, length, float(point[2]), posture, drags, worth)


def _spans(block: Block, hand: HandShape, posture: Posture) -> tuple[tuple[float, float], ...]:
    """Return the ends of a block of both fingers along their motion, from the middle of the hand, m."""
    if not posture.open:
        return ((-block.outer, block.outer),)
    low, high = hand.max_width / 2 + block.inner, hand.max_width / 2 + block.outer
    return ((low, high), (-high, -low))


def _ahead(image: Heights, distance: float) -> Heights:
    """Return the image as seen from `distance` columns further on; beyond its end as at its last column."""
    columns = round(distance)
    if columns < 0:
        return _ahead(image[:, ::-1], -distance)[:, ::-1]
    if columns == 0:
        return image
    return np.concatenate([image[:, columns:], np.repeat(image[:, -1:], columns, axis=1)], axis=1)


def _cells(mask: NDArray[np.bool_]) -> _Cells:
    """Return the cells that are set; in one dimension numpy finds them faster."""
    rows, columns = np.divmod(np.flatnonzero(mask), mask.shape[1])
    return rows, columns


def _shifted_cells(image: Heights, cells: _Cells, distance: float) -> Heights:
    """Return the same (k,) for k cells alone."""
    rows, columns = cells
    return image[rows, np.clip(columns + round(distance), 0, image.shape[1] - 1)]


def _best_of_blocks(worth: Heights) -> NDArray[np.intp]:
    """Return the best cell (k, 2) of each block of cells in which a stroke is worth it."""
    n = -(-len(worth) // BLOCK_EDGE) * BLOCK_EDGE
    padded = np.zeros((n, n))
    padded[: len(worth), : len(worth)] = worth
    count = n // BLOCK_EDGE
    blocks = (
        padded.reshape(count, BLOCK_EDGE, count, BLOCK_EDGE)
        .transpose(0, 2, 1, 3)
        .reshape(count**2, BLOCK_EDGE**2)
    )
    which = np.flatnonzero(blocks.max(axis=1) > MIN_STROKE_VALUE)
    inner = blocks[which].argmax(axis=1)
    return np.column_stack(
        [which // count * BLOCK_EDGE + inner // BLOCK_EDGE, which % count * BLOCK_EDGE + inner % BLOCK_EDGE]
    )


MAX_TESTED_STROKES = 16
"""Greatest number of strokes that are tested for reachability."""
MAX_TRIED_STARTS = 4
"""Greatest number of strokes whose start is tried."""
DRAG_FORCE = 10.0
"""Force with which the fingers press on a thing that they drag, N."""
CHANGED_HEIGHT, CHANGED_AREA = 0.005, 2e-4
"""Change of height, m, and area of it, m², from which on a heap counts as changed."""


def stir(world: World, task: HeapPickTask, strokes: int) -> Doing[None]:
    """Push through the heap of a tote until the heap has changed. The arm ends out of the view.

    Raises push.no_stroke when no stroke is free and reachable, push.stalled when `strokes` strokes have not
    changed the heap, and the failures of cameras and motions.
    """
    outcomes: list[str] = []
    for _ in range(strokes):
        belief = yield from _look(world, task)
        before = world.vision.heaps[task.tote].map
        one, start = yield from _begin(world, task, belief.id)
        outcomes.append(f"{one.name}: {yield from _execute(world, task, one, start)}")
        yield from world.control.settle()
        yield from world.vision.observe(task.camera)
        if heap_changed(before, world.vision.heaps[task.tote].map):
            world.attempts.clear(task.node, belief.id)
            text = f"{task.tote} is stirred: {'; '.join(outcomes)}"
            world.journal.note(
                event_types.PushEvent(text, task.node, object=task.tote, strokes=tuple(outcomes))
            )
            return
    message = f"the heap in {task.tote} is as it was: {'; '.join(outcomes)}"
    raise Failure(push.STALLED, message, object=task.tote, strokes=outcomes)


def heap_changed(before: heap_geometry.HeightMap, after: heap_geometry.HeightMap) -> bool:
    """Return whether things lie elsewhere in a later map of the same place."""
    if before.shape != after.shape:
        return True
    change = np.abs(after.heights() - before.heights()) > CHANGED_HEIGHT
    inner = (change & ~before.beside_walls()).astype(np.uint8)
    # Edges of things flicker from look to look, by one or two cells.
    whole = cv2.morphologyEx(inner, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return bool(np.count_nonzero(whole) * before.cell**2 > CHANGED_AREA)


def _look(world: World, task: HeapPickTask) -> Doing[BeliefObject]:
    """Look into the tote, and return its heap. Raises push.no_stroke when it is empty."""
    try:
        return (yield from look_into_tote(world, task))
    except Failure as failure:
        if failure.cause is not grasp.NO_CANDIDATE:
            raise
        raise Failure(push.NO_STROKE, failure.message, object=task.tote, empty=True) from None


def _begin(world: World, task: HeapPickTask, heap: ObjectId) -> Doing[tuple[HeapStroke, Pose]]:
    """Move to the start of the best stroke that the arm gets to; return it with the TCP pose there.

    Raises push.no_stroke, and the failures of motions.
    """
    refused: Failure | None = None
    for _ in range(MAX_TRIED_STARTS):
        one, over, flipped = yield from _choose(world, task)
        world.attempts.failed(task.node, heap, one.name)
        opening = _opening(world, one)
        start = one.tcp_at(0.0, world.robot.fingers.reach(opening), flipped)
        try:
            yield from move_to_start(world, over, start, opening, task.node, (heap,))
        except Failure as failure:
            if not matches("planning.*", failure.cause) or failure.cause is planning.START_IN_COLLISION:
                raise
            refused = failure
        else:
            return one, start
    assert refused is not None
    raise refused


def _choose(world: World, task: HeapPickTask) -> Doing[tuple[HeapStroke, Array, bool]]:
    """Return the best stroke that the arm can follow, with the configuration (n,) above its start, and
    whether the hand is flipped. Strokes that were made in vain come last, and owed thinking passes between
    the tests. Raises push.no_stroke."""
    offered = heap_strokes(world.vision.heaps[task.tote].map, world.robot.description.gripper)
    fresh = world.attempts.remaining(task.node, heap_geometry.heap_id(task.tote), offered)
    why: list[str] = []
    rim, heap = rim_height(world, task.tote) + RIM_CLEARANCE, (heap_geometry.heap_id(task.tote),)
    for one in fresh[:MAX_TESTED_STROKES]:
        opening, rise = _opening(world, one), max(world.handling.approach, rim - one.tips)
        tip = world.robot.fingers.reach(opening)
        refusals: list[str] = []
        for flipped in (False, True):
            poses = [one.tcp_at(way, tip, flipped) for way in samples(0.0, one.length)]
            over = configuration_above_start(world, poses, opening, heap, rise=rise, beside=heap)
            if not isinstance(over, str):
                return one, over, flipped
            refusals.append(over)
        why.append(f"{one.name}: {refusals[0]}")
        yield from world.plan.charge()
    reasons = "; ".join(why[:4]) or "the hand has no room beside anything"
    raise Failure(
        push.NO_STROKE,
        f"none of {len(offered)} strokes in {task.tote} is free and reachable: {reasons}",
        object=task.tote,
        refused=why,
    )


def _opening(world: World, one: HeapStroke) -> float:
    """Return the opening of the fingers during a stroke, m."""
    return world.robot.description.gripper.max_width if one.posture.open else 0.0


def _execute(world: World, task: HeapPickTask, one: HeapStroke, start: Pose) -> Doing[str]:
    """Make the stroke from its start, and move out of the view. Return the contact in words."""
    x, y, _ = start.position
    path = straight(planar_geometry.PlanarPose(x, y, one.start.yaw), one.length)
    mass, names = world.robot.hand_mass, (heap_geometry.heap_id(task.tote),)
    if one.drags:
        course = DragMotion(path, task.speed, task.force, DRAG_FORCE, mass)
        force = yield from follow_course(world, course, names, task.node, DRAG_STIFFNESS)
    else:
        course = PushMotion(
            path, planar_geometry.PlanarPose(0.0, 0.0), 0.0, task.speed, task.force, mass, through=True
        )
        force = yield from follow_course(world, course, names, task.node)
    rise = max(STEP_BACK_HEIGHT, rim_height(world, task.tote) + RIM_CLEARANCE - one.tips)
    yield from step_back(world, names, task.node, rise)
    way = f"{course.reached * 1000:.0f} mm"
    if course.blocked:
        return f"blocked at {force:.1f} N after {way}"
    return f"moved on {way}" if course.touched_at is not None else f"nothing was felt on {way}"
