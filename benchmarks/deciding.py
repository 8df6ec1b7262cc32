"""False decisions and saved runs of comparisons that end when they may, resampled from recorded jobs.

    python benchmarks/deciding.py runs/grip@1.5 runs/grip@30          # two recipes of a batch, or of two
    python benchmarks/deciding.py A B --comparisons 1000 --seeds 400 --by units

Pairs of jobs with the same seed are drawn with replacement. For equal recipes the sides of each drawn pair
are swapped at random. The fixed number of seeds is the least at which the exact test of McNemar (5 %) finds
the better recipe in 90 % and in 99 % of comparisons. It can be chosen only by one who knows the effect.
"""

from __future__ import annotations

import argparse
from statistics import fmean, median

from picktree.apps.batch import read_recipe
from picktree.apps.batch.comparison import JobOutcome
from picktree.apps.batch.plan import DEFAULT_MARGIN, Question
from picktree.apps.batch.sequential_tests import SequentialComparison, Verdict
from picktree.logs import rate

import numpy as np
from numpy.typing import NDArray

POWERS = (0.9, 0.99)
"""Shares of comparisons in which a fixed number of seeds finds the better recipe."""
Pairs = NDArray[np.float64]


def recorded_pairs(a: str, b: str, by: Question) -> Pairs:
    """Return the results of A and B (n, 2) on the seeds that both have."""
    one, other = read_recipe(a).outcomes, read_recipe(b).outcomes

    def value(outcome: JobOutcome) -> float:
        if by == "goal":
            return float(outcome.success)
        return 3600.0 * (outcome.items_sorted or 0) / outcome.sim_seconds if outcome.sim_seconds else 0.0

    return np.array([(value(one[seed]), value(other[seed])) for seed in sorted(set(one) & set(other))])


def drawn(pairs: Pairs, seeds: int, rng: np.random.Generator, *, equal: bool) -> Pairs:
    """Return drawn pairs (seeds, 2); `equal`: with their sides swapped at random."""
    sample = pairs[rng.integers(len(pairs), size=seeds)]
    if equal:
        swapped = rng.random(seeds) < 0.5
        sample = np.where(swapped[:, None], sample[:, ::-1], sample)
    return sample


def decide(sample: Pairs, by: Question, margin: float) -> tuple[Verdict, int]:
    """Return the verdict, and the number of seeds that it took; all of them when it stays open."""
    comparison = SequentialComparison(by, margin)
    for n, (a, b) in enumerate(sample.tolist(), 1):
        comparison.add(a, b)
        if comparison.verdict != "open":
            return comparison.verdict, n
    return "open", len(sample)


def mcnemar_power(pairs: Pairs, seeds: int, comparisons: int, rng: np.random.Generator) -> float:
    """Return the share of drawn comparisons that the exact test of McNemar decides for the better side."""
    from scipy import stats

    lead = float(np.sign(pairs[:, 1] - pairs[:, 0]).sum())
    found = 0
    for _ in range(comparisons):
        signs = np.sign(np.diff(drawn(pairs, seeds, rng, equal=False), axis=1)) * np.sign(lead)
        won, lost = int((signs > 0).sum()), int((signs < 0).sum())
        found += won > lost and stats.binomtest(won, won + lost).pvalue < 0.05
    return found / comparisons


def fixed_number(pairs: Pairs, power: float, most: int, rng: np.random.Generator) -> int | None:
    """Return the least number of seeds, in steps of 5, with the power; None: more than `most`."""
    for seeds in range(5, most + 1, 5):
        if mcnemar_power(pairs, seeds, 400, rng) >= power:
            return seeds
    return None


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("a")
    parser.add_argument("b")
    parser.add_argument("--comparisons", type=int, default=1000)
    parser.add_argument("--seeds", type=int, default=400)
    parser.add_argument("--by", choices=("goal", "units"), default="goal")
    parser.add_argument("--margin", type=float, default=DEFAULT_MARGIN)
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    pairs = recorded_pairs(options.a, options.b, options.by)
    lead = float(np.sign(pairs[:, 1] - pairs[:, 0]).sum())
    print(f"{len(pairs)} recorded seeds; {options.comparisons} comparisons of up to {options.seeds} seeds")
    for equal in (True, False):
        ends = [
            decide(drawn(pairs, options.seeds, rng, equal=equal), options.by, options.margin)
            for _ in range(options.comparisons)
        ]
        true: tuple[Verdict, ...] = ("equal",) if equal else ("B",) if lead > 0 else ("A",)
        false = sum(verdict not in (*true, "open") for verdict, _ in ends)
        seeds = [n for _, n in ends]
        print("equal recipes" if equal else "recipes as recorded")
        print(f"  false decisions  {rate(false, len(ends))}")
        print(f"  decided          {rate(sum(verdict != 'open' for verdict, _ in ends), len(ends))}")
        print(f"  seeds            mean {fmean(seeds):.1f}, median {median(seeds):.0f}")
        for power in () if equal else POWERS:
            fixed = fixed_number(pairs, power, 4 * options.seeds, rng)
            if fixed is not None:
                saved = 100 * (1 - fmean(seeds) / fixed)
                print(f"  fixed number     {fixed} seeds for a power of {power:.0%}; {saved:.0f} % saved")


if __name__ == "__main__":
    main()
