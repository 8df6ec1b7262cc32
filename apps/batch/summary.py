"""Summary of a batch's results: rates with intervals, causes, and the jobs worth a look."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any

from ...logs.episode_counts import CureCount, PlantedCount, added_cures, added_planted, by_cause
from .findings import (
    BatchSummary,
    Breakdown,
    CauseTotal,
    RecipeSummary,
    RootTotal,
    Share,
    Spread,
    TableCellShare,
    WorstJob,
)
from .rates import Rate, rate
from .store import Store
from .views import CELL_SIZE, cell_of

_WORST = 10


def summarise(store: Store) -> BatchSummary:
    """Summarise a batch. Raises PicktreeError when the results cannot be read."""
    ((total, waiting),) = _rows(store, "SELECT count(*), coalesce(sum(status = 'waiting'), 0) FROM jobs")
    recipes = _recipes(store)
    by_recipe, together = _breakdowns(store, [recipe.label for recipe in recipes])
    worst = _rows(
        store,
        f"SELECT job, seed, variant, status, missed, look_at, folder, root_cause FROM worst LIMIT {_WORST}",
    )
    return BatchSummary(
        store.path.parent,
        total,
        waiting,
        recipes,
        together,
        by_recipe,
        tuple(WorstJob(*row) for row in worst),
    )


def _recipes(store: Store) -> tuple[RecipeSummary, ...]:
    counts = _rows(
        store,
        "SELECT variant, count(*), sum(status = 'success'), sum(status = 'crashed'), "
        "coalesce(sum(items_sorted), 0), coalesce(sum(items_total), 0) "
        "FROM jobs WHERE status <> 'waiting' GROUP BY variant ORDER BY min(number)",
    )
    rates: defaultdict[str, list[float]] = defaultdict(list)
    for variant, value in _rows(store, "SELECT variant, rate FROM picks_an_hour"):
        rates[variant].append(value)
    first = {
        variant: rate(held, objects)
        for variant, objects, held in _rows(store, "SELECT variant, objects, held_at_first FROM first_try")
    }
    spent: defaultdict[str, dict[Any, float]] = defaultdict(dict)
    for variant, phase, seconds in _rows(store, "SELECT variant, phase, seconds_a_pick FROM cycle_time"):
        if seconds is not None:
            spent[variant][phase] = seconds
    return tuple(
        RecipeSummary(
            label,
            rate(successes, jobs),
            rate(items_sorted, items_total),
            first.get(label, rate(0, 0)),
            crashed,
            Spread.of(rates[label]),
            spent[label],
        )
        for label, jobs, successes, crashed, items_sorted, items_total in counts
    )


def _breakdowns(store: Store, labels: list[str]) -> tuple[tuple[Breakdown, ...], Breakdown]:
    """Return the breakdown of each recipe, and of all together."""
    causes: list[tuple[str, CauseTotal]] = [
        (variant, CauseTotal(*row))
        for variant, *row in _rows(
            store,
            # From the table: views of an older batch lack a column.
            "SELECT variant, cause, count(*), sum(fate = 'cured'), sum(fate = 'done_instead'), "
            "count(DISTINCT job), coalesce((SELECT sum(seconds) FROM episodes JOIN jobs AS j USING (job) "
            "WHERE j.variant = jobs.variant AND episodes.cause = failures.cause), 0) "
            "FROM failures JOIN jobs USING (job) "
            "GROUP BY variant, cause ORDER BY min(number), count(*) DESC",
        )
    ]
    seen = _rows(
        store,
        "SELECT variant, cause, handler, seen, cured, given_up, unhandled, open, tries, tries_cured, "
        "seconds, seen - cured - given_up - unhandled - open FROM cures_by_recipe",
    )
    cures = [(variant, CureCount(*row)) for variant, *row in seen]
    faults = _rows(store, "SELECT variant, fault, cause, ended, faults FROM planted_seen")
    planted = [(variant, PlantedCount(*row)) for variant, *row in faults]
    roots = _rows(
        store,
        "SELECT root_cause, status = 'success', job, seed, variant, look_at FROM jobs "
        "WHERE status <> 'waiting' AND root_cause <> '' ORDER BY number",
    )
    counted = "count(*), sum(verdict = 'sorted') FROM items JOIN jobs USING (job) GROUP BY variant"
    forms = _rows(store, f"SELECT variant, form, {counted}, form ORDER BY form")
    colours = _rows(store, f"SELECT variant, colour, {counted}, colour ORDER BY colour")
    cell = f"SELECT variant, {cell_of('x')} AS i, {cell_of('y')} AS j"
    places = _rows(store, f"{cell}, {counted}, i, j ORDER BY i, j")

    def of(wanted: Callable[[str], bool], label: str) -> Breakdown:
        return Breakdown(
            label,
            _added_causes(cause for variant, cause in causes if wanted(variant)),
            tuple(Share(name, r) for (name,), r in _summed_rates(forms, wanted)),
            tuple(Share(name, r) for (name,), r in _summed_rates(colours, wanted)),
            tuple(
                TableCellShare(round(i * CELL_SIZE, 9), round(j * CELL_SIZE, 9), r)
                for (i, j), r in _summed_rates(places, wanted)
            ),
            by_cause(added_cures(cure for variant, cure in cures if wanted(variant))),
            added_planted(fault for variant, fault in planted if wanted(variant)),
            _roots(row for row in roots if wanted(row[4])),
        )

    each = tuple(of(lambda variant, label=label: variant == label, label) for label in labels)
    return each, of(lambda variant: True, "")


def _roots(rows: Iterable[tuple[Any, ...]]) -> tuple[RootTotal, ...]:
    """Return the root causes of jobs in the order of the plan, those that cost the goal most often first."""
    jobs: defaultdict[str, list[tuple[Any, ...]]] = defaultdict(list)
    for cause, *job in rows:
        jobs[cause].append(tuple(job))
    totals = [
        RootTotal(cause, len(same), len(missed), *(missed or same)[0][1:])
        for cause, same in jobs.items()
        for missed in ([job for job in same if not job[0]],)
    ]
    return tuple(sorted(totals, key=lambda root: (-root.missed, -root.jobs, root.cause)))


def _summed_rates(
    rows: tuple[tuple[Any, ...], ...], wanted: Callable[[str], bool]
) -> list[tuple[tuple[Any, ...], Rate]]:
    """Return the rate of sorted items of the wanted recipes, by the columns in between."""
    counts: dict[tuple[Any, ...], tuple[int, int]] = {}
    for variant, *key, total, good in rows:
        if wanted(variant):
            before = counts.get(tuple(key), (0, 0))
            counts[tuple(key)] = (before[0] + total, before[1] + good)
    return [(key, rate(good, total)) for key, (total, good) in counts.items()]


def _added_causes(causes: Iterable[CauseTotal]) -> tuple[CauseTotal, ...]:
    """Add up causes, the most frequent first. Each job has one recipe, so that jobs add up, too."""
    sums: dict[str, CauseTotal] = {}
    for c in causes:
        b = sums.get(c.cause, CauseTotal(c.cause, 0, 0, 0, 0, 0.0))
        sums[c.cause] = CauseTotal(
            c.cause,
            b.failures + c.failures,
            b.cured + c.cured,
            b.done_instead + c.done_instead,
            b.jobs + c.jobs,
            b.seconds_lost + c.seconds_lost,
        )
    return tuple(sorted(sums.values(), key=lambda c: (-c.failures, c.cause)))


def _rows(store: Store, sql: str) -> tuple[tuple[Any, ...], ...]:
    """Return the rows of a query. The columns have the types of the tables, which are strict."""
    return store.query(sql).rows
