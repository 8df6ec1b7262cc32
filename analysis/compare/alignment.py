"""Two runs side by side: which visit of one is which visit of the other, and where they part.

A visit is named by (item, node path, attempt). Items are paired by `items`, nodes by `nodes`; the attempts
are counted from `since` on, on both sides, so that a run that goes on from a checkpoint aligns with the one
that it continues. Times are simulated seconds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ...logs.visits import Key, Visit, derived_visits
from ..run import Run
from .divergence import ComparedRuns, Divergence, find_parting
from .matching import ItemMatch, NodeMatch, match_items, match_nodes
from .visit_pair import EPSILON, VisitPair, differences


@dataclass(frozen=True, slots=True)
class PairedVisits:
    """`derived`: they follow from the statuses after each tick, because one log is of format 1 and tells no
    more; then what nodes read, and which object they were told of, is not known of either."""

    a: Sequence[Visit]
    b: Sequence[Visit]
    derived: bool


def both_visits(a: Run, b: Run) -> PairedVisits:
    if a.log.format < 2 or b.log.format < 2:
        return PairedVisits(derived_visits(a.log), derived_visits(b.log), derived=True)
    return PairedVisits(a.visits, b.visits, derived=False)


@dataclass(frozen=True, slots=True)
class Alignment:
    """Two runs side by side.

    Visits that were under way at `since` are in it as if they had begun then, and `attempt` is counted from
    there. `number`, `parent` and the numbers of ticks are those of the visit's own run.
    """

    since: float
    """Simulated s from which on they are compared; 0.0: from the beginning."""
    items: ItemMatch
    nodes: NodeMatch
    pairs: tuple[VisitPair, ...]
    """In the order of the beginnings in A."""
    only_a: tuple[Visit, ...]
    only_b: tuple[Visit, ...]
    parting: Divergence | None
    """None when nothing differs."""
    derived: bool = False
    """Whether the visits follow from the statuses after each tick, because one log is of format 1."""

    @property
    def visits_a(self) -> tuple[Visit, ...]:
        return (*(pair.a for pair in self.pairs), *self.only_a)

    @property
    def visits_b(self) -> tuple[Visit, ...]:
        return (*(pair.b for pair in self.pairs), *self.only_b)


@dataclass(frozen=True, slots=True)
class _Side:
    """The visits of one run, from the first tick that is compared."""

    visits: tuple[Visit, ...]
    keys: tuple[Key, ...]
    """By the names of run A."""
    resumed: frozenset[int]
    """Indices of the visits that had begun before."""


def align(a: Run, b: Run, *, since: float = 0.0) -> Alignment:
    """Pair the visits of two runs: what is at `since` (simulated s) or later.

    When a log begins later than a run does, as one that goes on from a checkpoint, both are compared from
    after its first tick on, which is how things stood at the checkpoint.
    A log of format 1 does not tell when nodes began and ended: both runs are then taken at the statuses after
    each tick, and what nodes read is not compared.
    """
    begun = max((run.ticks.times[0] for run in (a, b) if run.ticks.times), default=0.0)
    if begun > EPSILON:
        since = max(since, begun + a.info.tick / 2)
    items, nodes = match_items(a, b, since=since), match_nodes(a, b)
    # What only B has must not be taken for what A calls by the same name.
    names = {**{name: f"{name} of B" for name in items.only_b}, **items.a_by_b}
    called = {pair.a: pair.b for pair in items.pairs}
    both = both_visits(a, b)
    side_a = _side(both.a, since, {}, {})
    side_b = _side(both.b, since, names, nodes.a_by_b)
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
    sides = ComparedRuns(pairs, only_a, only_b, _end(a), _end(b), nodes)
    return Alignment(since, items, nodes, tuple(pairs), only_a, only_b, find_parting(sides), both.derived)


def _side(
    of_run: Sequence[Visit],
    since: float,
    items: Mapping[str, str],
    nodes: Mapping[str, str],
) -> _Side:
    counts: Counter[tuple[str, str]] = Counter()
    visits: list[Visit] = []
    keys: list[Key] = []
    resumed: set[int] = set()
    for visit in of_run:
        if visit.end < since - EPSILON:
            continue
        item, path = items.get(visit.item, visit.item), nodes.get(visit.path, visit.path)
        if visit.start < since - EPSILON:
            # There is one such visit of a node. What it is about, a run from a checkpoint cannot tell.
            resumed.add(len(visits))
            visits.append(replace(visit, start=since, attempt=0))
            keys.append(("", path, 0))
            continue
        counts[item, path] += 1
        visits.append(replace(visit, attempt=counts[item, path]))
        keys.append((item, path, counts[item, path]))
    return _Side(tuple(visits), tuple(keys), frozenset(resumed))


def _end(run: Run) -> float:
    """Time of the last tick, s."""
    return run.ticks.times[-1] if run.ticks.times else 0.0
