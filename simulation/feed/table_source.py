"""Table feed: sets loads down on the table when the robot reports that it is clear, or by a schedule."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ...files.errors import PicktreeError
from ...world.journal import JournalEvent
from ...world.random_streams import RandomStreams
from ...world.run_events import DeliveryEvent
from ...world.scene.description import AtIntervals, AtTimes, Delivery, SceneDescription, WhenClear
from ...world.scene.feed_loading import reach
from ...world.values import Array, ObjectId, Quaternion
from ..footprints import footprint, support_height
from .cell_interface import CELL_CHECK_INTERVAL, FeedCell, Zone
from .spawn import (
    LooseItem,
    SpawnedItem,
    draw_load,
    lay_out_some,
    occupied_outlines,
    set_down,
)

MIN_ARM_DISTANCE = 0.05
"""Least distance between new items and the arm, m."""
DROP_HEIGHT = 5e-4
"""Height above the support from which new items drop, m."""
MAX_SETTLING_TIME = 3.0
"""Longest wait for new items to come to rest, s."""
RETRY_INTERVAL = 1.0
"""Time between two searches for free room on the table, s."""


@dataclass(frozen=True, slots=True)
class WaitingItem:
    """Item of a load for which there was no room."""

    kind: str
    colour: str
    turn: Quaternion


@dataclass(frozen=True, slots=True)
class TableFeedState:
    """Progress of a feed entry with an area."""

    drawn: int = 0
    """Number of items drawn so far, the waiting ones included."""
    waiting: tuple[WaitingItem, ...] = ()
    """Items that come with the next load."""
    loads: int = 0
    """Number of loads set down."""
    tries: int = 0
    """Number of searches for room."""
    pending: bool = False
    """Whether a load is due."""
    due: float = 0.0
    """Simulated time of the next load by the schedule, or of the next search for room, s."""
    no_room: bool = False
    """Whether there was no room for any item of the load."""
    obstructed: bool = False
    settling: tuple[ObjectId, ...] = ()
    """Items that were set down and may still move."""
    until: float = 0.0
    """Simulated time until which the feed waits for them to come to rest, s."""
    deliveries: int = 0


class TableFeed:
    """`ItemSource` of a feed entry with an area. Raises PicktreeError when not even one of its items fits
    there."""

    def __init__(self, scene: SceneDescription, number: int, cell: FeedCell, seed: int) -> None:
        self._scene = scene
        self._number = number
        self._where = f"{scene.source or scene.name}: feed[{number}]"
        self._delivery: Delivery = scene.deliveries[number]
        self._load = self._delivery.load
        self._size = sum(count for _, count in self._load.counts)
        when = self._delivery.when
        self._total = self._delivery.total
        if self._total is None and isinstance(when, AtTimes):
            self._total = self._size * len(when.times)
        self._cell = cell
        self._streams = RandomStreams(seed)
        self._standing = occupied_outlines(scene)
        widest = max(reach(scene.entry(kind).shape, 1.0) for kind, _ in self._load.counts)
        (x0, y0), (x1, y1) = self._load.area
        middle, half = ((x0 + x1) / 2, (y0 + y1) / 2), ((x1 - x0) / 2, (y1 - y0) / 2)
        self._zone = Zone(middle, 0.0, half).grown(widest + MIN_ARM_DISTANCE)
        levels = (support_height(scene.fixtures, x, y) for x in (x0, x1) for y in (y0, y1))
        self._level = min((level for level in levels if level is not None), default=-math.inf)
        """Height of the table, m; lower bodies take no room."""
        self._events: list[JournalEvent] = []
        self._state = TableFeedState(due=when.period if isinstance(when, AtIntervals) else 0.0)
        first, _ = self._hand()
        if not self._places(first, empty=True):
            raise PicktreeError(
                f"{self._where}: no item fits into the area of {x1 - x0:.2f} × {y1 - y0:.2f} m beside what "
                "stands there; make it larger, or put it elsewhere"
            )

    @property
    def exhausted(self) -> bool:
        return self._all_brought and not self._state.settling

    @property
    def busy(self) -> bool:
        state = self._state
        return bool(state.settling) or (state.pending and not state.no_room)

    @property
    def obstructed(self) -> bool:
        return self._state.obstructed

    @property
    def deliveries(self) -> int:
        return self._state.deliveries

    def ready(self) -> None:
        """Request the next load, unless one is coming to rest or all have come."""
        if isinstance(self._delivery.when, WhenClear) and not self._state.settling and not self._all_brought:
            self._state = replace(self._state, pending=True)

    def stepped(self, step: int) -> None:
        if step % CELL_CHECK_INTERVAL:
            return
        if self._state.settling:
            self._wait_for_rest()
            return
        now, state = self._cell.now, self._state
        if not state.pending:
            if not self._is_due(now):
                return
            state = replace(state, pending=True)
        if state.no_room and now < state.due - 1e-9:
            return
        self._state = replace(state, obstructed=self._cell.arm_over(self._zone))
        if not self._state.obstructed:
            self._bring(now)

    def take_events(self) -> tuple[JournalEvent, ...]:
        events, self._events = tuple(self._events), []
        return events

    def state(self) -> TableFeedState:
        """Return the progress for a checkpoint."""
        return self._state

    def restore(self, state: TableFeedState) -> None:
        self._state = state

    @property
    def _all_brought(self) -> bool:
        return self._state.drawn == self._total and not self._state.waiting

    def _is_due(self, now: float) -> bool:
        """Return whether a load is due by the schedule. Items without room in the last load come as soon as
        there is room."""
        if self._all_brought:
            return False
        match self._delivery.when:
            case WhenClear():
                return False
            case AtIntervals():
                return now >= self._state.due - 1e-9
            case AtTimes(times):
                return self._state.loads >= len(times) or now >= times[self._state.loads] - 1e-9

    def _bring(self, now: float) -> None:
        hand, drawn = self._hand()
        places = self._places(hand)
        state = replace(self._state, tries=self._state.tries + 1)
        if not places:
            self._state = replace(state, no_room=True, due=now + RETRY_INTERVAL)
            return
        put = [self._put(hand[k], place) for k, place in sorted(places.items())]
        waiting = tuple(
            WaitingItem(item.kind, item.colour, item.turn) for k, item in enumerate(hand) if k not in places
        )
        self._state = replace(
            state,
            drawn=drawn,
            waiting=waiting,
            loads=state.loads + 1,
            pending=False,
            no_room=False,
            due=self._next_due(now),
            settling=tuple(put),
            until=now + MAX_SETTLING_TIME,
        )
        self._tell(len(put), len(waiting))

    def _hand(self) -> tuple[list[LooseItem], int]:
        """Return the next items, the waiting ones first, and the number drawn after them."""
        state, total = self._state, self._total
        hand = [LooseItem(item.kind, item.colour, item.turn) for item in state.waiting]
        drawn = state.drawn
        load: list[LooseItem] = []
        while len(hand) < self._size and (total is None or drawn < total):
            k = drawn % self._size
            if k == 0 or not load:
                load = self._drawn(drawn // self._size)
            hand.append(load[k])
            drawn += 1
        return hand, drawn

    def _drawn(self, load: int) -> list[LooseItem]:
        """Draw the load with a number, in random order, from scene and seed alone."""
        rng = self._streams.at(f"feed/{self._number}", load)
        items = draw_load(self._scene, self._load, rng)
        return [items[k] for k in rng.permutation(len(items))]

    def _places(self, hand: list[LooseItem], *, empty: bool = False) -> dict[int, Array]:
        """Return free places by the items' position in the hand; `empty`: as if no item were on the table."""
        outlines = [footprint(self._scene.entry(item.kind).shape, item.turn) for item in hand]
        taken = list(self._standing)
        if not empty:
            taken += [
                footprint(b.shape, b.pose.orientation).at(b.pose.position[:2])
                for b in self._cell.here()
                if b.pose.position[2] > self._level
            ]
        rng = self._streams.at(f"feed/{self._number}/place", self._state.tries)
        return dict(lay_out_some(self._load, outlines, taken, rng))

    def _put(self, item: LooseItem, place: Array) -> ObjectId:
        made = set_down(self._scene, self._load, item, place, self._cell.next_id(), self._where)
        pose = made.pose.shifted((0.0, 0.0, DROP_HEIGHT))
        self._cell.put(
            SpawnedItem(made.id, made.entry, made.colour, pose, made.dropped, brought_by=self._number)
        )
        return made.id

    def _next_due(self, now: float) -> float:
        match self._delivery.when:
            case AtIntervals(period):
                return (int((now + 1e-9) // period) + 1) * period
            case _:
                return now

    def _wait_for_rest(self) -> None:
        state = self._state
        if self._cell.at_rest(state.settling) or self._cell.now >= state.until:
            self._state = replace(state, settling=(), deliveries=state.deliveries + 1)

    def _tell(self, items: int, waiting: int) -> None:
        number = self._state.loads
        message = f"{_counted(items)} set down" + (f", {waiting} more found no room" if waiting else "")
        self._events.append(
            DeliveryEvent(message, feed=self._number, number=number, items=items, waiting=waiting)
        )


def _counted(items: int) -> str:
    return "1 item is" if items == 1 else f"{items} items are"
