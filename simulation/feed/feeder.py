"""Feeder of a simulated cell: item sources and exchange of bins behind `protocols.Feed`, on both backends."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from ...files.errors import PicktreeError
from ...world.journal import JournalEvent
from ...world.protocols import FeedSignals
from ...world.run_events import BinExchangedEvent
from ...world.scene.description import Bin, SceneDescription
from ...world.values import ObjectId
from ..truth import TrueBody
from .belt_drive import BeltDrive
from .belt_source import BeltFeed, BeltFeedState
from .cell_interface import CELL_CHECK_INTERVAL, FeedCell, ItemSource, Zone
from .table_source import TableFeed, TableFeedState
from .tote_source import ToteFeed, ToteFeedState

MIN_ARM_DISTANCE = 0.05
"""Least distance between the bin and the arm during the exchange, m."""


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
        self._asked: list[ObjectId] = []
        self._worked = 0.0
        self._done: Counter[ObjectId] = Counter()
        self.obstructed = False
        self._events: list[JournalEvent] = []

    @property
    def busy(self) -> bool:
        return bool(self._asked)

    @property
    def done(self) -> Mapping[ObjectId, int]:
        """Number of exchanges of each bin; a copy. A full tote counts when its items have come to rest."""
        moving = {name for name, tote in self._totes.items() if tote.busy}
        return {name: number - (name in moving) for name, number in self._done.items()}

    def ask(self, bin_id: ObjectId) -> None:
        """Request the exchange of a bin. Raises PicktreeError when the scene has no such bin."""
        if bin_id not in self._bins:
            raise PicktreeError(f"there is no bin {bin_id!r}; known: {', '.join(self._bins)}")
        if self._exchange is not None and bin_id not in self._asked:
            self._asked.append(bin_id)

    def stepped(self, step: int) -> None:
        """Advance by one control period, the step-th of the run."""
        if not self._asked or step % CELL_CHECK_INTERVAL:
            return
        each = self._bins[self._asked[0]]
        self.obstructed = self._cell.arm_over(_zone(each))
        if self.obstructed:
            return
        self._worked += CELL_CHECK_INTERVAL * self._cell.period
        assert self._exchange is not None
        if self._worked >= self._exchange.seconds - 1e-9:
            self._carry_out(each)

    def take_events(self) -> tuple[JournalEvent, ...]:
        """Return the events since the last call."""
        events, self._events = tuple(self._events), []
        return events

    def state(self) -> ExchangeState:
        """Return the state for a checkpoint."""
        return ExchangeState(tuple(self._asked), self._worked, self.obstructed, dict(self._done))

    def restore(self, state: ExchangeState) -> None:
        self._asked, self._worked = list(state.asked), state.worked
        self.obstructed, self._done = state.obstructed, Counter(state.done)

    def _carry_out(self, each: Bin) -> None:
        inside = [body.id for body in self._cell.here() if goes_with(each, body)]
        self._cell.take_with(each.id, inside)
        self._asked.pop(0)
        self._worked = 0.0
        self._done[each.id] += 1
        number = self._done[each.id]
        tote = self._totes.get(each.id)
        other = "a full" if tote is not None and tote.fill() else "an empty"
        message = f"{each.id} is exchanged for {other} one, with {_counted(len(inside))} in it"
        self._events.append(BinExchangedEvent(message, bin=each.id, items=len(inside), number=number))


def goes_with(each: Bin, body: TrueBody) -> bool:
    """Return whether a bin takes the item along when it is carried off.

    That is so when the item's centre is over the bin and above its underside: inside, on the heap or across a
    wall. An item that leans on the bin from outside stays.
    """
    x, y, z = (each.pose.inverse() @ body.pose).position
    return abs(x) < each.size[0] / 2 and abs(y) < each.size[1] / 2 and z > 0.0


def _zone(each: Bin) -> Zone:
    x, y, _ = each.pose.position
    across = each.pose.rotation()[:, 0]
    yaw = math.atan2(float(across[1]), float(across[0]))
    return Zone((x, y), yaw, (each.size[0] / 2, each.size[1] / 2)).grown(MIN_ARM_DISTANCE)


def _counted(items: int) -> str:
    return "1 item" if items == 1 else f"{items} items"


@dataclass(frozen=True, slots=True)
class FeederState:
    """State of the feeder for a checkpoint; each part in the order of the scene file."""

    tables: tuple[TableFeedState, ...] = ()
    belts: tuple[BeltFeedState, ...] = ()
    exchange: ExchangeState = field(default_factory=ExchangeState)
    totes: tuple[ToteFeedState, ...] = ()


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
        self._bringers: tuple[ItemSource, ...] = (*self._tables, *self._belts, *self._totes)
        self._exchange = BinExchange(scene, cell, self._totes)

    def ready(self) -> None:
        for each in self._bringers:
            each.ready()

    def exchange(self, bin_id: ObjectId) -> None:
        self._exchange.ask(bin_id)

    def read(self) -> FeedSignals:
        bringers, exchange = self._bringers, self._exchange
        return FeedSignals(
            exhausted=all(each.exhausted for each in bringers),
            busy=exchange.busy or any(each.busy for each in bringers),
            obstructed=exchange.obstructed or any(each.obstructed for each in bringers),
            deliveries=sum(each.deliveries for each in bringers),
            exchanges=exchange.done,
        )

    def stepped(self, step: int) -> None:
        """Advance by one control period, the step-th of the run."""
        for each in self._bringers:
            each.stepped(step)
        self._exchange.stepped(step)

    def take_events(self) -> tuple[JournalEvent, ...]:
        """Return the events since the last call, for the journal. They name numbers, bins and belts, never
        places of items."""
        events = [event for each in self._bringers for event in each.take_events()]
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
        for each, table in zip(self._tables, state.tables, strict=True):
            each.restore(table)
        for each, belt in zip(self._belts, state.belts, strict=True):
            each.restore(belt)
        for each, tote in zip(self._totes, state.totes, strict=True):
            each.restore(tote)
        self._exchange.restore(state.exchange)


def has_feeder(scene: SceneDescription) -> bool:
    """Return whether the scene has deliveries, belts or an exchange of bins."""
    return bool(scene.deliveries or scene.belts or scene.exchange)
