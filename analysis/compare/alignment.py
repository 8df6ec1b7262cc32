"""Alignment of two runs: pairs of visits, and the divergence, where the visits first differ.

The key of a visit is (item, node path, attempt). Items are paired by `match_items`, nodes by `match_nodes`.
On both sides attempts are counted from `since` on, so that a resumed run aligns with the run that it
continues. Times are simulated seconds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias

from picktree.analysis import Run
from picktree.logs import account_of, node_visits

from .matching import (
    TIME_TOLERANCE,
    Aspect,
    ItemMatch,
    NodeMatch,
    VisitPair,
    differences,
    match_items,
    match_nodes,
)

Side: TypeAlias = Literal["a", "b"]
SIDES: Final[tuple[Side, Side]] = ("a", "b")
How: TypeAlias = Aspect | Literal["order", "end"]
AT_START: Final[tuple[Aspect, ...]] = ("type", "inputs")
"""Aspects that differ already at the start of a visit."""


@dataclass(frozen=True, slots=True)
class Divergence:
    """First moment (simulated s) at which two runs differ, and the visits of both there.

    `how` is the aspect in which the same visit differs. `order`: another visit begins, or the same at another
    time. `end`: the log of one ends, while the other continues.
    """

    time: float
    how: How
    also: tuple[Aspect, ...]
    """Further aspects in which the same visit differs, in order of time."""
    a: node_visits.Visit | None
    """Visit of A at the divergence; with `order` the one that begins next.

    None when no further visit begins, or the log ends.
    """
    b: node_visits.Visit | None
    next_a: node_visits.Visit | None
    """First leaf that begins afterwards in A; None when there is none."""
    next_b: node_visits.Visit | None


@dataclass(frozen=True, slots=True)
class ComparedRuns:
    """Visits of two compared runs, and the time of the last tick of each, simulated s."""

    pairs: Sequence[VisitPair]
    only_a: Sequence[node_visits.Visit]
    only_b: Sequence[node_visits.Visit]
    end_a: float
    end_b: float
    nodes: NodeMatch

    def all(self, side: Side) -> Sequence[node_visits.Visit]:
        if side == "a":
            return [*(pair.a for pair in self.pairs), *self.only_a]
        return [*(pair.b for pair in self.pairs), *self.only_b]


_Rank: TypeAlias = tuple[float, int, int]
"""Rank of a moment: time, phase within the tick, place within the phase.

Phases are 0 for ends, 1 for starts, 2 for ends of visits that began in the same tick. Ends go from below
upwards, starts from above downwards.
"""


@dataclass(frozen=True, slots=True)
class _Candidate:
    rank: _Rank
    how: How
    a: node_visits.Visit | None
    b: node_visits.Visit | None
    also: tuple[Aspect, ...] = ()


def find_parting(sides: ComparedRuns) -> Divergence | None:
    """Return the first divergence; None when there is none.

    A node with children that only one mission has is no divergence by itself: the behaviour of its children
    counts.
    """
    first = min(_candidates(sides), key=lambda candidate: candidate.rank, default=None)
    over = min(sides.end_a, sides.end_b)
    if first is None or first.rank[0] > over + TIME_TOLERANCE:
        return _log_end_divergence(sides, over)
    time, a, b = first.rank[0], first.a, first.b
    if first.how == "order":
        a, b = a or _next(sides, "a", time, new=True), b or _next(sides, "b", time, new=True)
    return Divergence(
        time,
        first.how,
        first.also,
        a,
        b,
        _next(sides, "a", time, leaf=True, beside=a),
        _next(sides, "b", time, leaf=True, beside=b),
    )


def _candidates(sides: ComparedRuns) -> Iterator[_Candidate]:
    for pair in sides.pairs:
        a, b = pair.a, pair.b
        begun = min(a.start, b.start)
        if abs(a.start - b.start) > TIME_TOLERANCE:
            early_a = a.start < b.start
            rank = (begun, 1, a.number if early_a else b.number)
            yield _Candidate(rank, "order", a if early_a else None, None if early_a else b)
            continue
        if pair.differs and pair.differs[0] in AT_START:
            yield _Candidate((begun, 1, a.number), pair.differs[0], a, b, pair.differs[1:])
        elif pair.differs:
            ended = min(one.end for one in (a, b) if one.outcome != "RUNNING")
            phase = 2 if ended <= begun + TIME_TOLERANCE else 0
            yield _Candidate((ended, phase, -a.path.count("/")), pair.differs[0], a, b, pair.differs[1:])
    inner = {node.path for node in (*sides.nodes.only_a, *sides.nodes.only_b) if node.children}
    for visit in sides.only_a:
        if visit.path not in inner:
            yield _Candidate((visit.start, 1, visit.number), "order", visit, None)
    for visit in sides.only_b:
        if visit.path not in inner:
            yield _Candidate((visit.start, 1, visit.number), "order", None, visit)


def _log_end_divergence(sides: ComparedRuns, over: float) -> Divergence | None:
    """Return the divergence at the end of one log when nothing differed before; None when both end
    together."""
    if abs(sides.end_a - sides.end_b) <= TIME_TOLERANCE or not sides.pairs:
        return None
    a, b = (_deepest_open_visit(sides.all(side), over) for side in SIDES)
    next_a, next_b = (_next(sides, side, over + TIME_TOLERANCE, leaf=True) for side in SIDES)
    return Divergence(over, "end", (), a, b, next_a, next_b)


def _deepest_open_visit(visits: Sequence[node_visits.Visit], time: float) -> node_visits.Visit | None:
    """Return the deepest visit that is open at that time."""
    open_ = [
        v for v in visits if v.start <= time + TIME_TOLERANCE and (v.outcome == "RUNNING" or v.end > time)
    ]
    return max(open_, key=lambda visit: visit.path.count("/"), default=None)


def _next(
    sides: ComparedRuns,
    side: Side,
    time: float,
    *,
    new: bool = False,
    leaf: bool = False,
    beside: node_visits.Visit | None = None,
) -> node_visits.Visit | None:
    """Return the first visit of that side that begins at `time` or later.

    `new`: it does not begin at the same time in the other run; `leaf`: its node has no children; `beside`: it
    is not this visit.
    """
    alike: set[int] = set()
    if new:
        alike = {
            (pair.a if side == "a" else pair.b).number
            for pair in sides.pairs
            if abs(pair.a.start - pair.b.start) <= TIME_TOLERANCE
        }
    nodes = [pair.a if side == "a" else pair.b for pair in sides.nodes.pairs]
    nodes += sides.nodes.only_a if side == "a" else sides.nodes.only_b
    inner = {node.path for node in nodes if node.children}
    fitting = (
        visit
        for visit in sides.all(side)
        if visit.start >= time - TIME_TOLERANCE
        and visit.number not in alike
        and not (leaf and visit.path in inner)
        and (beside is None or visit.number != beside.number)
    )
    return min(fitting, key=lambda visit: visit.number, default=None)


@dataclass(frozen=True, slots=True)
class Alignment:
    """Two runs with their visits in pairs.

    Visits that were open at `since` count as if they had begun then, and `attempt` is counted from there.
    `number`, `parent` and the numbers of ticks are those of the visit's own run.
    """

    since: float
    """Start of the comparison, simulated s; 0.0: the beginning."""
    items: ItemMatch
    nodes: NodeMatch
    pairs: tuple[VisitPair, ...]
    """Pairs in the order of their starts in A."""
    only_a: tuple[node_visits.Visit, ...]
    only_b: tuple[node_visits.Visit, ...]
    parting: Divergence | None
    """First divergence; None when nothing differs."""
    until: float | None = None
    """End of the compared visits, simulated s: a gap of one of the logs begins there. None: no gap."""
    derived: bool = False
    """Whether the visits follow from the statuses after each tick, because one log is of format 1."""

    @property
    def visits_a(self) -> tuple[node_visits.Visit, ...]:
        return (*(pair.a for pair in self.pairs), *self.only_a)

    @property
    def visits_b(self) -> tuple[node_visits.Visit, ...]:
        return (*(pair.b for pair in self.pairs), *self.only_b)


@dataclass(frozen=True, slots=True)
class _Side:
    """Visits of one run, from the first compared tick on."""

    visits: tuple[node_visits.Visit, ...]
    keys: tuple[node_visits.Key, ...]
    """Keys of the visits, with the names of run A."""
    resumed: frozenset[int]
    """Indices of the visits that had begun before the comparison."""


def align(a: Run, b: Run, *, since: float = 0.0) -> Alignment:
    """Pair the visits of two runs from `since` (simulated s) on, up to the first gap of a log.

    A log that begins later than its run, as that of a resumed run, is compared from after its first tick on.
    So is the other log. That tick only holds the state at the checkpoint.

    A log of format 1 has no starts and ends of nodes. Both runs are then compared by the statuses after each
    tick, without inputs.
    """
    begun = max((run.ticks.times[0] for run in (a, b) if run.ticks.times), default=0.0)
    if begun > TIME_TOLERANCE:
        since = max(since, begun + a.info.tick / 2)
    until = _first_gap(a, b, since)
    items, nodes = match_items(a, b, since=since), match_nodes(a, b)
    # An item that only B has must not be taken for an item of A with the same name.
    names = {**{name: f"{name} of B" for name in items.only_b}, **items.a_by_b}
    called = {pair.a: pair.b for pair in items.pairs}
    derived = a.log.format < 2 or b.log.format < 2
    in_a, in_b = (account_of(run.log, run.events, derived=True) if derived else run.account for run in (a, b))
    side_a = _side(in_a.visits, since, until, {}, {})
    side_b = _side(in_b.visits, since, until, names, nodes.a_by_b)
    index_b = {key: m for m, key in enumerate(side_b.keys)}
    partners = {n: index_b[key] for n, key in enumerate(side_a.keys) if key in index_b}
    pairs: list[VisitPair] = []
    for n, m in partners.items():
        one, other = side_a.visits[n], side_b.visits[m]
        resumed = n in side_a.resumed or m in side_b.resumed
        if resumed and one.item and not other.item:
            other = replace(other, item=called.get(one.item, one.item))
        pairs.append(VisitPair(one, other, differences(one, other, names, resumed=resumed)))
    taken = set(partners.values())
    only_a = tuple(visit for n, visit in enumerate(side_a.visits) if n not in partners)
    only_b = tuple(visit for m, visit in enumerate(side_b.visits) if m not in taken)
    end_a, end_b = (run.last_tick if until is None else min(run.last_tick, until) for run in (a, b))
    sides = ComparedRuns(pairs, only_a, only_b, end_a, end_b, nodes)
    return Alignment(since, items, nodes, tuple(pairs), only_a, only_b, find_parting(sides), until, derived)


def _first_gap(a: Run, b: Run, since: float) -> float | None:
    """Return the start of the first gap after `since`, simulated s; None when there is none."""
    starts = (gap.start for run in (a, b) for gap in run.log.gaps if gap.start is not None)
    return min((start for start in starts if start > since), default=None)


def _side(
    of_run: Sequence[node_visits.Visit],
    since: float,
    until: float | None,
    items: Mapping[str, str],
    nodes: Mapping[str, str],
) -> _Side:
    counts: Counter[tuple[str, str]] = Counter()
    visits: list[node_visits.Visit] = []
    keys: list[node_visits.Key] = []
    resumed: set[int] = set()
    for visit in of_run:
        if visit.end < since - TIME_TOLERANCE or (until is not None and visit.start > until + TIME_TOLERANCE):
            continue
        if until is not None and visit.end > until + TIME_TOLERANCE:
            visit = replace(visit, end=until, outcome="RUNNING", cause="", origin="", message="", evidence={})
        item, path = items.get(visit.item, visit.item), nodes.get(visit.path, visit.path)
        if visit.start < since - TIME_TOLERANCE:
            # A node has one such visit. A run from a checkpoint cannot know its item.
            resumed.add(len(visits))
            visits.append(replace(visit, start=since, attempt=0))
            keys.append(("", path, 0))
            continue
        counts[item, path] += 1
        visits.append(replace(visit, attempt=counts[item, path]))
        keys.append((item, path, counts[item, path]))
    return _Side(tuple(visits), tuple(keys), frozenset(resumed))
