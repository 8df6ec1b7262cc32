"""What a backend lets those do who bring items and take full bins away."""

from __future__ import annotations

from collections.abc import Collection
from typing import Protocol

from ...world.journal import JournalEvent
from ...world.values import ObjectId
from ..scoring.truth import TrueBody
from ..spawning.spawn import SpawnedItem
from .light_curtain import Zone

LOOK = 12
"""Control periods from one look of theirs at the cell to the next."""


class FeedCell(Protocol):
    """A simulated cell as people and feeders meet it."""

    @property
    def now(self) -> float:
        """Simulated seconds."""
        ...

    @property
    def period(self) -> float:
        """Length of a control period, s."""
        ...

    def here(self) -> tuple[TrueBody, ...]:
        """Every item that is there, as it really is."""
        ...

    def next_id(self) -> ObjectId:
        """Of the item that is put in next."""
        ...

    def put(self, item: SpawnedItem) -> None:
        """An item comes into the world at its pose, and is left to itself."""
        ...

    def at_rest(self, items: Collection[ObjectId]) -> bool:
        """Whether these have come to rest, as far as they are still there."""
        ...

    def take_with(self, bin_id: ObjectId, items: Collection[ObjectId]) -> None:
        """These leave the world with the bin; their truth stays as it was."""
        ...

    def arm_over(self, zone: Zone) -> bool:
        """Whether any part of the arm is over the zone."""
        ...


class ItemSource(Protocol):
    """One entry of a scene's feed at work."""

    @property
    def exhausted(self) -> bool:
        """Nothing more comes from it, and what came last has come to rest."""
        ...

    @property
    def busy(self) -> bool:
        """It brings something, or would if the arm were out of the way."""
        ...

    @property
    def obstructed(self) -> bool:
        """It waits for the arm to leave."""
        ...

    @property
    def deliveries(self) -> int:
        """How often something came and has come to rest."""
        ...

    def ready(self) -> None:
        """The robot is done with what lies there."""
        ...

    def stepped(self, step: int) -> None:
        """A control period has passed, the step-th of the run."""
        ...

    def take_events(self) -> tuple[JournalEvent, ...]:
        """What has happened since it was asked last."""
        ...
