"""Report of a soak: what its diary amounts to, in words and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from _campaign import rate
from _soaking import HOUR, SETTLED, Soak, growth, steadiness

import numpy as np

if TYPE_CHECKING:
    from picktree.logs import RunResult


def report(path: Path, hours: float) -> int:
    """Print what a diary of so many hours amounts to. 1 when a target is missed, or it was cut off."""
    told = Soak.read(path)
    missed: list[str] = []
    if not told.minutes:
        print("not a minute was finished" + (f": {told.crash}" if told.crash else ""))
        return 1
    last = told.minutes[-1]
    spent = sum({minute.part: minute.cpu for minute in told.minutes}.values())
    print(f"simulated      {last.time / 3600:.2f} h in {spent:.0f} CPU s, {last.part} process(es)")
    print(f"items          {last.items} done of {last.came} that came")
    if told.result is not None:
        _print_result(told.result)
    else:
        why = told.crash or f"{last.time / 3600:.2f} of {hours:g} hours are done"
        missed.append(f"the run came to no end: {why}")
    grown = growth(told.minutes)
    if grown is None:
        print(f"memory         {told.minutes[0].memory:.1f} … {last.memory:.1f} MB; too short to tell growth")
    else:
        print(
            f"memory         {grown.first:.1f} MB after {SETTLED / 60:.0f} min, {grown.last:.1f} at the end: "
            f"{100 * grown.share:+.1f} %; at most {grown.most:.1f} MB; by least squares "
            f"{grown.an_hour:+.2f} MB an hour, {grown.an_item:+.2f} kB an item "
            f"({grown.heap_an_item:+.2f} of the heap in use)"
        )
        if grown.share >= 0.03:
            missed.append("memory grows by 3 % or more after the first half hour")
    if (steady := steadiness(told)) is not None:
        (early, late), (p999, p999_late) = steady.memory, steady.p999
        more, slower = late / early - 1, p999_late / p999 - 1
        print(f"first hour against last: memory of the longest process {early:.1f} → {late:.1f} MB ", end="")
        print(f"({100 * more:+.1f} %), 99.9 % of ticks {p999:.0f} → {p999_late:.0f} ms ", end="")
        print(f"({100 * slower:+.1f} %)\n")
        print(rate("minutes with memory at most 3 % above the first hour's", *steady.minutes))
        print(rate("quarters of an hour with ticks at most 10 % above", *steady.quarters))
        if more > 0.03:
            missed.append("memory is more than 3 % higher in the last hour than in the first")
        if slower > 0.1:
            missed.append("the 99.9th percentile of ticks is more than 10 % higher in the last hour")
    print(rate("items done of those that came", last.items, last.came) + "\n")
    if told.quarters:
        _print_ticks(told)
    missed += _print_opened(told)
    for words in missed:
        print(f"MISSED: {words}")
    return 1 if missed else 0


def _print_result(result: RunResult) -> None:
    items, picks, feed = result.items, result.picks, result.feed
    print(f"ended          {result.status}{': ' + result.message if result.message else ''}")
    print(f"scored         sorted {items.sorted}, misplaced {items.misplaced}, left {items.left}")
    print(f"grasps         {picks.held} of {picks.tried} held")
    if feed is not None:
        print(
            f"feed           {feed.deliveries} loads, {feed.exchanges} bins exchanged, "
            f"{feed.set_aside} items set aside"
        )
    for name, counts in (("failures", result.failures), ("recoveries", result.recoveries)):
        most = sorted(counts.items(), key=lambda each: -each[1])
        print(f"{name:<14} " + (", ".join(f"{cause} {n}" for cause, n in most) or "none"))


def _print_ticks(told: Soak) -> None:
    print("CPU of a tick  by quarter of an hour, ms: median, 95 %, 99.9 %, mean")
    for each in told.quarters:
        print(
            f"  until {each.time / 60:5.0f} min  {each.median:7.2f} {each.p95:8.2f} {each.p999:8.2f} "
            f"{each.mean:8.2f}"
        )
    later = [quarter for quarter in told.quarters if quarter.time > SETTLED]
    if len(later) >= 4:
        half = len(later) // 2
        for name in ("median", "p95", "p999", "mean"):
            early = np.median([getattr(each, name) for each in later[:half]])
            late = np.median([getattr(each, name) for each in later[half:]])
            print(
                f"  {name}: second half against the first, after {SETTLED / 60:.0f} min: × {late / early:.3f}"
            )


def _print_opened(told: Soak) -> list[str]:
    """Print what was found of the log, and return what was wrong with it."""
    files, size = sum(each.files for each in told.opened), sum(each.size for each in told.opened)
    drawn, whole = sum(each.drawn for each in told.opened), sum(each.whole for each in told.opened)
    print(f"log            {size:.0f} MB in {files} files")
    print(rate("files that open by themselves", whole, drawn) + "\n")
    return [fault for each in told.opened for fault in each.faults]


def draw(soak: Soak, path: Path) -> None:
    """Draw memory and CPU time of a tick over the simulated hours, as SVG."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullLocator, ScalarFormatter

    figure = Figure(figsize=(8, 5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    hours = [minute.time / HOUR for minute in soak.minutes]
    above.plot(hours, [minute.memory for minute in soak.minutes], label="resident")
    above.plot(hours, [minute.heap for minute in soak.minutes], label="heap in use")
    above.set(ylabel="memory, MB", ylim=(0, None))
    hours = [each.time / HOUR for each in soak.quarters]
    for name, label in (("p999", "99.9 %"), ("p95", "95 %"), ("mean", "mean"), ("median", "median")):
        below.plot(hours, [getattr(each, name) for each in soak.quarters], marker=".", label=label)
    below.set(xlabel="simulated hours", ylabel="CPU of a tick, ms", yscale="log")
    below.yaxis.set_major_formatter(ScalarFormatter())
    below.yaxis.set_minor_locator(NullLocator())
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.legend(loc="best", ncols=4, fontsize="small")
    for part in {minute.part for minute in soak.minutes} - {1}:
        begin = min(minute.time for minute in soak.minutes if minute.part == part) / HOUR
        above.axvline(begin, color="grey", linewidth=0.8)
        below.axvline(begin, color="grey", linewidth=0.8)
    figure.savefig(str(path), format="svg", metadata={"Date": None})  # pyright: ignore[reportUnknownMemberType]
