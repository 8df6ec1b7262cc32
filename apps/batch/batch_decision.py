"""Decision of a batch that runs until its recipes are distinguished: the first recipe with each other one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from .plan import BatchPlan
from .rates import SIGNIFICANCE_LEVEL
from .sequential_tests import SequentialResult, compare_sequentially
from .store import Store


@dataclass(frozen=True, slots=True)
class RecipeDecision:
    """Comparison of the first recipe of a plan with another one."""

    label_a: str
    label_b: str
    result: SequentialResult

    def to_text(self) -> str:
        return f"A {self.label_a}, B {self.label_b}: {self.result.to_text()}"


def decisions(store: Store, plan: BatchPlan) -> tuple[RecipeDecision, ...]:
    """Compare the first recipe with each other one; all verdicts together are false with a probability of 5 %
    at most.

    Seeds count in the order of the plan, up to the first one that a recipe lacks: which job ends first may
    depend on its result.
    """
    labels = list(dict.fromkeys(job.variant.label for job in store.jobs()))
    rows: Any = store.query(
        "SELECT variant, seed, status = 'success', coalesce(items_sorted * 3600.0 / sim_seconds, 0) "
        "FROM jobs WHERE status <> 'waiting'"
    ).rows
    goals: dict[str, dict[int, float]] = {label: {} for label in labels}
    units: dict[str, dict[int, float]] = {label: {} for label in labels}
    for label, seed, reached, hourly in rows:
        goals[label][seed], units[label][seed] = float(reached), float(hourly)
    values = goals if plan.by == "goal" else units
    first = labels[0]
    found: list[RecipeDecision] = []
    for label in labels[1:]:
        pairs = list(_pairs(plan.seeds, values[first], values[label]))
        level = SIGNIFICANCE_LEVEL / (len(labels) - 1)
        result = compare_sequentially(pairs, plan.by, plan.margin, level)
        found.append(RecipeDecision(first, label, result))
    return tuple(found)


def _pairs(seeds: tuple[int, ...], a: dict[int, float], b: dict[int, float]) -> Iterator[tuple[float, float]]:
    for seed in seeds:
        if seed not in a or seed not in b:
            return
        yield a[seed], b[seed]
