"""Alignment of two runs: pairs of visits, and the divergence of the runs.

The key of a visit is (item, node path, attempt). Items are paired by `match_items`, nodes by `match_nodes`.
On both sides attempts are counted from `since` on, so that a resumed run aligns with the run that it
continues. Times are simulated seconds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ...logs.run_account import account_of
from ...logs.visits import Key, Visit
from ..run import Run
from .divergence import ComparedRuns, Divergence, find_parting
from .matching import TIME_TOLERANCE, ItemMatch, NodeMatch, VisitPair, differences, match_items, match_nodes


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
    only_a: tuple[Visit, ...]
    only_b: tuple[Visit, ...]
    parting: Divergence | None
    """First divergence; None when nothing differs."""
    until: float | None = None
    """End of the compared visits, simulated s: a gap of one of the logs begins there. None: no gap."""
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
    """Visits of one run, from the first compared tick on."""

    visits: tuple[Visit, ...]
    keys: tuple[Key, ...]
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
    of_run: Sequence[Visit],
    since: float,
    until: float | None,
    items: Mapping[str, str],
    nodes: Mapping[str, str],
) -> _Side:
    counts: Counter[tuple[str, str]] = Counter()
    visits: list[Visit] = []
    keys: list[Key] = []
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
