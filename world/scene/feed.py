"""Feed of a scene as values: deliveries during a run, belts, and the exchange of bins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from ..values import ObjectId

if TYPE_CHECKING:
    from .description import Spawn


@dataclass(frozen=True, slots=True)
class Belt:
    """A fixture that carries what lies on it along its own +x while it runs."""

    id: ObjectId
    """Its box is the fixture of this name."""
    speed: float
    """m/s"""
    eye: float
    """Where a light barrier crosses it: from its middle along +x, m."""


@dataclass(frozen=True, slots=True)
class WhenClear:
    """A load comes when the robot says that it is done with what lies there."""


@dataclass(frozen=True, slots=True)
class AtIntervals:
    """A load comes whenever so much time has passed since the beginning, s."""

    period: float


@dataclass(frozen=True, slots=True)
class AtTimes:
    """A load comes at each of these simulated times, s, ascending."""

    times: tuple[float, ...]


When: TypeAlias = WhenClear | AtIntervals | AtTimes


@dataclass(frozen=True, slots=True)
class Delivery:
    """Entry of the feed. `load` is the load of one delivery, as an entry of `spawn`. For a belt it is the
    mixture of single items, over the whole of the belt's top."""

    load: Spawn
    when: When = WhenClear()
    """Time of the loads; for a belt always `WhenClear`: it runs when the robot is ready."""
    total: int | None = None
    """Items in all; None: for ever."""
    belt: ObjectId | None = None
    """The belt at whose upstream end the items are set down; None: on the table."""
    spacing: float = 0.15
    """Mean distance on the belt from one item to the next, m."""


@dataclass(frozen=True, slots=True)
class Exchange:
    """Somebody puts an empty bin in a full one's place when the robot asks."""

    seconds: float
    """How long that takes."""
