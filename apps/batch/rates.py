"""Differences of rates with intervals, and tests of both.

scipy computes the tests. A rate alone does not load it: every batch has rates, and loading takes longer than
some of its jobs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from picktree.logs import Interval, Rate, rate

SIGNIFICANCE_LEVEL = 0.05
"""Significance level of a family of tests: its probability of a false finding."""
_MAX_BOSCHLOO_JOBS = 400
"""Maximum number of jobs of both sides for Boschloo's test; with more, Fisher's is faster and as good."""


@dataclass(frozen=True, slots=True)
class Paired:
    """Two recipes on the same seeds: successes of each alone, and McNemar's exact test."""

    both: int
    only_a: int
    only_b: int
    neither: int
    p_value: float
    """Two-sided p value: probability that chance splits the changed seeds so."""

    @property
    def total(self) -> int:
        return self.both + self.only_a + self.only_b + self.neither


def paired(outcomes: Sequence[tuple[bool, bool]]) -> Paired:
    """Compare paired outcomes, success of A and of B for each seed. Exact binomial form (McNemar 1947)."""
    from scipy import stats

    only_a = sum(a and not b for a, b in outcomes)
    only_b = sum(b and not a for a, b in outcomes)
    changed = only_a + only_b
    p_value = float(stats.binomtest(only_a, changed).pvalue) if changed else 1.0
    return Paired(
        sum(a and b for a, b in outcomes), only_a, only_b, sum(not (a or b) for a, b in outcomes), p_value
    )


def difference_of_paired_rates(table: Paired) -> Interval:
    """Return the interval of B's share minus A's over the same seeds (Newcombe 1998, paired data, method
    10)."""
    a, b, c, d = table.both, table.only_b, table.only_a, table.neither
    product = (a + b) * (c + d) * (a + c) * (b + d)
    excess = a * d - b * c
    if excess > 0:
        excess = max(excess - table.total / 2, 0)
    phi = excess / math.sqrt(product) if product else 0.0
    return _hybrid(rate(a + c, table.total), rate(a + b, table.total), phi)


def difference_of_rates(a: Rate, b: Rate) -> Interval:
    """Return the interval of B's share minus A's, for independent jobs (Newcombe 1998, method 10)."""
    return _hybrid(a, b, 0.0)


def equal_rates_p(a: Rate, b: Rate) -> float:
    """Return the two-sided p value that both shares are equal, for independent jobs.

    Boschloo's exact test; Fisher's for many jobs.
    """
    from scipy import stats

    if not a.total or not b.total:
        return 1.0
    table = [[a.successes, b.successes], [a.total - a.successes, b.total - b.successes]]
    if 0 in (a.successes + b.successes, sum(table[1])):
        return 1.0
    if a.total + b.total > _MAX_BOSCHLOO_JOBS:
        return float(stats.fisher_exact(table).pvalue)
    return min(float(stats.boschloo_exact(table).pvalue), 1.0)


def holm(p_values: Sequence[float]) -> tuple[float, ...]:
    """Return the adjusted p values of a family of tests (Holm 1979).

    The probability that any of them is below a level by chance alone is at most that level.

    >>> holm([0.01, 0.04, 0.03])
    (0.03, 0.06, 0.06)
    """
    adjusted = [0.0] * len(p_values)
    least = 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        least = max(least, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = least
    return tuple(adjusted)


def _hybrid(a: Rate, b: Rate, phi: float) -> Interval:
    """Combine both Wilson intervals; `phi` is the correlation of the outcomes."""
    if not a.total or not b.total:
        return Interval(-1.0, 1.0)
    share_a, share_b = a.successes / a.total, b.successes / b.total
    down_a, up_a = share_a - a.interval.low, a.interval.high - share_a
    down_b, up_b = share_b - b.interval.low, b.interval.high - share_b
    below = math.sqrt(max(down_b**2 - 2 * phi * down_b * up_a + up_a**2, 0.0))
    above = math.sqrt(max(up_b**2 - 2 * phi * up_b * down_a + down_a**2, 0.0))
    return Interval(share_b - share_a - below, share_b - share_a + above)
