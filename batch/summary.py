"""What a batch amounts to: rates with intervals by recipe, causes, and the jobs worth a look."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .rows import Phase
from .statistics import Rate, rate
from .store import Store

_WORST = 10
_PHASES: tuple[Phase, ...] = ("observe", "think", "move", "grasp", "place", "recover", "other")


@dataclass(frozen=True, slots=True)
class Spread:
    """Median and quartiles."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: list[float]) -> Spread | None:
        """None of nothing."""
        if not values:
            return None
        low, median, high = np.percentile(values, (25, 50, 75)).tolist()
        return cls(median, low, high)

    def __str__(self) -> str:
        return f"{self.median:.0f} ({self.low:.0f} … {self.high:.0f})"


@dataclass(frozen=True, slots=True)
class Recipe:
    """One variant of the plan over its seeds."""

    label: str
    success: Rate
    """Of jobs: goal reached."""
    items: Rate
    """Of items: sorted."""
    crashed: int
    picks_an_hour: Spread | None
    """Simulated, over jobs."""
    phases: Mapping[Phase, float]
    """Simulated s for each object held."""


@dataclass(frozen=True, slots=True)
class CauseCount:
    cause: str
    failures: int
    cured: int
    jobs: int
    seconds_lost: float
    """Simulated s until they were decided."""


@dataclass(frozen=True, slots=True)
class Worst:
    """A job that missed its goal."""

    seed: int
    label: str
    status: str
    missed: int | None
    """Items not sorted."""
    look_at: str
    folder: str


@dataclass(frozen=True, slots=True)
class BatchSummary:
    total: int
    waiting: int
    recipes: tuple[Recipe, ...]
    causes: tuple[CauseCount, ...]
    """The most frequent first."""
    worst: tuple[Worst, ...]

    @property
    def reached(self) -> bool:
        """Whether every job was run and reached its goal."""
        return self.waiting == 0 and all(r.success.successes == r.success.total for r in self.recipes)

    def to_json(self) -> dict[str, Any]:
        return {
            "total": self.total,
            "waiting": self.waiting,
            "recipes": [
                {
                    "label": recipe.label,
                    "success": _rate_json(recipe.success),
                    "items": _rate_json(recipe.items),
                    "crashed": recipe.crashed,
                    "picks_an_hour": None
                    if recipe.picks_an_hour is None
                    else {
                        "median": recipe.picks_an_hour.median,
                        "low": recipe.picks_an_hour.low,
                        "high": recipe.picks_an_hour.high,
                    },
                    "seconds_a_pick": dict(recipe.phases),
                }
                for recipe in self.recipes
            ],
            "causes": [
                {
                    "cause": c.cause,
                    "failures": c.failures,
                    "cured": c.cured,
                    "jobs": c.jobs,
                    "seconds_lost": c.seconds_lost,
                }
                for c in self.causes
            ],
            "worst": [
                {
                    "seed": w.seed,
                    "label": w.label,
                    "status": w.status,
                    "missed": w.missed,
                    "look_at": w.look_at,
                    "folder": w.folder,
                }
                for w in self.worst
            ],
        }

    def to_json_text(self) -> str:
        return json.dumps(self.to_json(), ensure_ascii=False, indent=2) + "\n"

    def to_text(self) -> str:
        done = self.total - self.waiting
        lines = [f"{done} of {self.total} jobs run"]
        for recipe in self.recipes:
            lines += [
                "",
                recipe.label,
                f"  goal reached  {recipe.success}"
                + (f", {recipe.crashed} crashed" if recipe.crashed else ""),
                f"  items sorted  {recipe.items}",
                f"  picks an hour {recipe.picks_an_hour or 'none'} simulated; median and quartiles over jobs",
            ]
            split = [f"{phase} {recipe.phases[phase]:.2f}" for phase in _PHASES if phase in recipe.phases]
            if split:
                lines.append(f"  s a pick      {', '.join(split)}")
        if self.causes:
            width = max(len(c.cause) for c in self.causes)
            lines += ["", f"{'cause':<{width}}  failures   cured    jobs  s lost"]
            lines += [
                f"{c.cause:<{width}}  {c.failures:8}{c.cured:8}{c.jobs:8}{c.seconds_lost:8.0f}"
                for c in self.causes
            ]
        if self.worst:
            lines += ["", "missed their goal"]
            lines += [
                f"  seed {w.seed}, {w.label}: {w.status}"
                + (f", {w.missed} not sorted" if w.missed else "")
                + (f"; {w.look_at}" if w.look_at else "")
                + (f" ({w.folder})" if w.folder else "")
                for w in self.worst
            ]
        return "\n".join(lines)


def summarise(store: Store) -> BatchSummary:
    """Raises PicktreeError when the results cannot be read."""
    total, waiting = store.query("SELECT count(*), coalesce(sum(status = 'waiting'), 0) FROM jobs").rows[0]
    counts = store.query(
        "SELECT variant, count(*), sum(status = 'success'), sum(status = 'crashed'), "
        "coalesce(sum(items_sorted), 0), coalesce(sum(items_total), 0), coalesce(sum(picks_held), 0) "
        "FROM jobs WHERE status <> 'waiting' GROUP BY variant ORDER BY min(number)"
    )
    rates = _by_variant(store, "SELECT variant, rate FROM picks_an_hour")
    phases = store.query(
        "SELECT variant, phase, sum(seconds) FROM timings JOIN jobs USING (job) GROUP BY variant, phase"
    )
    causes = store.query("SELECT cause, failures, cured, jobs, coalesce(seconds_lost, 0) FROM causes")
    worst = store.query(f"SELECT seed, variant, status, missed, look_at, folder FROM worst LIMIT {_WORST}")
    recipes: list[Recipe] = []
    for label, jobs, successes, crashed, items_sorted, items_total, held in _typed(counts.rows):
        spent = {phase: seconds / held for v, phase, seconds in _typed(phases.rows) if v == label and held}
        recipes.append(
            Recipe(
                label,
                rate(successes, jobs),
                rate(items_sorted, items_total),
                crashed,
                Spread.of(rates.get(label, [])),
                spent,
            )
        )
    return BatchSummary(
        total=int(str(total)),
        waiting=int(str(waiting)),
        recipes=tuple(recipes),
        causes=tuple(CauseCount(*row) for row in _typed(causes.rows)),
        worst=tuple(Worst(*row) for row in _typed(worst.rows)),
    )


def _by_variant(store: Store, sql: str) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    for variant, value in _typed(store.query(sql).rows):
        found.setdefault(variant, []).append(value)
    return found


def _typed(rows: tuple[tuple[object, ...], ...]) -> tuple[tuple[Any, ...], ...]:
    """The columns have the types of the tables, which are strict."""
    return rows


def _rate_json(found: Rate) -> dict[str, Any]:
    return {
        "successes": found.successes,
        "total": found.total,
        "low": found.interval.low,
        "high": found.interval.high,
    }
