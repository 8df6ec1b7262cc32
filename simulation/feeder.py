"""Feeder of a simulated cell behind `protocols.Feed`, on both backends: feeds of tables and totes, and
exchange of bins.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from picktree.files import PicktreeError
from picktree.world import Array, FeedSignals, JournalEvent, ObjectId, Quaternion, event_types
from picktree.world.scene import AtIntervals, AtTimes, Bin, SceneDescription, WhenClear, reach

from .belt_feed import BeltDrive, BeltFeed, BeltFeedState
from .feed_cell import (
    CELL_CHECK_INTERVAL,
    DROP_HEIGHT,
    MAX_SETTLING_TIME,
    MIN_ARM_DISTANCE,
    FeedCell,
    ItemSource,
    Zone,
)
from .footprints import footprint, support_height
from .spawn import LooseItem, SpawnedItem, draw_heap, draw_load, lay_out_some, occupied_outlines, set_down
from .truth import TrueBody

RETRY_INTERVAL = 1.0
"""Time between two searches for free room on the table, s."""
MAX_POURED_SETTLING_TIME = 5.0
"""Longest wait for poured items to come to rest, s."""


@dataclass(frozen=True, slots=True)
class WaitingItem:
    """Item of a load for which there was no room."""

    kind: str
    colour: str
    turn: Quaternion


@dataclass(frozen=True, slots=True, kw_only=True)
class FeedState:
    """Progress of a feed entry that brings loads: one with a tote, or with an area."""

    drawn: int = 0
    """Number of items drawn so far, the waiting ones included."""
    loads: int = 0
    """Number of loads set down or poured."""
    settling: tuple[ObjectId, ...] = ()
    """Items of the last load that may still move."""
    until: float = 0.0
    """Simulated time until which the feed waits for them to come to rest, s."""
    deliveries: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class TableFeedState(FeedState):
    """Progress of a feed entry with an area."""

    waiting: tuple[WaitingItem, ...] = ()
    """Items that come with the next load."""
    tries: int = 0
    """Number of searches for room."""
    pending: bool = False
    """Whether a load is due."""
    due: float = 0.0
    """Simulated time of the next load by the schedule, or of the next search for room, s."""
    no_room: bool = False
    """Whether there was no room for any item of the load."""
    obstructed: bool = False


class TableFeed(ItemSource[TableFeedState]):
    """Feed entry with an area. Raises PicktreeError when not even one of its items fits
    there."""

    def __init__(self, scene: SceneDescription, number: int, cell: FeedCell, seed: int) -> None:
        when = scene.deliveries[number].when
        begin = TableFeedState(due=when.period if isinstance(when, AtIntervals) else 0.0)
        super().__init__(scene, number, cell, seed, begin)
        self._where = f"{scene.source or scene.name}: feed[{number}]"
        self._load = self._delivery.load
        self._size = self._load.number
        self._total = self._delivery.total
        if self._total is None and isinstance(when, AtTimes):
            self._total = self._size * len(when.times)
        self._standing = occupied_outlines(scene)
        widest = max(reach(scene.entry(kind).shape, 1.0) for kind in self._load.counts)
        (x0, y0), (x1, y1) = self._load.rectangle
        middle, half = ((x0 + x1) / 2, (y0 + y1) / 2), ((x1 - x0) / 2, (y1 - y0) / 2)
        self._zone = Zone(middle, 0.0, half).grown(widest + MIN_ARM_DISTANCE)
        levels = (support_height(scene.fixtures, x, y) for x in (x0, x1) for y in (y0, y1))
        self._level = min((level for level in levels if level is not None), default=-math.inf)
        """Height of the table, m; lower bodies take no room."""
        first, _ = self._hand()
        if not self._places(first, empty=True):
            raise PicktreeError(
                f"{self._where}: no item fits into the area of {x1 - x0:.2f} × {y1 - y0:.2f} m beside the "
                "bodies there; make it larger, or put it elsewhere"
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
        self._record_load(len(put), len(waiting))

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

    def _record_load(self, items: int, waiting: int) -> None:
        number = self._state.loads
        message = f"{_counted(items)} {'is' if items == 1 else 'are'} set down"
        message += f", {waiting} more found no room" if waiting else ""
        self._events.append(
            event_types.DeliveryEvent(message, feed=self._number, number=number, items=items, waiting=waiting)
        )


class ToteFeed(ItemSource[FeedState]):
    """Feed entry with a tote. Raises PicktreeError when an item is wider than the tote.

    The exchange of the tote waits for the arm, not the feed.
    """

    def __init__(self, scene: SceneDescription, number: int, cell: FeedCell, seed: int) -> None:
        super().__init__(scene, number, cell, seed, FeedState())
        into = self._delivery.load.into
        if into is None:
            raise PicktreeError(f"feed[{number}] has no tote")
        self.tote = into
        self._drawn()

    @property
    def exhausted(self) -> bool:
        return self._state.drawn == self._delivery.total and not self._state.settling

    @property
    def busy(self) -> bool:
        """Whether poured items may still move."""
        return bool(self._state.settling)

    def ready(self) -> None:
        """Do nothing: a load comes with the exchange of its tote."""

    def fill(self) -> bool:
        """Pour the next load into the tote, and return whether anything was left to pour."""
        state, total = self._state, self._delivery.total
        load = self._drawn()[: None if total is None else total - state.drawn]
        if not load:
            return False
        names: list[ObjectId] = []
        for item in load:
            names.append(self._cell.next_id())
            self._cell.put(replace(item, id=names[-1], brought_by=self._number))
        self._state = replace(
            state,
            drawn=state.drawn + len(load),
            loads=state.loads + 1,
            settling=tuple(names),
            until=self._cell.now + MAX_POURED_SETTLING_TIME,
        )
        message = f"{self.tote} comes with {_counted(len(load))}"
        self._events.append(
            event_types.DeliveryEvent(
                message, feed=self._number, number=state.loads + 1, items=len(load), waiting=0
            )
        )
        return True

    def stepped(self, step: int) -> None:
        state = self._state
        if not state.settling or step % CELL_CHECK_INTERVAL:
            return
        if self._cell.at_rest(state.settling) or self._cell.now >= state.until:
            self._state = replace(state, settling=(), deliveries=state.deliveries + 1)

    def _drawn(self) -> list[SpawnedItem]:
        """Draw the next load above its tote, from scene and seed alone."""
        where = f"{self._scene.source or self._scene.name}: feed[{self._number}]"
        rng = self._streams.at(f"feed/{self._number}", self._state.loads)
        return draw_heap(self._scene, self._delivery.load, rng, where)


@dataclass(frozen=True, slots=True)
class ExchangeState:
    """Requested and completed exchanges of bins."""

    asked: tuple[ObjectId, ...] = ()
    """Requested bins, in order; the first one is being exchanged."""
    worked: float = 0.0
    """Time worked on the present exchange with the arm out of the way, s."""
    obstructed: bool = False
    done: Mapping[ObjectId, int] = field(default_factory=dict[ObjectId, int])
    """Number of exchanges of each bin."""


class BinExchange:
    """Exchange of bins by one person, one bin after the other. A tote with a feed comes back full. Without
    `exchange` in the scene requests are ignored."""

    def __init__(self, scene: SceneDescription, cell: FeedCell, totes: Iterable[ToteFeed] = ()) -> None:
        self._cell = cell
        self._totes = {each.tote: each for each in totes}
        self._bins: Mapping[str, Bin] = {each.id: each for each in scene.bins}
        self._exchange = scene.exchange
        self._requests: list[ObjectId] = []
        self._worked = 0.0
        self._done: Counter[ObjectId] = Counter()
        self.obstructed = False
        self._events: list[JournalEvent] = []

    @property
    def busy(self) -> bool:
        return bool(self._requests)

    @property
    def done(self) -> Mapping[ObjectId, int]:
        """Number of exchanges of each bin; a copy. A full tote counts when its items have come to rest."""
        moving = {name for name, tote in self._totes.items() if tote.busy}
        return {name: number - (name in moving) for name, number in self._done.items()}

    def request(self, bin_id: ObjectId) -> None:
        """Request the exchange of a bin. Raises PicktreeError when the scene has no such bin."""
        if bin_id not in self._bins:
            raise PicktreeError(f"there is no bin {bin_id!r}; known: {', '.join(self._bins)}")
        if self._exchange is not None and bin_id not in self._requests:
            self._requests.append(bin_id)

    def stepped(self, step: int) -> None:
        """Advance by one control period, the step-th of the run."""
        if not self._requests or step % CELL_CHECK_INTERVAL:
            return
        each = self._bins[self._requests[0]]
        self.obstructed = self._cell.arm_over(Zone.around(each.pose, each.size))
        if self.obstructed:
            return
        self._worked += CELL_CHECK_INTERVAL * self._cell.period
        assert self._exchange is not None
        if self._worked >= self._exchange.takes - 1e-9:
            self._carry_out(each)

    def take_events(self) -> tuple[JournalEvent, ...]:
        """Return the events since the last call."""
        events, self._events = tuple(self._events), []
        return events

    def state(self) -> ExchangeState:
        """Return the state for a checkpoint."""
        return ExchangeState(tuple(self._requests), self._worked, self.obstructed, dict(self._done))

    def restore(self, state: ExchangeState) -> None:
        self._requests, self._worked = list(state.asked), state.worked
        self.obstructed, self._done = state.obstructed, Counter(state.done)

    def _carry_out(self, each: Bin) -> None:
        inside = [body.id for body in self._cell.here() if goes_with(each, body)]
        self._cell.take_with(each.id, inside)
        self._requests.pop(0)
        self._worked = 0.0
        self._done[each.id] += 1
        number = self._done[each.id]
        assert self._exchange is not None
        tote = self._totes.get(each.id)
        other = "a full" if tote is not None and tote.fill() else "an empty"
        message = f"{each.id} is exchanged for {other} one, with {_counted(len(inside))} in it"
        self._events.append(
            event_types.BinExchangedEvent(
                message,
                bin=each.id,
                items=len(inside),
                number=number,
                by="person" if self._exchange.by == "person" else None,
            )
        )


def goes_with(each: Bin, body: TrueBody) -> bool:
    """Return whether a bin takes the item along when it is carried off.

    That is so when the item's centre is over the bin and above its underside: inside, on the heap or across a
    wall. An item that leans on the bin from outside stays.
    """
    x, y, z = (each.pose.inverse() @ body.pose).position
    return abs(x) < each.size[0] / 2 and abs(y) < each.size[1] / 2 and z > 0.0


def _counted(items: int) -> str:
    return "1 item" if items == 1 else f"{items} items"


@dataclass(frozen=True, slots=True)
class FeederState:
    """State of the feeder for a checkpoint; each part in the order of the scene file."""

    tables: tuple[TableFeedState, ...] = ()
    belts: tuple[BeltFeedState, ...] = ()
    exchange: ExchangeState = field(default_factory=ExchangeState)
    totes: tuple[FeedState, ...] = ()


class Feeder:
    """Feeder: runs the entries of the scene's feed and the exchange of bins."""

    def __init__(
        self, scene: SceneDescription, cell: FeedCell, seed: int, belts: Mapping[ObjectId, BeltDrive]
    ) -> None:
        """Build the sources. Raises PicktreeError when no item of an entry fits into its area."""
        self._tables = tuple(
            TableFeed(scene, n, cell, seed)
            for n, delivery in enumerate(scene.deliveries)
            if delivery.belt is None and delivery.load.into is None
        )
        self._belts = tuple(
            BeltFeed(scene, n, cell, belts[delivery.belt], seed)
            for n, delivery in enumerate(scene.deliveries)
            if delivery.belt is not None
        )
        self._totes = tuple(
            ToteFeed(scene, n, cell, seed)
            for n, delivery in enumerate(scene.deliveries)
            if delivery.load.into is not None
        )
        self._sources: tuple[ItemSource[Any], ...] = (*self._tables, *self._belts, *self._totes)
        self._exchange = BinExchange(scene, cell, self._totes)

    def ready(self) -> None:
        for each in self._sources:
            each.ready()

    def exchange(self, bin_id: ObjectId) -> None:
        self._exchange.request(bin_id)

    def read(self) -> FeedSignals:
        sources, exchange = self._sources, self._exchange
        return FeedSignals(
            exhausted=all(each.exhausted for each in sources),
            busy=exchange.busy or any(each.busy for each in sources),
            obstructed=exchange.obstructed or any(each.obstructed for each in sources),
            deliveries=sum(each.deliveries for each in sources),
            exchanges=exchange.done,
        )

    def stepped(self, step: int) -> None:
        """Advance by one control period, the step-th of the run."""
        for each in self._sources:
            each.stepped(step)
        self._exchange.stepped(step)

    def take_events(self) -> tuple[JournalEvent, ...]:
        """Return the events since the last call, for the journal. They name numbers, bins and belts, never
        places of items."""
        events = [event for each in self._sources for event in each.take_events()]
        return (*events, *self._exchange.take_events())

    def state(self) -> FeederState:
        """Return the state for a checkpoint. It does not include pending events."""
        return FeederState(
            tuple(each.state() for each in self._tables),
            tuple(each.state() for each in self._belts),
            self._exchange.state(),
            tuple(each.state() for each in self._totes),
        )

    def restore(self, state: FeederState) -> None:
        """Take over a state. Raises PicktreeError when it is of another feed."""
        for what, saved, own in (
            ("an area", state.tables, self._tables),
            ("a belt", state.belts, self._belts),
            ("a tote", state.totes, self._totes),
        ):
            if len(saved) != len(own):
                raise PicktreeError(
                    f"the checkpoint's feed has {len(saved)} with {what} among its entries, "
                    f"but the scene's has {len(own)}"
                )
        for each, progress in zip(self._sources, (*state.tables, *state.belts, *state.totes), strict=True):
            each.restore(progress)
        self._exchange.restore(state.exchange)


def has_feeder(scene: SceneDescription) -> bool:
    """Return whether the scene has deliveries, belts or an exchange of bins."""
    return bool(scene.deliveries or scene.belts or scene.exchange)
