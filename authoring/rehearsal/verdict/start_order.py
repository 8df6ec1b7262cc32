"""The order in which leaves start, held against the one that a case expects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ....files.node_patterns import node_matches
from ....files.yaml.document import Location
from ....world.causes import cause_named, matches
from ..cases.case import ANY_LEAVES, OUTCOMES, Turn
from ..stage.events import LeafRun


@dataclass(frozen=True, slots=True)
class Misplaced:
    """The first entry of `order` that does not hold."""

    loc: Location
    message: str
    tick: int | None


def compare_order(order: Sequence[Turn], runs: Sequence[LeafRun], loc: Location) -> Misplaced | None:
    """None when the leaves start as expected. `...` stands for any number of them; each stretch between two
    is looked for from left to right, which finds an arrangement whenever there is one."""
    stretches = _stretches(order)
    wrong = _first_wrong(stretches[0], runs, 0, loc, to_end=len(stretches) == 1)
    if wrong is not None or len(stretches) == 1:
        return wrong
    position = len(stretches[0])
    for stretch in stretches[1:-1]:
        found = _find(stretch, runs, position)
        if found is None:
            return _nearest_miss(stretch, runs, position)
        position = found + len(stretch)
    return _at_end(stretches[-1], runs, position, loc)


def _stretches(order: Sequence[Turn]) -> list[tuple[Turn, ...]]:
    """Entries before the first `...`, between two, after the last; the outer ones may be empty."""
    parts: list[list[Turn]] = [[]]
    for turn in order:
        if turn.pattern == ANY_LEAVES:
            parts.append([])
        else:
            parts[-1].append(turn)
    inner = [part for part in parts[1:-1] if part]
    outer = [parts[0], *inner, parts[-1]] if len(parts) > 1 else parts
    return [tuple(part) for part in outer]


def _first_wrong(
    turns: Sequence[Turn], runs: Sequence[LeafRun], start: int, loc: Location, *, to_end: bool
) -> Misplaced | None:
    for number, turn in enumerate(turns):
        run = runs[start + number] if start + number < len(runs) else None
        if run is None or not _fits(turn, run):
            return _wrong(turn, run)
    rest = runs[start + len(turns) :]
    if to_end and rest:
        return Misplaced(loc, f"the order ends, but {rest[0].path} starts", rest[0].tick)
    return None


def _find(turns: Sequence[Turn], runs: Sequence[LeafRun], start: int) -> int | None:
    for begin in range(start, len(runs) - len(turns) + 1):
        if all(_fits(turn, runs[begin + n]) for n, turn in enumerate(turns)):
            return begin
    return None


def _at_end(turns: Sequence[Turn], runs: Sequence[LeafRun], position: int, loc: Location) -> Misplaced | None:
    if not turns:
        return None
    begin = len(runs) - len(turns)
    if begin >= position:
        return _first_wrong(turns, runs, begin, loc, to_end=True)
    return _nearest_miss(turns, runs, position)


def _nearest_miss(turns: Sequence[Turn], runs: Sequence[LeafRun], position: int) -> Misplaced:
    """The entry that fails where most entries before it fit."""

    def fitting(begin: int) -> int:
        count = 0
        while count < len(turns) and begin + count < len(runs) and _fits(turns[count], runs[begin + count]):
            count += 1
        return count

    begin = max(range(position, len(runs) + 1), key=lambda b: (fitting(b), -b), default=position)
    count = min(fitting(begin), len(turns) - 1)
    if count == 0:
        before = runs[position - 1] if position else None
        after = f" after {before.path}" if before else ""
        message = f"{_wanted(turns[0])} is expected{after}, but does not come"
        return Misplaced(turns[0].loc, message, before.tick if before else None)
    run = runs[begin + count] if begin + count < len(runs) else None
    return _wrong(turns[count], run)


def _wrong(turn: Turn, run: LeafRun | None) -> Misplaced:
    if run is None:
        return Misplaced(turn.loc, f"{_wanted(turn)} is expected, but no further leaf starts", None)
    if node_matches(turn.pattern, run.path):
        ended = run.cause or run.outcome
        return Misplaced(turn.loc, f"{turn.outcome} is expected of {run.path}, which is {ended}", run.tick)
    return Misplaced(turn.loc, f"{_wanted(turn)} is expected, but {run.path} starts", run.tick)


def _fits(turn: Turn, run: LeafRun) -> bool:
    if not node_matches(turn.pattern, run.path):
        return False
    if not turn.outcome or turn.outcome in OUTCOMES:
        return not turn.outcome or turn.outcome == run.outcome
    return bool(run.cause) and matches(turn.outcome, cause_named(run.cause))


def _wanted(turn: Turn) -> str:
    return f"{turn.pattern} with {turn.outcome}" if turn.outcome else turn.pattern
