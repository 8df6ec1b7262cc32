"""Campaign: does `batch compare` find a recipe that was made worse, and nothing where there is nothing?

    python benchmarks/regressions.py                 # everything; goes on where it stopped
    python benchmarks/regressions.py --part synthetic --tries 2000
    python benchmarks/regressions.py --part null --independent

planted    a grip force of 1.5 N, and depth noise three times as large, each against the recipe as it is, with
           --runs seeds: paired by seed, and as independent runs on other seeds
null       the recipe against itself, --splits times on disjoint seeds: a pool of --pool runs is dealt out
           anew each time, without replacement, into --runs and --runs. The tries share runs, so they are
           not independent of each other; --independent runs other seeds for each side of each try instead
synthetic  made-up jobs, --tries times, of one recipe against itself: how often the tests see a difference
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from _campaign import ROOT, rate
from picktree.apps.batch import (
    RESULTS_FILE,
    Batch,
    BatchPlan,
    LocalExecutor,
    RecipeComparison,
    compare_recipes,
    read_recipe,
    text_of,
)
from picktree.apps.batch.comparison import JobOutcome, RecipeOutcomes
from picktree.apps.cli.batch_progress import progress

import numpy as np

MISSION = ROOT / "examples" / "sort_by_colour.yaml"
NOISY = """\
picktree: 1
kind: scene
base: three_bins
cameras:
  overhead: {depth_noise: 6 mm}    # three times that of three_bins
"""
COST_A_RUN = 12.0
"""CPU seconds that a run of twelve items takes, for the forecast."""
COST_A_TRY = 0.3
"""CPU seconds of one comparison of 40 and 40 jobs."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", choices=("planted", "null", "synthetic", "all"), default="all")
    parser.add_argument("--runs", type=int, default=40, help="seeds of each side")
    parser.add_argument("--pool", type=int, default=200, help="runs that are dealt out")
    parser.add_argument("--splits", type=int, default=20, help="tries of the recipe against itself")
    parser.add_argument("--tries", type=int, default=1000, help="made-up ones")
    parser.add_argument("--independent", action="store_true", help="other seeds for each side of each try")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--folder", type=Path, default=ROOT / "runs" / "regressions")
    given = parser.parse_args()
    parts = ("planted", "null", "synthetic") if given.part == "all" else (given.part,)
    seeds = _seeds(given) if "null" in parts else 2 * given.runs
    runs = (seeds if "planted" in parts or "null" in parts else 0) + (
        2 * given.runs if "planted" in parts else 0
    )
    cpu = runs * COST_A_RUN + COST_A_TRY * (4 * given.tries if "synthetic" in parts else 0)
    print(
        f"{runs} runs and {given.tries if 'synthetic' in parts else 0} made-up tries, about "
        f"{cpu / 60:.0f} CPU minutes without what {given.folder} holds already; {given.workers} workers",
        flush=True,
    )
    if "planted" in parts:
        planted(given, seeds)
    if "null" in parts:
        null(given, seeds)
    if "synthetic" in parts:
        synthetic(given.tries, given.runs)


def planted(given: argparse.Namespace, seeds: int) -> None:
    as_is = _done(given, "as-is", seeds)
    given.folder.mkdir(parents=True, exist_ok=True)
    (given.folder / "three_bins_noisy.yaml").write_text(NOISY)
    scene = str((given.folder / "three_bins_noisy.yaml").absolute())
    worse = {
        "grip force 1.5 N": _done(given, "weak", given.runs, settings={"Grasp.force": ("1.5 N",)}),
        "depth noise × 3": _done(given, "noisy", given.runs, scenes=(scene,)),
    }
    same, others = _part(as_is, range(given.runs)), _part(as_is, range(given.runs, 2 * given.runs))
    for name, recipe in worse.items():
        for how, base in (("paired by seed", same), ("on other seeds", others)):
            found = compare_recipes(base, recipe)
            print(f"\n== {name}, {given.runs} seeds, {how}: {'FOUND' if found.differ else 'not found'}")
            print(text_of(found))


def null(given: argparse.Namespace, seeds: int) -> None:
    pool = _done(given, "as-is", seeds)
    sample = np.random.default_rng(0)
    order, runs = list(range(seeds)), given.runs
    seen: list[tuple[int, RecipeComparison]] = []
    for number in range(given.splits):
        if given.independent:
            first = 2 * runs * number
        else:
            first, order = 0, sample.permutation(seeds).tolist()
        a, b = order[first : first + runs], order[first + runs : first + 2 * runs]
        found = compare_recipes(_part(pool, a), _part(pool, b))
        assert found.paired is None and found.shared == 0
        if found.differ:
            seen.append((number, found))
    how = "other seeds for each" if given.independent else f"dealt out of a pool of {seeds} runs"
    print(f"\n== one recipe on disjoint seeds, {runs} and {runs} runs, {how}")
    print(rate("tries that see nothing", given.splits - len(seen), given.splits))
    for number, found in seen:
        print(f"  try {number}: {'; '.join(f'{c.better} {c.words}' for c in found.criteria if c.better)}")


def synthetic(tries: int, runs: int) -> None:
    print(f"\n== made-up jobs of one recipe, {runs} and {runs} of them: how often a difference is seen")
    cases: tuple[tuple[str, float, bool], ...] = (
        ("goal 60 %, disjoint seeds", 0.040, False),
        ("goal 95 %, disjoint seeds", 0.004, False),
        ("goal 60 %, paired", 0.040, True),
        ("goal 95 %, paired", 0.004, True),
    )
    for name, hard, by_seed in cases:
        sample = np.random.default_rng(1)
        wrong = goal = 0
        for _ in range(tries):
            difficulty = sample.gamma(4.0, 0.25, runs)
            a = _made_up(range(runs), difficulty * hard, sample)
            if not by_seed:
                difficulty = sample.gamma(4.0, 0.25, runs)
            b = _made_up(range(runs) if by_seed else range(runs, 2 * runs), difficulty * hard, sample)
            found = compare_recipes(a, b)
            wrong += found.differ
            goal += next(c for c in found.criteria if c.name == "goal").difference.p_value < 0.05
        print(rate(name, wrong, tries), flush=True)
        print(rate("  the goal's test by itself", goal, tries), flush=True)


def _made_up(seeds: range, hard: np.ndarray, sample: np.random.Generator) -> RecipeOutcomes:
    """Jobs of twelve items; `hard`: how probable it is on that seed that an item is missed. What is counted
    of a job hangs together, as in real runs."""
    outcomes: dict[int, JobOutcome] = {}
    for seed, share in zip(seeds, hard, strict=True):
        missed = int(sample.binomial(12, min(share, 1.0)))
        slipped = int(sample.poisson(20 * share)) + 2 * missed
        seconds = 48.0 + float(sample.gamma(2.0, 2.0)) + 7.0 * slipped
        causes = {"grasp.slipped": slipped} if slipped else {}
        tried = 12 + slipped
        outcomes[seed] = JobOutcome(
            str(seed), seed, not missed, 12 - missed, tried, tried, seconds, "", causes
        )
    return RecipeOutcomes("made up", Path(), outcomes)


def _seeds(given: argparse.Namespace) -> int:
    """Of the recipe as it is."""
    if given.independent:
        return 2 * given.runs * given.splits
    return max(given.pool, 2 * given.runs)


def _done(given: argparse.Namespace, name: str, seeds: int, **changes: object) -> RecipeOutcomes:
    """The recipe's batch, run as far as it was not."""
    folder = given.folder / (name if name != "as-is" else f"as-is-{seeds}")
    if (folder / RESULTS_FILE).exists():
        made = Batch.resume(folder)
    else:
        plan = BatchPlan(name, (MISSION,), tuple(range(seeds)), keep="none", **changes)  # type: ignore[arg-type]
        made = Batch.create(folder, plan)
    with made as batch, LocalExecutor(given.workers) as executor, progress(folder, None) as seen:
        batch.run(executor, seen)
    return read_recipe(str(folder))


def _part(recipe: RecipeOutcomes, seeds: range | list[int]) -> RecipeOutcomes:
    return RecipeOutcomes(recipe.label, recipe.folder, {seed: recipe.outcomes[seed] for seed in seeds})


if __name__ == "__main__":
    main()
