"""What became of the grasps of a choice: each one's furthest failure, counted by what it was."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from .candidate_stages import HAND, PLACE, ROOM, STAGES

ACCEPTED = "accepted"


class Tried(Protocol):
    """`world.journal.CandidateTried`, or what a log holds of it."""

    @property
    def name(self) -> str: ...
    @property
    def verdict(self) -> str: ...
    @property
    def stage(self) -> str: ...
    @property
    def by(self) -> str: ...
    @property
    def gap(self) -> float: ...
    @property
    def count(self) -> int: ...


@dataclass(frozen=True, slots=True)
class Fate:
    """So many grasps dropped out at a stage for one reason."""

    count: int
    words: str
    stage: str
    by: str
    name: str
    """Of the first of these grasps."""


def fates(tried: Iterable[Tried], into: str) -> tuple[Fate, ...]:
    """The most frequent first. A grasp that was accepted has none; one whose places failed for several
    reasons has the one that it came furthest with, or that was more frequent."""
    taken = {one.name for one in tried if one.verdict == ACCEPTED}
    last: dict[str, Tried] = {}
    for one in tried:
        if one.name in taken or one.stage not in STAGES:
            continue
        before = last.get(one.name)
        if before is None or _weight(one) > _weight(before):
            last[one.name] = one
    alike: dict[tuple[str, str], list[Tried]] = {}
    for one in last.values():
        alike.setdefault((one.stage, one.by or one.verdict), []).append(one)
    found = [
        Fate(len(group), _words(group, into), group[0].stage, group[0].by, group[0].name)
        for group in alike.values()
    ]
    return tuple(sorted(found, key=lambda fate: -fate.count))


def told(found: Sequence[Fate], most: int = 4) -> str:
    """`11 the hand would touch red_block_2 (1.2 mm from it at best), 8 the pre-grasp is out of reach`."""
    parts = [f"{fate.count} {fate.words}" for fate in found[:most]]
    rest = sum(fate.count for fate in found[most:])
    return ", ".join([*parts, f"{rest} for other reasons"] if rest else parts)


def _weight(one: Tried) -> tuple[int, int]:
    return (STAGES.index(one.stage), one.count)


def _words(group: Sequence[Tried], into: str) -> str:
    best = max(group, key=lambda one: one.gap)
    if best.stage == HAND and best.by:
        near = (
            f"{best.gap * 1000:.1f} mm from it" if best.gap >= 0 else f"{-best.gap * 1000:.1f} mm deep in it"
        )
        return f"{best.verdict} ({near} at best)"
    if best.stage in (ROOM, PLACE) and into and best.by != into:
        return f"from there {into} cannot be reached ({best.verdict})"
    return best.verdict
