"""Table of bin-to-bin picking in simulation, beside the published rows of PhAIL on a real arm.

    picktree batch run examples/plan_bin_to_bin.yaml --out runs/bin_to_bin
    python benchmarks/bin_to_bin.py runs/bin_to_bin                # as Markdown

Each run counts as one episode: eight things, 30 s for each. Completion is the share of things that were
moved. An episode that leaves things behind counts as one assist, because a person must come.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from picktree.apps.batch import Store
from picktree.apps.batch.store import RESULTS_FILE
from picktree.logs import FigureCounts, OperatorFigures, Rate, rate
from picktree.logs.operator_figures import Estimate

THINGS: Mapping[str, str] = {
    "bin_to_bin": "batteries",
    "bin_to_bin_spoons": "wooden spoons",
    "bin_to_bin_scissors": "scissors",
}
"""Kind of thing by scene."""
PUBLISHED = (
    ("a person's hands", "1,331", "100 %", "–"),
    ("a person who teleoperates the arm", "330", "100 %", "–"),
    ("OpenPI (π0.5)", "64", "48.5 %", "4.0 min"),
    ("GR00T N1.6", "60", "47.7 %", "3.9 min"),
    ("ACT", "44", "35.0 %", "3.6 min"),
    ("SmolVLA", "18", "10.8 %", "2.7 min"),
)
"""Rows of PhAIL on a Franka FR3, all kinds of things with towels: units an hour, completion, MTBF/A.

Source: Positronic Robotics, Introducing PhAIL, 31 March 2026; arXiv 2605.29710.
"""


def episodes(store: Store) -> Mapping[str, list[tuple[FigureCounts, int, int]]]:
    """Return counts, moved and all things of each episode, by scene."""
    counts, found = store.figures(), dict[str, list[tuple[FigureCounts, int, int]]]()
    for job in store.jobs():
        row = store.row(job.id)
        if row is not None and row.items_total is not None and job.id in counts:
            scene = Path(job.variant.scene or "bin_to_bin").stem
            found.setdefault(scene, []).append((counts[job.id], row.items_sorted or 0, row.items_total))
    return found


def figures(runs: Sequence[tuple[FigureCounts, int, int]]) -> tuple[OperatorFigures, Rate]:
    """Return the operators' figures of episodes, and the share of things that were moved.

    PhAIL counts by episodes: one that leaves things behind has one assist, and no other failure.
    """
    assisted = (
        replace(
            counts, set_aside=0, given_up=0, misplaced=0, crushed=0, assists={"answer": int(moved < total)}
        )
        for counts, moved, total in runs
    )
    moved, total = sum(moved for _, moved, _ in runs), sum(total for _, _, total in runs)
    return OperatorFigures(tuple(assisted)), rate(moved, total)


def lines(found: Mapping[str, list[tuple[FigureCounts, int, int]]]) -> Iterator[str]:
    yield "| | episodes | units an hour | completion | MTBF/A |"
    yield "|---|---|---|---|---|"
    groups = {name: found[scene] for scene, name in THINGS.items() if scene in found}
    together = [run for runs in groups.values() for run in runs]
    for name, runs in {**groups, "all three": together}.items():
        of, done = figures(runs)
        hourly = _estimate(of.units_an_hour, 1.0, "")
        low, high = 100 * done.interval.low, 100 * done.interval.high
        share = f"{100 * (done.share or 0.0):.1f} % ({low:.1f} … {high:.1f})"
        between = _estimate(of.mtbf_a, 60.0, " min")
        yield f"| picktree **in simulation**, {name} | {len(runs)} | {hourly} | {share} | {between} |"
    for name, hourly, completion, between in PUBLISHED:
        yield f"| PhAIL on a real arm, {name} | | {hourly} | {completion} | {between} |"


def _estimate(found: Estimate, unit: float, text: str) -> str:
    digits = 0 if unit == 1.0 else 1
    if found.value is None or found.low is None or found.high is None:
        return f"at least {(found.low or 0.0) / unit:.{digits}f}{text}"
    low, high = found.low / unit, found.high / unit
    return f"{found.value / unit:.{digits}f}{text} ({low:.{digits}f} … {high:.{digits}f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of the batch")
    with Store(parser.parse_args().folder / RESULTS_FILE) as store:
        print("\n".join(lines(episodes(store))))


if __name__ == "__main__":
    main()
