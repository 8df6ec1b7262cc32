"""Tote feed: pours the next load into a tote that the cell has exchanged."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ...files.errors import PicktreeError
from ...world.journal import JournalEvent
from ...world.random_streams import RandomStreams
from ...world.run_events import DeliveryEvent
from ...world.scene.description import SceneDescription
from ...world.values import ObjectId
from .cell_interface import CELL_CHECK_INTERVAL, FeedCell
from .spawn import SpawnedItem, draw_heap

MAX_SETTLING_TIME = 5.0
"""Longest wait for poured items to come to rest, s."""


@dataclass(frozen=True, slots=True)
class ToteFeedState:
    """Progress of a feed entry with a tote."""

    drawn: int = 0
    """Number of items drawn so far."""
    loads: int = 0
    """Number of loads poured."""
    settling: tuple[ObjectId, ...] = ()
    """Items that were poured and may still move."""
    until: float = 0.0
    """Simulated time until which the feed waits for them to come to rest, s."""
    deliveries: int = 0


class ToteFeed:
    """`ItemSource` of a feed entry with a tote. Raises PicktreeError when an item is wider than the tote."""

    obstructed = False
    """The exchange of the tote waits for the arm, not the feed."""

    def __init__(self, scene: SceneDescription, number: int, cell: FeedCell, seed: int) -> None:
        self._scene = scene
        self._number = number
        self._delivery = scene.deliveries[number]
        into = self._delivery.load.into
        if into is None:
            raise PicktreeError(f"feed[{number}] has no tote")
        self.tote = into
        self._cell = cell
        self._streams = RandomStreams(seed)
        self._events: list[JournalEvent] = []
        self._state = ToteFeedState()
        self._drawn()

    @property
    def exhausted(self) -> bool:
        return self._state.drawn == self._delivery.total and not self._state.settling

    @property
    def busy(self) -> bool:
        """Whether poured items may still move."""
        return bool(self._state.settling)

    @property
    def deliveries(self) -> int:
        return self._state.deliveries

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
            until=self._cell.now + MAX_SETTLING_TIME,
        )
        message = f"{self.tote} comes with {len(load)} item{'s' if len(load) > 1 else ''}"
        self._events.append(
            DeliveryEvent(message, feed=self._number, number=state.loads + 1, items=len(load), waiting=0)
        )
        return True

    def stepped(self, step: int) -> None:
        state = self._state
        if not state.settling or step % CELL_CHECK_INTERVAL:
            return
        if self._cell.at_rest(state.settling) or self._cell.now >= state.until:
            self._state = replace(state, settling=(), deliveries=state.deliveries + 1)

    def take_events(self) -> tuple[JournalEvent, ...]:
        events, self._events = tuple(self._events), []
        return events

    def state(self) -> ToteFeedState:
        """Return the progress for a checkpoint."""
        return self._state

    def restore(self, state: ToteFeedState) -> None:
        self._state = state

    def _drawn(self) -> list[SpawnedItem]:
        """Draw the next load above its tote, from scene and seed alone."""
        where = f"{self._scene.source or self._scene.name}: feed[{self._number}]"
        rng = self._streams.at(f"feed/{self._number}", self._state.loads)
        return draw_heap(self._scene, self._delivery.load, rng, where)
