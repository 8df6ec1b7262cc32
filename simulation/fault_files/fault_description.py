"""What a faults file says, as values: what is to go wrong, when, and what would be right to say of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from .device_entries import Ailing
from .item_entries import Appear, Bump, Friction, Heavier, ItemFault, Larger, Obstacle, Remove, Slip, Target
from .occasions import AtNode, AtTime, When
from .program_entries import ProgramFault

__all__ = [
    "Appear", "AtNode", "AtTime", "Bump", "Expect", "FaultFile", "FaultSpec", "Friction", "Heavier", "Larger",
    "Obstacle", "Remove", "Slip", "Target", "When",
]  # fmt: skip

FaultSpec: TypeAlias = ItemFault | Slip | Appear | Obstacle | Ailing | ProgramFault
"""One injected fault. Its `name` is the word of fault files and records; a renamed class keeps it."""


@dataclass(frozen=True, slots=True)
class Expect:
    """What whoever judges a run with these faults takes as right. Neither robot nor simulation reads it."""

    causes: tuple[str, ...] = ()
    """Causes, or patterns of causes, that name what went wrong; none: it should do no harm."""
    lost: int = 0
    """Items that can physically not be sorted any more."""


@dataclass(frozen=True, slots=True)
class FaultFile:
    """A fault file, read: its faults in the order of the file."""

    faults: tuple[FaultSpec, ...]
    source: str = ""
    text: str = ""
    """The file as it was read, for the log."""
    expect: Expect | None = None
