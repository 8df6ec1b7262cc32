"""Anytime-valid tests and confidence sequences: they hold however often one looks, and whenever one stops.

A bet on each result multiplies a capital, which grows without limit only when the hypothesis is false. It
ever exceeds 1 / α with a probability of α at most (Ville 1939; Waudby-Smith and Ramdas 2023).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from picktree.logs import CONFIDENCE, Interval

from .plan import DEFAULT_MARGIN, Question
from .rates import SIGNIFICANCE_LEVEL

Verdict: TypeAlias = Literal["A", "B", "equal", "open"]
"""Better side, `equal` within the margin, or `open`: more seeds may decide."""
_GRID = 1001
"""Number of means that the confidence sequence of a mean tests."""


def sign_evidence(only_a: int, only_b: int) -> float:
    """Return the e-value against equal recipes, by the seeds at which only A, or only B, did better.

    Under equality each of these seeds is a fair coin. The e-value mixes the bets on all other coins evenly:
    2ⁿ B(a + 1, b + 1).
    """
    n = only_a + only_b
    log_beta = math.lgamma(only_a + 1) + math.lgamma(only_b + 1) - math.lgamma(n + 2)
    return math.exp(min(n * math.log(2) + log_beta, 700.0))


def rate_sequence(successes: int, total: int, level: float = 1 - CONFIDENCE) -> Interval:
    """Return the confidence sequence of a share at this time: it holds at all times together.

    It has the shares against which the evenly mixed bet has won less than 1 / `level` (Robbins 1970).

    >>> found = rate_sequence(9, 10)
    >>> f"{found.low:.2f} … {found.high:.2f}"
    '0.45 … 1.00'
    """
    failures = total - successes
    log_beta = math.lgamma(successes + 1) + math.lgamma(failures + 1) - math.lgamma(total + 2)

    def excluded(share: float) -> bool:
        won = log_beta
        for count, probability in ((successes, share), (failures, 1 - share)):
            if count:
                won -= count * math.log(max(probability, 1e-300))
        return won >= -math.log(level)

    best = successes / total if total else 0.5
    low = 0.0 if not excluded(0.0) else _border(excluded, 0.0, best)
    high = 1.0 if not excluded(1.0) else _border(excluded, 1.0, best)
    return Interval(low, high)


def _border(excluded: Callable[[float], bool], outside: float, inside: float) -> float:
    while abs(outside - inside) > 1e-9:
        middle = (outside + inside) / 2
        outside, inside = (middle, inside) if excluded(middle) else (outside, middle)
    return inside


class MeanSequence:
    """Confidence sequence of the mean of paired differences in −1 … 1, which come one by one.

    Hedged capital with predictable bets (Waudby-Smith and Ramdas 2023, theorem 3): a mean is out once a bet
    against it has won 1 / `level`, at this time or before.
    """

    def __init__(self, level: float = SIGNIFICANCE_LEVEL) -> None:
        self._level = level
        self._means = np.linspace(0.0, 1.0, _GRID)
        self._most = (0.5 / np.maximum(self._means, 1e-12), 0.5 / np.maximum(1 - self._means, 1e-12))
        self._kept = np.ones(_GRID, dtype=bool)
        self._up, self._down = np.zeros(_GRID), np.zeros(_GRID)
        self._count, self._total, self._squares = 0, 0.5, 0.25

    def add(self, difference: float) -> None:
        """Take the next difference."""
        value, n = (difference + 1) / 2, self._count + 1
        bet = math.sqrt(2 * math.log(2 / self._level) / (self._squares / n * n * math.log(n + 1)))
        apart = value - self._means
        self._up += np.log1p(np.minimum(bet, self._most[0]) * apart)
        self._down += np.log1p(-np.minimum(bet, self._most[1]) * apart)
        self._kept &= np.maximum(self._up, self._down) < math.log(2 / self._level)
        self._count, self._total = n, self._total + value
        self._squares += (value - self._total / (n + 1)) ** 2

    @property
    def interval(self) -> Interval:
        """Interval at this time; the sequence of all of them holds at once."""
        left = self._means[self._kept]
        if not len(left):  # none fits: the values drifted
            mean = 2 * self._total / (self._count + 1) - 1
            return Interval(mean, mean)
        step = 1 / (_GRID - 1)
        return Interval(max(2 * float(left[0] - step) - 1, -1.0), min(2 * float(left[-1] + step) - 1, 1.0))


@dataclass(frozen=True, slots=True)
class SequentialResult:
    """Result of a paired comparison that may be looked at, and stopped, at any time."""

    question: Question
    seeds: int
    """Number of compared seeds."""
    only_a: int
    """Number of seeds at which only A did better."""
    only_b: int
    e_value: float
    """Evidence against equal recipes: 20 decides at a level of 5 %."""
    interval: Interval
    """Confidence sequence. For `goal`: B's share minus A's. For `units`: the share of seeds at which B brings
    more units an hour, minus the share at which A does."""
    verdict: Verdict

    @property
    def p_value(self) -> float:
        """Anytime-valid p value."""
        return min(1.0, 1.0 / self.e_value)

    @property
    def decided(self) -> bool:
        return self.verdict != "open"

    def to_text(self, a: str = "A", b: str = "B") -> str:
        """Return the verdict with its evidence, in one line."""
        thing = "reaches the goal more often" if self.question == "goal" else "brings more units an hour"
        words = {
            "A": f"{a} {thing}",
            "B": f"{b} {thing}",
            "equal": "both are equal within the margin",
            "open": "not decided yet",
        }
        low, high = 100 * self.interval.low, 100 * self.interval.high
        counts = f"only {a} {self.only_a}, only {b} {self.only_b}"
        interval = f"e-value {self.e_value:.3g}, difference {low:+.1f} … {high:+.1f} %"
        return f"{words[self.verdict]} after {self.seeds} seeds: {counts}, {interval}"


class SequentialComparison:
    """Paired comparison of A and B that may be looked at after each seed; a verdict stays.

    The verdict is false with a probability of `level` at most, whenever one stops. For equal recipes that is
    the test of signs. Otherwise half of it is for the wrong side, which half of the bets favour, and half for
    a false equality. `margin`: difference within which both count as equal, 0 … 1.
    """

    def __init__(
        self,
        question: Question = "goal",
        margin: float = DEFAULT_MARGIN,
        level: float = SIGNIFICANCE_LEVEL,
    ) -> None:
        self._question: Question = question
        self._margin, self._level = margin, level
        self._seeds = self._only_a = self._only_b = 0
        self._mean = MeanSequence(level / 2)
        self.verdict: Verdict = "open"

    def add(self, a: float, b: float) -> None:
        """Take the results of the next seed; the order of the seeds was fixed before."""
        self._seeds += 1
        self._only_a += a > b
        self._only_b += b > a
        self._mean.add(float((b > a) - (a > b)))
        if self.verdict == "open":
            self.verdict = self._look()

    def _look(self) -> Verdict:
        if sign_evidence(self._only_a, self._only_b) >= 1 / self._level:
            return "A" if self._only_a > self._only_b else "B"
        found = self._mean.interval
        return "equal" if -self._margin < found.low and found.high < self._margin else "open"

    @property
    def result(self) -> SequentialResult:
        counts = (self._seeds, self._only_a, self._only_b)
        evidence = sign_evidence(self._only_a, self._only_b)
        return SequentialResult(self._question, *counts, evidence, self._mean.interval, self.verdict)


def compare_sequentially(
    pairs: Iterable[tuple[float, float]],
    question: Question = "goal",
    margin: float = DEFAULT_MARGIN,
    level: float = SIGNIFICANCE_LEVEL,
) -> SequentialResult:
    """Compare A and B by the pairs of their results on the same seeds, in an order that was fixed before."""
    comparison = SequentialComparison(question, margin, level)
    for a, b in pairs:
        comparison.add(a, b)
    return comparison.result
