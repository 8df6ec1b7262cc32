"""Rates with their intervals, and paired comparisons, as scipy computes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

CONFIDENCE = 0.95
_RESAMPLES = 9999
_SEED = 0
"""Of the bootstrap: the same numbers give the same interval."""


@dataclass(frozen=True, slots=True)
class Interval:
    low: float
    high: float

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True, slots=True)
class Rate:
    """`successes` of `total`, with Wilson's 95 % interval for the share."""

    successes: int
    total: int
    interval: Interval

    @property
    def share(self) -> float | None:
        """None of nothing."""
        return self.successes / self.total if self.total else None

    def __str__(self) -> str:
        if not self.total:
            return "0 of 0"
        low, high = 100 * self.interval.low, 100 * self.interval.high
        share = 100 * self.successes / self.total
        return f"{self.successes} of {self.total} ({share:.1f} %, {low:.1f} … {high:.1f} %)"


def rate(successes: int, total: int) -> Rate:
    """With Wilson's score interval (Wilson 1927, without continuity correction).

    >>> print(rate(480, 480))
    480 of 480 (100.0 %, 99.2 … 100.0 %)
    """
    if total == 0:
        return Rate(0, 0, Interval(0.0, 1.0))
    found = stats.binomtest(successes, total).proportion_ci(CONFIDENCE, method="wilson")
    return Rate(successes, total, Interval(float(found.low), float(found.high)))


@dataclass(frozen=True, slots=True)
class Paired:
    """Two recipes on the same seeds: how often each alone succeeded, and McNemar's exact test."""

    both: int
    only_a: int
    only_b: int
    neither: int
    p_value: float
    """Of the seeds that changed sides being split so by chance; two-sided."""

    @property
    def total(self) -> int:
        return self.both + self.only_a + self.only_b + self.neither


def paired(outcomes: Sequence[tuple[bool, bool]]) -> Paired:
    """`outcomes`: success of A and of B for each seed. Exact binomial form (McNemar 1947)."""
    only_a = sum(a and not b for a, b in outcomes)
    only_b = sum(b and not a for a, b in outcomes)
    changed = only_a + only_b
    p_value = float(stats.binomtest(only_a, changed).pvalue) if changed else 1.0
    return Paired(
        sum(a and b for a, b in outcomes), only_a, only_b, sum(not (a or b) for a, b in outcomes), p_value
    )


@dataclass(frozen=True, slots=True)
class Difference:
    """Mean of B − A over the same seeds, with its bootstrap interval (BCa, 95 %)."""

    mean: float
    interval: Interval
    pairs: int

    @property
    def clear(self) -> bool:
        """Whether the interval leaves out zero."""
        return 0.0 not in self.interval


def difference(pairs: Sequence[tuple[float, float]]) -> Difference:
    """Of values of A and B. Fewer than two pairs tell nothing: the interval is infinite then."""
    differences = np.array([b - a for a, b in pairs], dtype=float)
    mean = float(differences.mean()) if len(differences) else 0.0
    if len(differences) < 2:
        return Difference(mean, Interval(-np.inf, np.inf), len(differences))
    if np.all(differences == differences[0]):
        return Difference(mean, Interval(mean, mean), len(differences))
    found = stats.bootstrap(
        (differences,),
        np.mean,
        confidence_level=CONFIDENCE,
        n_resamples=_RESAMPLES,
        method="BCa",
        rng=np.random.default_rng(_SEED),
    ).confidence_interval
    return Difference(mean, Interval(float(found.low), float(found.high)), len(differences))
