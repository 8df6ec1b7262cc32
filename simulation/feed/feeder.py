"""Feeder of a simulated cell: item sources and bin exchange behind `protocols.Feed`, for both backends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ...errors import PicktreeError
from ...world.journal import JournalEvent
from ...world.protocols import FeedSignals
from ...world.scene.description import SceneDescription
from ...world.values import ObjectId
from .belt_drive import BeltDrive
from .belt_source import BeltFeed, BeltFeedState
from .bin_exchange import BinExchange, ExchangeState
from .cell_interface import FeedCell, ItemSource
from .table_source import TableFeed, TableFeedState


@dataclass(frozen=True, slots=True)
class FeederState:
    """State of the feeder for a checkpoint; each part in the order of the scene file."""

    tables: tuple[TableFeedState, ...] = ()
    belts: tuple[BeltFeedState, ...] = ()
    exchange: ExchangeState = field(default_factory=ExchangeState)


class Feeder:
    """Feeder: runs the entries of the scene's feed and the exchange of bins."""

    def __init__(
        self, scene: SceneDescription, cell: FeedCell, seed: int, belts: Mapping[ObjectId, BeltDrive]
    ) -> None:
        """Build the sources. Raises PicktreeError when no item of an entry fits into its area."""
        self._tables = tuple(
            TableFeed(scene, n, cell, seed)
            for n, delivery in enumerate(scene.deliveries)
            if delivery.belt is None
        )
        self._belts = tuple(
            BeltFeed(scene, n, cell, belts[delivery.belt], seed)
            for n, delivery in enumerate(scene.deliveries)
            if delivery.belt is not None
        )
        self._bringers: tuple[ItemSource, ...] = (*self._tables, *self._belts)
        self._exchange = BinExchange(scene, cell)

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
        )

    def restore(self, state: FeederState) -> None:
        """Take over a state. Raises PicktreeError when it is of another feed."""
        for what, saved, own in (
            ("an area", state.tables, self._tables),
            ("a belt", state.belts, self._belts),
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
        self._exchange.restore(state.exchange)


def has_feeder(scene: SceneDescription) -> bool:
    """Return whether the scene has deliveries, belts or an exchange of bins."""
    return bool(scene.deliveries or scene.belts or scene.exchange)
