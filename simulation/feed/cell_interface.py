"""Protocols between a backend and its feed: the simulated cell, and the sources of items."""

from __future__ import annotations

from collections.abc import Collection
from typing import Protocol

from ...world.journal import JournalEvent
from ...world.values import ObjectId
from ..scoring.truth import TrueBody
from ..spawning.spawn import SpawnedItem
from .light_curtain import Zone

CELL_CHECK_INTERVAL = 12
"""Number of control periods between two checks of the cell by the feed."""


class FeedCell(Protocol):
    """Simulated cell as seen by item sources and bin exchange."""

    @property
    def now(self) -> float:
        """Simulated time, s."""
        ...

    @property
    def period(self) -> float:
        """Length of a control period, s."""
        ...

    def here(self) -> tuple[TrueBody, ...]:
        """Return every present item with its true pose."""
        ...

    def next_id(self) -> ObjectId:
        """Return the name of the next item that is added."""
        ...

    def put(self, item: SpawnedItem) -> None:
        """Add an item at its pose and leave it to the simulation."""
        ...

    def at_rest(self, items: Collection[ObjectId]) -> bool:
        """Return whether those of the items that are still present are at rest."""
        ...

    def take_with(self, bin_id: ObjectId, items: Collection[ObjectId]) -> None:
        """Remove items with their bin; their last truth is kept."""
        ...

    def arm_over(self, zone: Zone) -> bool:
        """Return whether any part of the arm is over the zone."""
        ...


class ItemSource(Protocol):
    """Source of items: one entry of a scene's feed."""

    @property
    def exhausted(self) -> bool:
        """Whether nothing more comes from the source and its last items are at rest."""
        ...

    @property
    def busy(self) -> bool:
        """Whether the source brings something, or would if the arm were out of the way."""
        ...

    @property
    def obstructed(self) -> bool:
        """Whether the source waits for the arm to leave."""
        ...

    @property
    def deliveries(self) -> int:
        """Number of completed deliveries: items came and are at rest."""
        ...

    def ready(self) -> None:
        """Note that the robot is ready for the next delivery."""
        ...

    def stepped(self, step: int) -> None:
        """Advance by one control period, the step-th of the run."""
        ...

    def take_events(self) -> tuple[JournalEvent, ...]:
        """Return the events since the last call."""
        ...
