"""Differences of two recipes in a number that each job has: mean, bootstrap interval, permutation test."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from .rates import CONFIDENCE, Interval

_RESAMPLES = 9999
_SEED = 0
"""Of the resampling: the same numbers give the same interval and the same p value."""
_Numbers: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Difference:
    """Mean of B less that of A."""

    a: float | None
    """Mean; None of nothing."""
    b: float | None
    interval: Interval
    """Bootstrap, BCa, 95 %. Infinite when there is too little to tell one."""
    p_value: float
    """Two-sided, of a permutation test: exact where few jobs differ, else by resampling."""
    count: int
    """Pairs; or jobs of the side that has fewer."""

    @property
    def mean(self) -> float:
        return self.b - self.a if self.a is not None and self.b is not None else 0.0


def paired_difference(pairs: Sequence[tuple[float, float]]) -> Difference:
    """Of values of A and B for the same seed.

    The test swaps A and B within pairs, which changes nothing when both are one recipe. Pairs that are equal
    do not count for it.
    """
    if not pairs:
        return Difference(None, None, Interval(-math.inf, math.inf), 1.0, 0)
    values = np.array(pairs, dtype=float)
    apart = values[:, 1] - values[:, 0]
    changed = apart[apart != 0.0]
    p_value = 1.0
    if len(changed) > 1:
        p_value = _p_value((changed,), _mean, "samples")
    mean_a, mean_b = (float(mean) for mean in values.mean(axis=0))
    interval = _interval((apart,), _mean)
    return Difference(mean_a, mean_b, interval, p_value, len(pairs))


def unpaired_difference(a: Sequence[float], b: Sequence[float]) -> Difference:
    """Of values of independent jobs. The test hands the jobs out to A and B anew."""
    one, other = np.array(a, dtype=float), np.array(b, dtype=float)
    mean_a = float(one.mean()) if len(one) else None
    mean_b = float(other.mean()) if len(other) else None
    count = min(len(one), len(other))
    if not count:
        return Difference(mean_a, mean_b, Interval(-math.inf, math.inf), 1.0, 0)
    p_value = 1.0
    if len({*one.tolist(), *other.tolist()}) > 1:
        p_value = _p_value((one, other), _apart, "independent")
    return Difference(mean_a, mean_b, _interval((one, other), _apart), p_value, count)


def _mean(values: _Numbers, axis: int = -1) -> Any:
    return np.mean(values, axis=axis)


def _apart(a: _Numbers, b: _Numbers, axis: int = -1) -> Any:
    return np.mean(b, axis=axis) - np.mean(a, axis=axis)


def _p_value(data: tuple[_Numbers, ...], statistic: Callable[..., Any], kind: str) -> float:
    found = stats.permutation_test(
        data,
        statistic,
        permutation_type=kind,
        vectorized=True,
        n_resamples=_RESAMPLES,
        rng=np.random.default_rng(_SEED),
    )
    return min(float(found.pvalue), 1.0)


def _interval(data: tuple[_Numbers, ...], statistic: Callable[..., Any]) -> Interval:
    if min(map(len, data)) < 2:
        return Interval(-math.inf, math.inf)
    if all(np.all(values == values[0]) for values in data):
        mean = float(statistic(*data))
        return Interval(mean, mean)
    for method in ("BCa", "percentile"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", stats.DegenerateDataWarning)  # then the plainer method is taken
            found = stats.bootstrap(
                data,
                statistic,
                confidence_level=CONFIDENCE,
                n_resamples=_RESAMPLES,
                method=method,
                vectorized=True,
                rng=np.random.default_rng(_SEED),
            ).confidence_interval
        if math.isfinite(found.low) and math.isfinite(found.high):
            return Interval(float(found.low), float(found.high))
    return Interval(-math.inf, math.inf)
