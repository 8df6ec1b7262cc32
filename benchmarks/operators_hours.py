"""Operators' figures of a long run, period by period, as a table and a picture.

    python benchmarks/operators_hours.py runs/feed_from_totes-7-… -o hours.svg
    python benchmarks/operators_hours.py RUN --minutes 15 -o quarters.svg

Units and failures are those of the robot's belief, because the scorer judges at the end only.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from picktree.logs import ACTIVITIES, ACTIVITY_TEXTS, OperatorFigures, RunRecord, duration_text


def table(periods: Sequence[OperatorFigures]) -> str:
    """Return a line for each period."""
    lines = ["period  units an hour          first pass      failures  assists  time"]
    for number, figures in enumerate(periods, 1):
        hourly, first, total = figures.units_an_hour, figures.first_pass_yield, figures.total
        rate = f"{hourly.value or 0:.0f} ({hourly.low or 0:.0f} … {hourly.high or 0:.0f})"
        uses = ", ".join(
            f"{ACTIVITY_TEXTS[use]} {100 * (each.value or 0):.0f} %"
            for use, each in figures.utilisation.items()
        )
        passed = f"{first.successes} of {first.total}"
        lines.append(
            f"{number:>6}  {rate:<21}  {passed:<14}  {total.failures:>8}  {total.assisted:>7}  {uses}"
        )
    return "\n".join(lines)


def draw(periods: Sequence[OperatorFigures], period: float, path: Path) -> None:
    """Draw units an hour with intervals, failures and assists, and the use of the time, as SVG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 6), layout="constrained")
    above, middle, below = figure.subplots(3, 1, sharex=True, height_ratios=(2, 1, 2))
    numbers = list(range(1, len(periods) + 1))
    hourly = [each.units_an_hour for each in periods]
    values = [each.value or 0.0 for each in hourly]
    bars = [
        [value - (each.low or 0.0) for value, each in zip(values, hourly, strict=True)],
        [(each.high or 0.0) - value for value, each in zip(values, hourly, strict=True)],
    ]
    above.errorbar(numbers, values, yerr=bars, fmt="o", capsize=4)
    above.set(ylabel="units an hour", ylim=(0, None))
    middle.bar([n - 0.2 for n in numbers], [each.total.failures for each in periods], 0.4, label="failures")
    middle.bar([n + 0.2 for n in numbers], [each.total.assisted for each in periods], 0.4, label="assists")
    middle.set(ylabel="number")
    bottom = [0.0] * len(periods)
    for use in ACTIVITIES:
        shares = [100 * (f.utilisation[use].value or 0.0) if use in f.utilisation else 0.0 for f in periods]
        below.bar(numbers, shares, 0.8, bottom=bottom, label=ACTIVITY_TEXTS[use])
        bottom = [before + share for before, share in zip(bottom, shares, strict=True)]
    below.set(ylabel="time, %", xlabel=f"period of {duration_text(period)}, simulated", ylim=(0, 100))
    below.set_xticks(numbers)
    for axes in (middle, below):
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=5, fontsize="small", frameon=False)
    figure.savefig(str(path), format="svg", metadata={"Date": None})  # pyright: ignore[reportUnknownMemberType]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("run", help="log, run folder or `last`")
    parser.add_argument("--minutes", type=float, default=60.0, help="length of a period, simulated")
    parser.add_argument("-o", "--output", type=Path, required=True, help="SVG file")
    options = parser.parse_args()
    period = 60.0 * options.minutes
    with RunRecord(options.run) as run:
        periods = run.operator_figures_by(period)
    print(table(periods))
    draw(periods, period, options.output)


if __name__ == "__main__":
    main()
