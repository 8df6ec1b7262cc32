"""Two runs side by side: which visit of one is which visit of the other, and where they part.

A visit is named by (item, node path, attempt). Items are paired by `items`, nodes by `nodes`; the attempts
are counted from `since` on, on both sides, so that a run that goes on from a checkpoint aligns with the one
that it continues. Times are simulated seconds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..run import Run
from ..visits import Key, Visit, under_way
from .items import ItemMatch, match_items
from .nodes import NodeMatch, match_nodes
from .pair import EPSILON, Pair, differences
from .parting import Parting, Sides, find_parting


@dataclass(frozen=True, slots=True)
class Alignment:
    """Two runs side by side.

    Visits that were under way at `since` are in it as if they had begun then, and `attempt` is counted from
    there. `number`, `parent` and the numbers of ticks are those of the visit's own run.
    """

    since: float
    """Time of the first tick that is compared."""
    items: ItemMatch
    nodes: NodeMatch
    pairs: tuple[Pair, ...]
    """In the order of the beginnings in A."""
    only_a: tuple[Visit, ...]
    only_b: tuple[Visit, ...]
    parting: Parting | None
    """None when nothing differs."""


@dataclass(frozen=True, slots=True)
class _Side:
    """The visits of one run, from the first tick that is compared."""

    visits: tuple[Visit, ...]
    keys: tuple[Key, ...]
    """By the names of run A."""
    resumed: frozenset[int]
    """Indices of the visits that had begun before."""


def align(a: Run, b: Run, *, since: float = 0.0) -> Alignment:
    """Pair the visits of two runs, from the first tick on that both have at `since` or later.

    A log of format 1 has no visits, and nothing of it is paired.
    """
    since = max(since, *(run.ticks.times[0] for run in (a, b) if run.ticks.times), 0.0)
    items, nodes = match_items(a, b, since=since), match_nodes(a, b)
    # What only B has must not be taken for what A calls by the same name.
    names = {**{name: f"{name} of B" for name in items.only_b}, **items.a_by_b}
    side_a, side_b = _side(a, since, {}, {}), _side(b, since, names, nodes.a_by_b)
    index_b = {key: m for m, key in enumerate(side_b.keys)}
    partners = {n: index_b[key] for n, key in enumerate(side_a.keys) if key in index_b}
    pairs: list[Pair] = []
    for n, m in partners.items():
        one, other = side_a.visits[n], side_b.visits[m]
        resumed = n in side_a.resumed or m in side_b.resumed
        pairs.append(Pair(one, other, differences(one, other, names, resumed=resumed)))
    taken = set(partners.values())
    only_a = tuple(visit for n, visit in enumerate(side_a.visits) if n not in partners)
    only_b = tuple(visit for m, visit in enumerate(side_b.visits) if m not in taken)
    sides = Sides(pairs, only_a, only_b, _end(a), _end(b), nodes)
    return Alignment(since, items, nodes, tuple(pairs), only_a, only_b, find_parting(sides))


def _side(run: Run, since: float, items: Mapping[str, str], nodes: Mapping[str, str]) -> _Side:
    counts: Counter[tuple[str, str]] = Counter()
    visits: list[Visit] = []
    keys: list[Key] = []
    resumed: set[int] = set()
    before = set(under_way(run.ticks[0].record)) if run.visits else set[str]()
    for visit in run.visits:
        if visit.end < since - EPSILON:
            continue
        item, path = items.get(visit.item, visit.item), nodes.get(visit.path, visit.path)
        if visit.start < since - EPSILON or visit.path in before:
            before.discard(visit.path)
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
