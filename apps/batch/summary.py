"""Summary of a batch's results: rates with intervals, causes, and the jobs worth a look; as values, text and
JSON.
"""

from __future__ import annotations

import json
import shlex
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any

from picktree.logs import FigureCounts, Interval, OperatorFigures, Rate, episode_counts, rate

from .batch_decision import RecipeDecision, decisions
from .failure_drivers import DriverRanking, rank_drivers
from .plan import PLAN_FILE, read_plan
from .sequential_tests import rate_sequence
from .store import Store
from .tables import CELL_SIZE, Phase, cell_of

PHASES: tuple[Phase, ...] = ("observe", "think", "move", "grasp", "place", "recover", "other")
_MAX_NAMED_PLACES = 5
"""Number of places in the text, the worst first."""


@dataclass(frozen=True, slots=True)
class RecipeSummary:
    """Results of one variant of the plan over its seeds."""

    label: str
    success: Rate
    """Share of jobs with the goal reached."""
    items: Rate
    """Share of items sorted."""
    first_try: Rate
    """Share of grasped objects that were held at the first attempt."""
    crashed: int
    sequence: Interval | None
    """Confidence sequence of the share of jobs with the goal reached, while jobs wait; None afterwards."""
    figures: OperatorFigures
    """Operators' figures over the jobs that have a result."""
    phases: Mapping[Phase, float]
    """Simulated time for each held object, s."""


@dataclass(frozen=True, slots=True)
class CauseTotal:
    """Failures of one cause. An episode may have several: `CauseCount` counts episodes."""

    cause: str
    failures: int
    cured: int
    """Number of failures whose episodes were cured."""
    done_instead: int
    """Number of failures whose episodes a handler of `instead` ended."""
    jobs: int
    seconds_lost: float
    """Simulated time that the episodes of the cause lost, s."""


@dataclass(frozen=True, slots=True)
class RootTotal:
    """Jobs with the same first root cause: the one that cost the goal, else the first of the explanation.

    Further root causes of a job are not counted; `explain` of the batch's folder counts all.
    """

    cause: str
    jobs: int
    missed: int
    """Number of these jobs that missed their goal."""
    job: str
    """Id of a typical job: the first that missed its goal, else the first."""
    seed: int
    label: str
    look_at: str
    """Line on the root cause or key moment of the typical job."""


@dataclass(frozen=True, slots=True)
class Share:
    """Share of sorted items of one form or colour."""

    label: str
    rate: Rate


@dataclass(frozen=True, slots=True)
class TableCellShare:
    """Share of sorted items that arrived in one cell of the table; its corner with least x and y, world,
    m."""

    x: float
    y: float
    rate: Rate


@dataclass(frozen=True, slots=True)
class Breakdown:
    """Breakdown of one recipe, or of all together (empty `label`)."""

    label: str
    causes: tuple[CauseTotal, ...]
    """Causes, the most frequent first."""
    forms: tuple[Share, ...]
    colours: tuple[Share, ...]
    places: tuple[TableCellShare, ...]
    cures: tuple[episode_counts.CauseCount, ...] = ()
    """Observed causes with attempts and recoveries, by lost time, the longest first."""
    planted: tuple[episode_counts.PlantedCount, ...] = ()
    """Injected faults with the first failures after them."""
    roots: tuple[RootTotal, ...] = ()
    """First root causes of the jobs, those that cost the goal most often first."""


@dataclass(frozen=True, slots=True)
class WorstJob:
    """Job that missed its goal."""

    job: str
    seed: int
    label: str
    status: str
    missed: int | None
    """Number of items not sorted; None: unknown."""
    look_at: str
    folder: str
    root_cause: str = ""


@dataclass(frozen=True, slots=True)
class BatchSummary:
    folder: Path
    total: int
    waiting: int
    recipes: tuple[RecipeSummary, ...]
    together: Breakdown
    by_recipe: tuple[Breakdown, ...]
    worst: tuple[WorstJob, ...]
    ranking: DriverRanking
    """Drivers of failure, the clearest and strongest first."""
    decisions: tuple[RecipeDecision, ...] = ()
    """Comparisons of a batch that runs until its recipes are distinguished."""

    @property
    def causes(self) -> tuple[CauseTotal, ...]:
        return self.together.causes

    @property
    def reached(self) -> bool:
        """Whether every job was run and reached its goal."""
        return self.waiting == 0 and all(r.success.successes == r.success.total for r in self.recipes)

    def to_text(self) -> str:
        """Return a text for a terminal, without a trailing newline."""
        return "\n".join(_lines(self))

    def to_json(self) -> dict[str, Any]:
        return {
            "total": self.total,
            "waiting": self.waiting,
            "recipes": [_recipe_json(recipe) for recipe in self.recipes],
            **_breakdown_json(self.together),
            "decisions": [
                {"a": d.label_a, "b": d.label_b, **asdict(d.result), "p": d.result.p_value}
                for d in self.decisions
            ],
            "by_recipe": {each.label: _breakdown_json(each) for each in self.by_recipe},
            **self.ranking.to_json(),
            "worst": [asdict(w) for w in self.worst],
        }

    def to_json_text(self) -> str:
        return json.dumps(self.to_json(), ensure_ascii=False, indent=2) + "\n"


def _lines(found: BatchSummary) -> Iterator[str]:
    yield f"{found.total - found.waiting} of {found.total} jobs run"
    yield from (decision.to_text() for decision in found.decisions)
    for recipe in found.recipes:
        yield ""
        yield recipe.label
        crashed = f", {recipe.crashed} crashed" if recipe.crashed else ""
        yield f"  goal reached  {recipe.success}{crashed}"
        if recipe.sequence is not None:
            low, high = 100 * recipe.sequence.low, 100 * recipe.sequence.high
            yield f"                {low:.1f} … {high:.1f} % at any time, however often one looks"
        yield f"  items sorted  {recipe.items}"
        if recipe.first_try.total:
            yield f"  first grasps  {recipe.first_try} held"
        for title, text in recipe.figures.lines() if recipe.figures.runs else ():
            yield f"  {title:<13} {text}"
        split = [f"{phase} {recipe.phases[phase]:.2f}" for phase in PHASES if phase in recipe.phases]
        if split:
            yield f"  s a pick      {', '.join(split)}"
    together = found.together
    if together.roots:
        title = "first root cause"
        width = max(len(title), *(len(root.cause) for root in together.roots))
        yield ""
        yield f"{title:<{width}}    jobs  goal missed  such as"
        for root in together.roots:
            such = f"seed {root.seed}, {root.label}{f': {root.look_at}' if root.look_at else ''}"
            yield f"{root.cause:<{width}}{root.jobs:8}{root.missed:13}  {such}"
    if together.causes:
        width = max(len("cause"), *(len(c.cause) for c in together.causes))
        total, so_far = sum(c.failures for c in together.causes), 0
        yield ""
        yield f"{'cause':<{width}}  failures     sum    jobs"
        for c in together.causes:
            so_far += c.failures
            share = f"{100 * so_far / total:.0f} %"
            yield f"{c.cause:<{width}}  {c.failures:8}{share:>8}{c.jobs:8}"
    yield from _cures(together)
    if together.forms:
        yield ""
        yield f"items sorted  by form: {_shares(together.forms)}"
        yield f"              by colour: {_shares(together.colours)}"
        yield f"              by place: {_worst_places(together.places)}"
    for number, line in enumerate(found.ranking.lines()):
        yield from ("", line) if number == 0 else (line,)
    if found.worst:
        yield ""
        yield "missed their goal"
        for w in found.worst:
            missed = f", {w.missed} not sorted" if w.missed else ""
            look = f"; {w.look_at}" if w.look_at else ""
            look += f" [{w.root_cause}]" if w.root_cause else ""
            where = w.folder or shlex.join(["picktree", "resim", f"{found.folder}@{w.job}"])
            yield f"  seed {w.seed}, {w.label}: {w.status}{missed}{look} ({where})"


def _cures(together: Breakdown) -> Iterator[str]:
    """Yield lines about the recovery of each cause, and about the detection of injected faults."""
    if together.cures:
        width = max(len("cause"), *(len(c.cause) for c in together.cures))
        yield ""
        yield f"{'cause':<{width}}  episodes  {'cured of those to be cured':<32} tries   s lost  by"
        for c in together.cures:
            total, tries = c.total, c.total.tries_a_cure
            mean = "" if tries is None else f"{tries:.1f}"
            cured = str(rate(total.cured, total.to_cure)) if total.to_cure else ""
            yield f"{c.cause:<{width}}  {total.seen:8}  {cured:<32} {mean:>5}{total.seconds:9.1f}  {_by(c)}"
    for n, fault in enumerate(dict.fromkeys(p.fault for p in together.planted)):
        if not n:
            yield ""
        same = sorted((p for p in together.planted if p.fault == fault), key=lambda p: -p.count)
        parts = [
            f"{p.count} {p.cause} ({episode_counts.ENDS[p.end]})" if p.cause else f"{p.count} nothing"
            for p in same
        ]
        title = "planted" if not n else ""
        yield f"{title:<8}{sum(p.count for p in same)} {fault}, first seen as: {', '.join(parts)}"


def _by(found: episode_counts.CauseCount) -> str:
    """Return the last handlers with their success, as `RetreatAndLook 9 of 10, trying again 2 of 2`."""
    tried = [f"{c.cure} {c.cured} of {c.to_cure}" for c in found.by_cure if c.cure and c.to_cure]
    tried += [f"{c.cure} instead {c.done_instead}" for c in found.by_cure if c.done_instead]
    if found.total.unhandled:
        tried.append(f"nobody {found.total.unhandled}")
    untried = sum(c.given_up for c in found.by_cure if not c.cure)
    if untried:
        tried.append(f"given up untried {untried}")
    return ", ".join(tried)


def _shares(shares: tuple[Share, ...]) -> str:
    return ", ".join(f"{s.label} {s.rate.successes} of {s.rate.total}" for s in shares)


def _worst_places(places: tuple[TableCellShare, ...]) -> str:
    lacking = [p for p in places if p.rate.successes < p.rate.total]
    if not lacking:
        return f"all in each of {len(places)} cells of 5 cm"
    lacking.sort(key=lambda p: (-(p.rate.total - p.rate.successes), p.rate.share or 0.0, p.x, p.y))
    lines = [
        f"{p.rate.successes} of {p.rate.total} at {p.x:.2f}, {p.y:.2f} m" for p in lacking[:_MAX_NAMED_PLACES]
    ]
    more = (
        f"; not all in {len(lacking) - _MAX_NAMED_PLACES} further cells"
        if len(lacking) > _MAX_NAMED_PLACES
        else ""
    )
    whole = len(places) - len(lacking)
    rest = f"; all in {whole} other cell{'s' if whole > 1 else ''} of 5 cm" if whole else ""
    return "; ".join(lines) + more + rest


def _recipe_json(recipe: RecipeSummary) -> dict[str, Any]:
    return {
        "label": recipe.label,
        **{name: _rate_json(getattr(recipe, name)) for name in ("success", "items", "first_try")},
        "crashed": recipe.crashed,
        "sequence": None if recipe.sequence is None else asdict(recipe.sequence),
        "figures": recipe.figures.to_json(),
        "seconds_a_pick": dict(recipe.phases),
    }


def _breakdown_json(found: Breakdown) -> dict[str, Any]:
    return {
        "roots": [asdict(root) for root in found.roots],
        "causes": [asdict(c) for c in found.causes],
        "forms": [{"label": s.label, "rate": _rate_json(s.rate)} for s in found.forms],
        "colours": [{"label": s.label, "rate": _rate_json(s.rate)} for s in found.colours],
        "cures": [
            {
                "cause": c.cause,
                "rate": _rate_json(rate(c.total.cured, c.total.to_cure)),
                "tries_a_cure": c.total.tries_a_cure,
                **_counts_json(c.total),
                "by": [{"cure": each.cure, **_counts_json(each)} for each in c.by_cure],
            }
            for c in found.cures
        ],
        "planted": [asdict(p) for p in found.planted],
        "places": [{"x": p.x, "y": p.y, "rate": _rate_json(p.rate)} for p in found.places],
    }


def _counts_json(found: episode_counts.CureCount) -> dict[str, Any]:
    counts = asdict(found)
    return {name: counts[name] for name in counts if name not in ("cause", "cure")}


def _rate_json(found: Rate) -> dict[str, Any]:
    return {"successes": found.successes, "total": found.total, **asdict(found.interval)}


_WORST = 10


def summarise(store: Store) -> BatchSummary:
    """Summarise a batch. Raises PicktreeError when the results cannot be read."""
    ((total, waiting),) = _rows(store, "SELECT count(*), coalesce(sum(status = 'waiting'), 0) FROM jobs")
    recipes = _recipes(store, ended=not waiting)
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
        rank_drivers(store),
        _decisions(store),
    )


def _decisions(store: Store) -> tuple[RecipeDecision, ...]:
    if not (store.path.parent / PLAN_FILE).is_file():
        return ()
    plan = read_plan(store.path.parent)
    return decisions(store, plan) if plan.until == "decided" else ()


def _recipes(store: Store, *, ended: bool) -> tuple[RecipeSummary, ...]:
    counts = _rows(
        store,
        "SELECT variant, count(*), sum(status = 'success'), sum(status = 'crashed'), "
        "coalesce(sum(items_sorted), 0), coalesce(sum(items_total), 0) "
        "FROM jobs WHERE status <> 'waiting' GROUP BY variant ORDER BY min(number)",
    )
    counts_by_job, figures = store.figures(), defaultdict[str, list[FigureCounts]](list)
    for job in store.jobs():
        if job.id in counts_by_job:
            figures[job.variant.label].append(counts_by_job[job.id])
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
            None if ended else rate_sequence(successes, jobs),
            OperatorFigures(tuple(figures[label])),
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
    cures = [(variant, episode_counts.CureCount(*row)) for variant, *row in seen]
    faults = _rows(store, "SELECT variant, fault, cause, ended, faults FROM planted_seen")
    planted = [(variant, episode_counts.PlantedCount(*row)) for variant, *row in faults]
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
            episode_counts.by_cause(
                episode_counts.added_cures(cure for variant, cure in cures if wanted(variant))
            ),
            episode_counts.added_planted(fault for variant, fault in planted if wanted(variant)),
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
        before = sums.get(c.cause, CauseTotal(c.cause, 0, 0, 0, 0, 0.0))
        counts = (one + other for one, other in zip(astuple(before)[1:], astuple(c)[1:], strict=True))
        sums[c.cause] = CauseTotal(c.cause, *counts)
    return tuple(sorted(sums.values(), key=lambda c: (-c.failures, c.cause)))


def _rows(store: Store, sql: str) -> tuple[tuple[Any, ...], ...]:
    """Return the rows of a query. The columns have the types of the tables, which are strict."""
    return store.query(sql).rows
