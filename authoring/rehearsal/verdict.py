"""Comparison of a case's result with its expectation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import cast

from picktree.files import Location, Mark, node_matches, where
from picktree.files.yaml import Document
from picktree.trees import BehaviourTree, Namespace, NodeStatus, references, runner, show
from picktree.world import matches

from .cases import (
    ANY_LEAVES,
    OUTCOMES,
    Destination,
    Expectation,
    ExpectedHandling,
    ExpectedStart,
    RehearsalCase,
)
from .rehearsal_world import RehearsalWorld
from .trace import LeafRun


@dataclass(frozen=True, slots=True)
class OrderMismatch:
    """First entry of `order` that does not match."""

    loc: Location
    message: str
    tick: int | None


def compare_order(
    order: Sequence[ExpectedStart], runs: Sequence[LeafRun], loc: Location
) -> OrderMismatch | None:
    """Return the first mismatch of the leaves' order, which is at `loc`; None when all entries match.

    `...` stands for any number of leaves. Each stretch between two of them is searched from left to right,
    which finds a match whenever one exists.
    """
    return _Order(order, runs, loc).mismatch()


class _Order:
    """Comparison of runs with the entries of an order; a stretch is a range of entries, by number."""

    def __init__(self, order: Sequence[ExpectedStart], runs: Sequence[LeafRun], loc: Location) -> None:
        self._order, self._runs, self._loc = order, runs, loc

    def mismatch(self) -> OrderMismatch | None:
        gaps = [number for number, turn in enumerate(self._order) if turn.pattern == ANY_LEAVES]
        first, *others = (range(a + 1, b) for a, b in pairwise((-1, *gaps, len(self._order))))
        wrong = self._first_wrong(first, 0, to_end=not others)
        if wrong is not None or not others:
            return wrong
        *inner, last = others
        position = len(first)
        for stretch in inner:
            begins = range(position, len(self._runs) - len(stretch) + 1)
            found = next((begin for begin in begins if self._fitting(stretch, begin) == len(stretch)), None)
            if found is None:
                return self._nearest_miss(stretch, position)
            position = found + len(stretch)
        begin = len(self._runs) - len(last)
        if not last or begin >= position:
            return self._first_wrong(last, begin, to_end=True)
        return self._nearest_miss(last, position)

    def _fitting(self, stretch: range, begin: int) -> int:
        """Return the number of entries that match the runs from `begin`, up to the first that does not."""
        count = 0
        for number, run in zip(stretch, self._runs[begin : begin + len(stretch)], strict=False):
            if not _fits(self._order[number], run):
                break
            count += 1
        return count

    def _first_wrong(self, stretch: range, begin: int, *, to_end: bool) -> OrderMismatch | None:
        count = self._fitting(stretch, begin)
        if count < len(stretch):
            return self._wrong(stretch[count], begin + count)
        rest = self._runs[begin + count :]
        if to_end and rest:
            return OrderMismatch(self._loc, f"the order ends, but {rest[0].path} starts", rest[0].tick)
        return None

    def _nearest_miss(self, stretch: range, position: int) -> OrderMismatch:
        """Return the entry that fails where most entries before it match."""
        begins = range(position, len(self._runs) + 1)
        begin = max(begins, key=lambda begin: (self._fitting(stretch, begin), -begin))
        count = min(self._fitting(stretch, begin), len(stretch) - 1)
        if count:
            return self._wrong(stretch[count], begin + count)
        before = self._runs[position - 1] if position else None
        after = f" after {before.path}" if before else ""
        message = f"{_wanted(self._order[stretch[0]])} is expected{after}, but does not come"
        return OrderMismatch((*self._loc, stretch[0]), message, before.tick if before else None)

    def _wrong(self, number: int, index: int) -> OrderMismatch:
        """Return the mismatch of an entry and the run of that index; there may be none."""
        turn, loc = self._order[number], (*self._loc, number)
        if index >= len(self._runs):
            return OrderMismatch(loc, f"{_wanted(turn)} is expected, but no further leaf starts", None)
        run = self._runs[index]
        message = f"{_wanted(turn)} is expected, but {run.path} starts"
        if node_matches(turn.pattern, run.path):
            message = f"{turn.outcome} is expected of {run.path}, which is {run.cause or run.outcome}"
        return OrderMismatch(loc, message, run.tick)


def _fits(turn: ExpectedStart, run: LeafRun) -> bool:
    if not node_matches(turn.pattern, run.path):
        return False
    if not turn.outcome or turn.outcome in OUTCOMES:
        return not turn.outcome or turn.outcome == run.outcome
    return bool(run.cause) and matches(turn.outcome, run.cause)


def _wanted(turn: ExpectedStart) -> str:
    return f"{turn.pattern} with {turn.outcome}" if turn.outcome else turn.pattern


@dataclass(frozen=True, slots=True)
class ExpectationMiss:
    """One difference from the expectation: its place in the file, and the tick in which it shows."""

    mark: Mark
    where: str
    """Place of the value in its case: `expect.order[3]`."""
    message: str
    tick: int | None = None

    def __str__(self) -> str:
        when = f" (tick {self.tick})" if self.tick is not None else ""
        return f"{self.mark}: {self.where}: {self.message}{when}"


def differences(
    document: Document, case: RehearsalCase, tree: BehaviourTree, world: RehearsalWorld
) -> tuple[ExpectationMiss, ...]:
    """Return all differences from the case's expectation; impossible answers come first."""
    return tuple(_Comparison(document, case, tree, world).all())


class _Comparison:
    def __init__(
        self, document: Document, case: RehearsalCase, tree: BehaviourTree, world: RehearsalWorld
    ) -> None:
        self._document, self._case, self._tree, self._world = document, case, tree, world
        self._trace, self._loc = world.trace, (*case.loc, "expect")

    def all(self) -> Iterator[ExpectationMiss]:
        expect, loc, ticks = self._case.entry.expect, self._loc, self._trace.tick
        for found in self._world.contradictions:
            yield self._at(self._case.loc, f"this cannot be: {found.path}: {found}", ticks)
        for sentence in dict.fromkeys(self._trace.faults):
            yield self._at(self._case.loc, f"a fault of the program: {sentence}", ticks)
        yield from self._end(expect)
        if expect.order is not None:
            found = compare_order(expect.order, self._trace.runs, (*loc, "order"))
            if found is not None:
                yield self._at(found.loc, found.message + self._unknown_traits(), found.tick)
        for number, wanted in enumerate(expect.handled):
            yield from self._handled(wanted, (*loc, "handled", number))
        for number, pattern in enumerate(expect.never):
            first = next((p for p in self._trace.started if node_matches(pattern, p)), None)
            if first is not None:
                yield self._at((*loc, "never", number), f"{first} has started", self._trace.started[first])
        yield from self._facts(expect.facts, (*loc, "facts"))
        yield from self._objects(expect, (*loc, "objects"))
        for key, value in expect.blackboard.items():
            yield from self._blackboard(key, value, (*loc, "blackboard", key))

    def _unknown_traits(self) -> str:
        """Return which item is still to be done because the case does not give what rules ask for."""
        for item, traits in self._world.belief.misplaced_for_want_of():
            cure = f"then: {{objects: {{{item.id}: {{{traits[0]}: …}}}}}}"
            return (
                f"; {item.id} lies in {item.place} and is still to be done: the scene's rules ask for its "
                f"{traits[0]}, which the case does not give ('{cure}' in an answer)"
            )
        return ""

    def _at(self, loc: Location, message: str, tick: int | None = None) -> ExpectationMiss:
        return ExpectationMiss(self._document.mark(loc), where(loc[2:]) or self._case.name, message, tick)

    def _end(self, expect: Expectation) -> Iterator[ExpectationMiss]:
        status, failure, ticks = self._tree.status, self._tree.failure, self._trace.tick
        if expect.status is not None and status.value != expect.status:
            why = f": {failure.cause} at {failure.node}: {failure.message}" if failure else ""
            message = f"{expect.status} is expected, but the mission is {status.value}{why}"
            yield self._at((*self._loc, "status"), message, ticks)
        if expect.cause is not None and (failure is None or not matches(expect.cause, failure.cause)):
            got = f"it fails with {failure.cause}" if failure else f"it is {status.value}"
            got += " without a cause" if status is NodeStatus.FAILURE and failure is None else ""
            yield self._at((*self._loc, "cause"), f"{expect.cause} is expected, but {got}", ticks)
        if expect.ticks is not None and expect.status is None and status is NodeStatus.RUNNING:
            yield self._at((*self._loc, "ticks"), "the mission still runs", ticks)

    def _handled(self, wanted: ExpectedHandling, loc: Location) -> Iterator[ExpectationMiss]:
        of_cause = [h for h in self._trace.handled if matches(wanted.cause, h.cause)]
        found = [
            h
            for h in of_cause
            if (not wanted.by or node_matches(wanted.by, h.by))
            and (not wanted.handler or h.handler == wanted.handler)
        ]
        by = f" by {wanted.by}" if wanted.by else ""
        by += f" with {wanted.handler!r}" if wanted.handler else ""
        if wanted.times is not None and len(found) != wanted.times:
            message = f"{wanted.cause} is taken up{by} {_times(len(found))}, not {_times(wanted.times)}"
            yield self._at(loc, message, found[-1].tick if found else None)
        elif not found:
            other = of_cause[0] if of_cause else None
            got = "nobody takes it up"
            if other is not None:
                got = f"{other.by} takes it up" + (f" with {other.handler!r}" if other.handler else "")
            message = f"{wanted.cause} is not taken up{by}: {got}"
            yield self._at(loc, message, other.tick if other else None)

    def _facts(self, wanted: Mapping[str, object], loc: Location) -> Iterator[ExpectationMiss]:
        facts = self._world.facts()
        for name, value in wanted.items():
            if not _same(facts.get(name), value):
                yield self._at((*loc, name), f"it is {show(facts.get(name))}, not {show(value)}")

    def _objects(self, expect: Expectation, loc: Location) -> Iterator[ExpectationMiss]:
        scene = self._world.scene
        for name, entry in expect.objects.items():
            known = scene.find(name)
            if entry is None or known is None:
                if (entry is None) != (known is None):
                    says = "is still in the belief" if known else "is not in the belief"
                    yield self._at((*loc, name), f"{name!r} {says}")
                continue
            given = cast("Mapping[str, object]", self._document.get((*loc, name)))
            for field in sorted(given):
                value, wanted = references.attribute(scene, name, field), getattr(entry, field)
                wanted = wanted.name if isinstance(wanted, Destination) else wanted
                if not _same(value, wanted):
                    yield self._at((*loc, name, field), f"it is {show(value)}, not {show(wanted)}")

    def _blackboard(self, key: str, wanted: object, loc: Location) -> Iterator[ExpectationMiss]:
        owner, _, name = key.rpartition("/")
        spaces = namespaces(self._tree, owner)
        written = [space for space in spaces if space.has(name)]
        if not written:
            yield self._at(loc, f"nothing has written {name!r}")
        for space in written:
            value = space.read(references.Reference(name), self._world.scene)
            if not _same(value, wanted):
                yield self._at(loc, f"it is {show(value)}, not {show(wanted)}")
                return


def namespaces(tree: BehaviourTree, owner: str) -> list[Namespace]:
    """Return the namespaces of sub-trees that match the pattern; that of `Main` when it is empty."""
    root = cast("runner.SubTree", tree.root)
    subtrees = [node for node in tree.nodes if isinstance(node, runner.SubTree)]
    return [node.inside for node in subtrees if node_matches(owner, node.path)] if owner else [root.inside]


def _times(number: int) -> str:
    return "once" if number == 1 else f"{number} times"


def _same(value: object, wanted: object) -> bool:
    """Whether the values are equal in YAML's sense: true is not 1, but 1 is 1.0."""
    if isinstance(value, list) and isinstance(wanted, Sequence) and not isinstance(wanted, str):
        values, all_wanted = cast("list[object]", value), cast("Sequence[object]", wanted)
        return len(values) == len(all_wanted) and all(map(_same, values, all_wanted))
    return isinstance(value, bool) == isinstance(wanted, bool) and value == wanted
