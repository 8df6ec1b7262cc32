"""Journal: entries that all rooms note for the log; `logs/` alone defines their storage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from .protocols import RgbdImage
from .values import ObjectId, Pose

Plain: TypeAlias = "str | int | float | bool | None | list[Plain] | dict[str, Plain]"


@dataclass(frozen=True, slots=True)
class PlanEntry:
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
    """Duration of the timed trajectory, s; 0 when there is none."""
    path: tuple[tuple[float, ...], ...] = ()
    tool_path: tuple[tuple[float, float, float], ...] = ()
    """Positions of the TCP along the path in the world, m."""
    start: tuple[float, ...] = ()
    """Where it was to begin, rad; also of a failure."""
    version: int = 0
    """Belief version in which the motion was planned."""
    length: float = 0.0
    """Way in joint space, rad."""
    way: float = 0.0
    """Way of the TCP, along `tool_path`, m."""
    singular: float = 0.0
    """Smallest singular value of the TCP's Jacobian along `tool_path`; 0 without a path."""


@dataclass(frozen=True, slots=True)
class CandidateEntry:
    """Candidates of a grasp, or of a grasp with a place, that dropped out alike; or the one that did not."""

    name: str
    """Name of the grasp."""
    pose: Pose
    """Pose of the TCP in the world at closing."""
    score: float
    """Rank of the candidate, lowest first: seconds with bonuses and penalties."""
    verdict: str
    """Why it dropped out, in words; `accepted` when it did not."""
    place: str = ""
    """Where it would have been put, of the first of them; empty when it did not come that far."""
    stage: str = ""
    """The stage that it did not pass; of the accepted one the last that it passed."""
    by: str = ""
    """Obstacle: an id of the scene or a part of the robot; empty when there was none."""
    gap: float = 0.0
    """Distance to it, negative when it is a depth, m; of several the greatest; 0 when it is not known."""
    count: int = 1
    """How many of the grasp's places dropped out alike."""


@dataclass(frozen=True, slots=True)
class CandidateSearchEntry:
    """The trail of a choice: how many grasps reached each stage, and what became of each one."""

    purpose: str
    object: ObjectId
    stages: Mapping[str, int]
    tried: tuple[CandidateEntry, ...]
    into: str = ""
    """The bin that the object was to go to."""


@dataclass(frozen=True, slots=True)
class ImageEntry:
    """A camera shot, with what perception made of it in one line each."""

    image: RgbdImage
    findings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class JournalEvent:
    """An event: `item_done`, `pick`, `fault`, `recovery`, `checkpoint`, `safety_stop`, `grasp`, …"""

    kind: str
    message: str
    node: str = ""
    data: Mapping[str, Plain] = field(default_factory=dict[str, "Plain"])


Entry: TypeAlias = PlanEntry | CandidateSearchEntry | ImageEntry | JournalEvent


class Journal:
    """Entries in the order in which they came; the session takes them away after each tick."""

    def __init__(self) -> None:
        self._entries: list[Entry] = []
        self.items_done = 0
        """How often an item was placed, as the robot believes; part of the state."""

    def note(self, entry: Entry) -> None:
        self._entries.append(entry)
        if isinstance(entry, JournalEvent) and entry.kind == "item_done":
            self.items_done += 1

    def take(self) -> tuple[Entry, ...]:
        entries = tuple(self._entries)
        self._entries.clear()
        return entries
