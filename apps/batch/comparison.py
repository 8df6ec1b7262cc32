"""Comparison of two recipes: differences beyond chance, and seeds with a changed result."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from ...logs.schema.json_records import arithmetic_difference
from .differences import (
    JobOutcome,
    MeanDifference,
    RecipeOutcomes,
    paired_difference,
    read_recipe,
    unpaired_difference,
)
from .rates import (
    SIGNIFICANCE_LEVEL,
    Interval,
    Paired,
    Rate,
    difference_of_paired_rates,
    difference_of_rates,
    equal_rates_p,
    holm,
    paired,
    rate,
)

Side: TypeAlias = Literal["A", "B"]
_MIN_SHARED_SEED_SHARE = 0.5
"""Least share of the smaller side's seeds that both must have for a comparison by seed."""


@dataclass(frozen=True, slots=True)
class Criterion:
    """Criterion in which recipes are compared, with a test."""

    name: str
    words: str
    """Advantage of the better recipe in words."""
    more_is_better: bool
    difference: MeanDifference
    """Difference in a share for `goal`; else per job."""
    adjusted: float = 1.0
    """P value by Holm's method, over all criteria."""

    @property
    def better(self) -> Side | None:
        """Better side; None when chance explains the difference."""
        if self.adjusted >= SIGNIFICANCE_LEVEL or not self.difference.mean:
            return None
        return "B" if (self.difference.mean > 0) == self.more_is_better else "A"


@dataclass(frozen=True, slots=True)
class CauseChange:
    """Difference in failures of one cause, per job."""

    cause: str
    difference: MeanDifference
    adjusted: float = 1.0
    """P value by Holm's method, over all causes: they explain and do not decide."""


@dataclass(frozen=True, slots=True)
class ChangedSeed:
    """Seed on which one recipe succeeded and the other did not."""

    seed: int
    winner: Side
    logs: tuple[str, str] | None = None
    """Absolute paths of the logs of A and B, when both were kept."""
    missing: tuple[Side, ...] = ()
    """Sides whose log was not kept."""
    parting: str = ""
    """Place of the divergence in a line; empty when it was not searched."""


@dataclass(frozen=True, slots=True)
class RecipeComparison:
    label_a: str
    label_b: str
    success_a: Rate
    success_b: Rate
    paired: Paired | None
    """Paired result; None when the jobs are compared as independent ones."""
    criteria: tuple[Criterion, ...]
    causes: tuple[CauseChange, ...]
    """Changes of causes, the clearest first."""
    changed: tuple[ChangedSeed, ...]
    shared: int
    """Number of seeds that both have."""
    alone: int
    """Number of seeds that only one of them has."""
    arithmetic: str = ""
    """Sentence when jobs were computed with different arithmetic, or it was not recorded; else empty."""

    @property
    def differ(self) -> bool:
        """Whether any criterion differs by more than chance explains; for equal recipes in 5 % of all
        cases."""
        return any(criterion.better for criterion in self.criteria)

    def criterion(self, name: str) -> Criterion:
        return next(criterion for criterion in self.criteria if criterion.name == name)


def compare(a: str, b: str, *, unpaired: bool = False) -> RecipeComparison:
    """Compare two recipes, given as batches' folders, or FOLDER@LABEL for one recipe of several.

    They are paired by seed, unless they share less than half of their seeds, or `unpaired` is set. Raises
    PicktreeError when there is no such recipe, or none of its jobs was run.
    """
    return compare_recipes(read_recipe(a), read_recipe(b), unpaired=unpaired)


def compare_recipes(a: RecipeOutcomes, b: RecipeOutcomes, *, unpaired: bool = False) -> RecipeComparison:
    shared = sorted(set(a.outcomes) & set(b.outcomes))
    by_seed = not unpaired and len(shared) >= _MIN_SHARED_SEED_SHARE * min(len(a.outcomes), len(b.outcomes))
    pairs = [(a.outcomes[seed], b.outcomes[seed]) for seed in shared]
    of_a, of_b = (
        ([x for x, _ in pairs], [y for _, y in pairs])
        if by_seed
        else (list(a.outcomes.values()), list(b.outcomes.values()))
    )

    def difference(value: Callable[[JobOutcome], float | None]) -> MeanDifference:
        if by_seed:
            both = ((value(x), value(y)) for x, y in pairs)
            return paired_difference([(x, y) for x, y in both if x is not None and y is not None])
        return unpaired_difference(*(_known(map(value, side)) for side in (of_a, of_b)))

    rate_a, rate_b = (rate(sum(x.success for x in side), len(side)) for side in (of_a, of_b))
    table = paired([(x.success, y.success) for x, y in pairs]) if by_seed else None
    return RecipeComparison(
        a.label,
        b.label,
        rate_a,
        rate_b,
        table,
        _criteria(_goal(rate_a, rate_b, table), difference),
        _causes(of_a, of_b, difference),
        tuple(_changed(x, y, a, b) for x, y in pairs if x.success != y.success),
        len(shared),
        len(set(a.outcomes) ^ set(b.outcomes)),
        _arithmetic_difference(a, b),
    )


def _arithmetic_difference(a: RecipeOutcomes, b: RecipeOutcomes) -> str:
    """Return the difference in arithmetic between jobs of A and B, or within one of them; empty when none."""
    sides = ((a, b, "in B"), (a, a, "in other jobs of A"), (b, b, "in other jobs of B"))
    said = (
        arithmetic_difference(one, other, where)
        for first, second, where in sides
        for one in first.arithmetics
        for other in second.arithmetics
    )
    return next(filter(None, said), "")


def _criteria(
    goal: MeanDifference, difference: Callable[[Callable[[JobOutcome], float | None]], MeanDifference]
) -> tuple[Criterion, ...]:
    found = (
        Criterion("goal", "reaches the goal more often", True, goal),
        Criterion("items", "sorts more items", True, difference(lambda o: o.items_sorted)),
        Criterion("in_vain", "grasps less often in vain", False, difference(lambda o: o.in_vain)),
        Criterion("failures", "has fewer failures", False, difference(lambda o: o.failures)),
        Criterion("seconds_a_pick", "picks faster", False, difference(lambda o: o.seconds_a_pick)),
    )
    adjusted = holm([criterion.difference.p_value for criterion in found])
    return tuple(replace(c, adjusted=p_value) for c, p_value in zip(found, adjusted, strict=True))


def _goal(a: Rate, b: Rate, table: Paired | None) -> MeanDifference:
    interval: Interval
    if table is not None:
        interval, p_value = difference_of_paired_rates(table), table.p_value
    else:
        interval, p_value = difference_of_rates(a, b), equal_rates_p(a, b)
    return MeanDifference(a.share, b.share, interval, p_value, min(a.total, b.total))


def _causes(
    a: Iterable[JobOutcome],
    b: Iterable[JobOutcome],
    difference: Callable[[Callable[[JobOutcome], float | None]], MeanDifference],
) -> tuple[CauseChange, ...]:
    names = sorted({cause for outcome in (*a, *b) for cause in outcome.causes})
    found = [difference(lambda outcome, cause=cause: outcome.causes.get(cause, 0)) for cause in names]
    adjusted = holm([each.p_value for each in found])
    changes = [CauseChange(*each) for each in zip(names, found, adjusted, strict=True)]
    return tuple(sorted(changes, key=lambda c: (c.difference.p_value, -abs(c.difference.mean), c.cause)))


def _changed(x: JobOutcome, y: JobOutcome, a: RecipeOutcomes, b: RecipeOutcomes) -> ChangedSeed:
    folders = [
        str((recipe.folder / o.folder).absolute()) if o.folder else "" for recipe, o in ((a, x), (b, y))
    ]
    sides: tuple[Side, Side] = ("A", "B")
    return ChangedSeed(
        x.seed,
        "A" if x.success else "B",
        (folders[0], folders[1]) if all(folders) else None,
        tuple(side for side, folder in zip(sides, folders, strict=True) if not folder),
    )


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]
