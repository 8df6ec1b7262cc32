"""Shares and rates of events with their intervals, without scipy: a run's summary needs them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Interval:
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Rate:
    """`successes` of `total`, with Wilson's 95 % interval for the share."""

    successes: int
    total: int
    interval: Interval

    @property
    def share(self) -> float | None:
        """Share of successes; None for a total of 0."""
        return self.successes / self.total if self.total else None

    def __str__(self) -> str:
        if not self.total:
            return "0 of 0"
        low, high = 100 * self.interval.low, 100 * self.interval.high
        share = 100 * self.successes / self.total
        return f"{self.successes} of {self.total} ({share:.1f} %, {low:.1f} … {high:.1f} %)"


def rate(successes: int, total: int) -> Rate:
    """Return the rate with Wilson's score interval (Wilson 1927, without continuity correction).

    >>> print(rate(480, 480))
    480 of 480 (100.0 %, 99.2 … 100.0 %)
    """
    if total == 0:
        return Rate(0, 0, Interval(0.0, 1.0))
    share, z = successes / total, NormalDist().inv_cdf((1 + CONFIDENCE) / 2)
    middle = (2 * successes + z**2) / (2 * (total + z**2))
    half = z * math.sqrt(4 * successes * (1 - share) + z**2) / (2 * (total + z**2))
    low = middle - half if successes else 0.0
    high = middle + half if successes < total else 1.0
    return Rate(successes, total, Interval(low, high))


def poisson_interval(events: int) -> Interval:
    """Return the exact interval of the mean of a Poisson count (Garwood 1936).

    Its limits are half the quantiles of χ² with 2n and 2n + 2 degrees of freedom.

    >>> found = poisson_interval(4)
    >>> f"{found.low:.2f} … {found.high:.2f}"
    '1.09 … 10.24'
    """
    tail = (1 - CONFIDENCE) / 2
    low = _gamma_quantile(events, tail) if events else 0.0
    return Interval(low, _gamma_quantile(events + 1, 1 - tail))


def _gamma_quantile(shape: int, probability: float) -> float:
    """Return x with P(shape, x) = probability, by bisection; P is the lower regularised gamma function."""
    low, high = 0.0, shape + 10.0 * math.sqrt(shape) + 10.0
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if _lower_gamma(shape, middle) < probability else (low, middle)
    return (low + high) / 2


def _lower_gamma(shape: int, x: float) -> float:
    """Return P(shape, x): the series below its mean, else the continued fraction (Lentz) of 1 − P."""
    if x <= 0.0:
        return 0.0
    front = math.exp(shape * math.log(x) - x - math.lgamma(shape))
    if x < shape + 1.0:
        term = total = 1.0 / shape
        n = shape
        while term > 1e-16 * total:
            n += 1
            term *= x / n
            total += term
        return front * total
    b = x + 1.0 - shape
    c, d = 1e300, 1.0 / b
    fraction, step, i = d, 0.0, 0
    while abs(step - 1.0) > 1e-15 and i < 10_000:
        i += 1
        a = i * (shape - i)
        b += 2.0
        d = 1.0 / (a * d + b)
        c = b + a / c
        step = c * d
        fraction *= step
    return 1.0 - front * fraction
