"""What the floors have to tell the record. They note values here; `logs/` alone knows how they are stored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from .protocols import RgbdImage
from .values import ObjectId, Pose

Plain: TypeAlias = "str | int | float | bool | None | list[Plain] | dict[str, Plain]"


@dataclass(frozen=True, slots=True)
class PlanMade:
    """One request to the planner and its answer. `path` holds joint configurations, rad."""

    request: str
    planner: str
    checks: int
    thinking: float
    """Simulated seconds charged."""
    outcome: str
    """"found" or the name of a failure cause."""
    message: str
    duration: float
    """Of the timed trajectory, s; 0 when none."""
    path: tuple[tuple[float, ...], ...] = ()
    tool_path: tuple[tuple[float, float, float], ...] = ()
    """Positions of the TCP along the path in the world, m."""


@dataclass(frozen=True, slots=True)
class CandidateTried:
    """One candidate of a grasp or a placement, and where it dropped out (`accepted` when it did not)."""

    name: str
    pose: Pose
    score: float
    verdict: str


@dataclass(frozen=True, slots=True)
class CandidatesRanked:
    """The trail of a choice: how many candidates reached each stage, and each one's verdict."""

    purpose: str
    object: ObjectId
    stages: Mapping[str, int]
    tried: tuple[CandidateTried, ...]


@dataclass(frozen=True, slots=True)
class ImageTaken:
    """A camera shot, with what perception made of it in one line each."""

    image: RgbdImage
    findings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Happened:
    """An event: `item_done`, `pick`, `fault`, `recovery`, `checkpoint`, `safety_stop`, `grasp`, …"""

    kind: str
    message: str
    node: str = ""
    data: Mapping[str, Plain] = field(default_factory=dict[str, "Plain"])


Entry: TypeAlias = PlanMade | CandidatesRanked | ImageTaken | Happened


class Journal:
    """Entries in the order in which they came; the session takes them away after each tick."""

    def __init__(self) -> None:
        self._entries: list[Entry] = []
        self.items_done = 0
        """How often an item was placed, as the robot believes; part of the state."""

    def note(self, entry: Entry) -> None:
        self._entries.append(entry)
        if isinstance(entry, Happened) and entry.kind == "item_done":
            self.items_done += 1

    def take(self) -> tuple[Entry, ...]:
        entries = tuple(self._entries)
        self._entries.clear()
        return entries
