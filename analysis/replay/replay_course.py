"""The course of a run in one pass over its ticks: what began and ended, and what was written, by tick."""

from __future__ import annotations

from dataclasses import dataclass

from ...logs.schema.records import Transition, Tree, Write
from ...logs.visits import Following, Visit
from ...logs.visits_format_1 import with_transitions
from ..run import Run


@dataclass(frozen=True, slots=True)
class Move:
    """A node begins or ends in a tick."""

    tick: int
    time: float
    """Simulated s."""
    transition: Transition


@dataclass(frozen=True, slots=True)
class Written:
    """A write to the blackboard in a tick."""

    tick: int
    time: float
    """Simulated s."""
    write: Write


@dataclass(frozen=True, slots=True)
class Course:
    """All in the order in which it happened."""

    moves: tuple[Move, ...]
    writes: tuple[Written, ...]
    visits: tuple[Visit, ...]
    derived: bool
    """Whether the moves were derived from the statuses after each tick: the log is of format 1."""


def course_of(run: Run) -> Course:
    derived = run.log.format < 2
    trees = list(run.trees)
    following = Following(trees[0].record if trees else Tree(()))
    coming = trees[1:]
    moves: list[Move] = []
    writes: list[Written] = []
    for number, at in enumerate(with_transitions(run.log.ticks()) if derived else run.log.busy_ticks()):
        while coming and coming[0].time <= at.time:
            following.follow(coming.pop(0).record)
        if at.record is None:
            following.skip(at.time)
            continue
        following.take(at.time, at.record)
        moves += [Move(number, at.time, transition) for transition in at.record.transitions]
        writes += [Written(number, at.time, write) for write in at.record.writes]
    return Course(tuple(moves), tuple(writes), following.finish(), derived)
