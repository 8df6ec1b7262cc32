"""Soak: sort on and on with random faults, in one process. Do memory and the time of a tick stay where they
are, and does each file of the log open by itself?

    python benchmarks/soak.py                              # 24 simulated hours
    python benchmarks/soak.py --runs 0.3 --backend kinematic
    python benchmarks/soak.py --minutes 30                 # half an hour of them
    python benchmarks/soak.py --report                     # what it has told so far

It goes on from its last checkpoint, in a process of its own each time, until the hours are full. When a file
that it depended on has changed, it begins anew.

A feed that never ends brings items, full bins are exchanged, and faults come as benchmarks/soak/faults.yaml
draws them. Each simulated minute is a line in the soak's diary: resident memory, items; each quarter of an
hour the CPU time of its ticks. A soak that is cut off has told what it knew.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from _campaign import REFERENCE_COST, RESULTS, ROOT, rate, reference
from _dependencies import Dependencies, opened, used
from _soaking import SETTLED, Diary, Soak, draw, growth, steadiness

import numpy as np

if TYPE_CHECKING:
    from picktree.logs.run_result import RunResult

HERE = ROOT / "benchmarks" / "soak"
COST_AN_HOUR = 750.0
"""CPU seconds that a simulated hour takes in physics, for the forecast."""
MB_AN_HOUR = 250.0
"""Size of the log of a simulated hour, MB."""
OVERTIME = 1800.0
"""Simulated s after which a mission that does not end when it should is ended."""
PARTS = 6
"""Files of the log that are opened by themselves, drawn at random."""


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--runs", type=float, default=24.0, metavar="H", help="simulated hours; 24 unless given"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--mission", type=Path, default=HERE / "sort_on.yaml")
    parser.add_argument("--scene", default=str(HERE / "endless.yaml"))
    parser.add_argument("--faults", default=str(HERE / "faults.yaml"), help="none for no faults")
    parser.add_argument("--backend", choices=("physics", "kinematic"), default="physics")
    parser.add_argument("--out", type=Path, default=RESULTS / "soak")
    parser.add_argument("--parts", type=int, default=PARTS, help="files of the log to open; 0 for all")
    parser.add_argument("--minutes", type=float, metavar="M", help="wall time after which this part ends")
    parser.add_argument("--report", action="store_true", help="only say what the soak in --out has told")
    parser.add_argument("--picture", type=Path, metavar="SVG", help="draw memory and ticks over the hours")
    given = parser.parse_args()
    diary, dependencies = given.out / "diary.jsonl", Dependencies(given.out)
    if diary.exists() and dependencies.changed and not given.report:
        diary.rename(diary.with_stem(f"diary-{diary.stat().st_mtime:.0f}"))
        dependencies.clear()
    if not given.report and not (diary.exists() and Soak.read(diary).result):
        with opened() as files:
            soak(given, diary, lambda: dependencies.add(used(files)))
    if not diary.exists():
        print(f"{diary}: there is no soak", file=sys.stderr)
        return 2
    if given.picture and Soak.read(diary).quarters:
        draw(Soak.read(diary), given.picture)
    return report(diary, given.parts, given.runs)


def soak(given: argparse.Namespace, diary: Path, each_quarter: Callable[[], object]) -> None:
    from picktree.logs.recording.rotated_log import FEED_ROTATION
    from picktree.session.resume.resumption import ResumeRequest, Resumption
    from picktree.session.session import RunRequest, Session

    cost = given.runs * COST_AN_HOUR * reference() / REFERENCE_COST
    print(
        f"{given.runs:g} simulated hours on the {given.backend} backend: about "
        f"{cost / 60:.0f} CPU minutes and {given.runs * MB_AN_HOUR:.0f} MB of log; "
        f"one process; diary in {diary}",
        file=sys.stderr,
        flush=True,
    )
    given.out.mkdir(parents=True, exist_ok=True)
    until = given.runs * 3600.0
    with ExitStack() as stack:
        seconds = None if given.minutes is None else 60 * given.minutes
        if diary.exists():
            folders = Soak.read(diary).folders
            watcher = Diary(diary, 1 + len(folders), say=False, seconds=seconds, each_quarter=each_quarter)
            asked = ResumeRequest(folders[-1], given.out, until + OVERTIME, FEED_ROTATION)
            resumption = stack.enter_context(Resumption(asked))
            print(resumption.told, file=sys.stderr, flush=True)
            session = resumption.session([watcher])
        else:
            watcher = Diary(diary, say=False, seconds=seconds, each_quarter=each_quarter)
            request = RunRequest(
                mission=given.mission,
                scene=given.scene,
                seed=given.seed,
                parameters={"until": f"{until:g} s"},
                faults=None if given.faults == "none" else Path(given.faults),
                out=given.out,
                backend=given.backend,
                limit=until + OVERTIME,
                rotation=FEED_ROTATION,
            )
            session = Session(request, observers=[watcher])
        try:
            session.run()
        except BaseException as error:
            watcher.died(error)
            raise
        finally:
            each_quarter()


def report(path: Path, parts: int, hours: float) -> int:
    """Print what a diary of so many hours amounts to. 1 when a target is missed, or it was cut off."""
    told = Soak.read(path)
    missed: list[str] = []
    if not told.minutes:
        print("not a minute was finished" + (f": {told.crash}" if told.crash else ""))
        return 1
    last = told.minutes[-1]
    print(f"simulated      {last.time / 3600:.2f} h in {last.cpu:.0f} CPU s, {last.part} process(es)")
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
        print(f"first hour against last: memory {early:.1f} → {late:.1f} MB ({100 * more:+.1f} %), ", end="")
        print(f"99.9 % of ticks {p999:.0f} → {p999_late:.0f} ms ({100 * slower:+.1f} %)\n")
        print(rate("minutes with memory at most 3 % above the first hour's", *steady.minutes))
        print(rate("quarters of an hour with ticks at most 10 % above", *steady.quarters))
        if more > 0.03:
            missed.append("memory is more than 3 % higher in the last hour than in the first")
        if slower > 0.1:
            missed.append("the 99.9th percentile of ticks is more than 10 % higher in the last hour")
    print(rate("items done of those that came", last.items, last.came) + "\n")
    if told.quarters:
        _print_ticks(told)
    missed += _open_parts(told, parts)
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


def _open_parts(told: Soak, wanted: int) -> list[str]:
    """Open files of the log each by itself, with the stock reader and with `picktree explain`."""
    from mcap.reader import make_reader

    files = [file for folder in told.folders for file in sorted(Path(folder).glob("*.mcap"))]
    size = sum(file.stat().st_size for file in files)
    print(f"log            {size / 1e6:.0f} MB in {len(files)} files")
    if wanted and wanted < len(files):
        drawn: list[int] = (
            np.random.default_rng(len(files)).choice(len(files), wanted, replace=False).tolist()
        )
        files = [files[n] for n in sorted(drawn)]
    faults: list[str] = []
    opened = 0
    for file in files:
        try:
            with file.open("rb") as stream:
                messages = sum(1 for _ in make_reader(stream).iter_messages())
        except Exception as error:  # noqa: BLE001  whatever the stock reader says is the answer
            faults.append(f"{file.name}: the stock reader: {error}")
            continue
        said = subprocess.run(
            [sys.executable, "-m", "picktree", "explain", str(file)], capture_output=True, text=True
        )
        opened += said.returncode in (0, 1) and messages > 0
        if said.returncode not in (0, 1):
            faults.append(f"{file.name}: picktree explain: {said.stderr.strip().splitlines()[-1:]}")
    print(f"  opened by themselves: {opened} of {len(files)}")
    return faults


if __name__ == "__main__":
    sys.exit(main())
