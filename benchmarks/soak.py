"""Soak: sort on and on with random faults, in one process. Do memory and the time of a tick stay where they
are, and does each file of the log open by itself?

    python benchmarks/soak.py                              # 24 simulated hours
    python benchmarks/soak.py --runs 0.3 --backend kinematic
    python benchmarks/soak.py --minutes 30                 # half an hour of them
    python benchmarks/soak.py --report                     # what it has told so far

It goes on from its last checkpoint, in a process of its own each time, until the hours are full. When a file
that it depended on has changed, it begins anew. Each process ends with a log of a moment, `handover`, that
begins with the checkpoint: with it, the diary and the dependencies a soak goes on in another checkout.

A feed that never ends brings items, full bins are exchanged, and faults come as benchmarks/soak/faults.yaml
draws them. Each simulated minute is a line in the soak's diary: resident memory, items; each quarter of an
hour the CPU time of its ticks. A soak that is cut off has told what it knew.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from _campaign import REFERENCE_COST, RESULTS, ROOT, reference
from _dependencies import Dependencies, opened, used
from _soak_report import draw, report
from _soaking import Diary, Soak
from picktree.session import Interrupter

HERE = ROOT / "benchmarks" / "soak"
COST_AN_HOUR = 750.0
"""CPU seconds that a simulated hour takes in physics, for the forecast."""
MB_AN_HOUR = 250.0
"""Size of the log of a simulated hour, MB."""
OVERTIME = 1800.0
"""Simulated s after which a mission that does not end when it should is ended."""
PARTS = 6
"""Files of the log of each process that are opened by themselves, drawn at random."""
HANDOVER = "handover"
"""Folder with the log that begins with the last checkpoint."""


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
    return report(diary, given.runs)


def soak(given: argparse.Namespace, diary: Path, each_quarter: Callable[[], object]) -> None:
    from picktree.logs.log_files import FEED_ROTATION
    from picktree.session import ResumeRequest, Resumption, RunRequest, Session

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
            elsewhere = next((given.out / HANDOVER).glob("*"), folders[-1])
            before = folders[-1] if folders[-1].exists() else elsewhere
            asked = ResumeRequest(before, given.out, until + OVERTIME, FEED_ROTATION)
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
    watcher.opened(given.parts)
    if not Soak.read(diary).result:
        hand_over(given.out, Soak.read(diary).folders[-1], until + OVERTIME)


def hand_over(out: Path, folder: Path, limit: float) -> None:
    """Write a log of one tick that goes on from the last checkpoint of the run in a folder."""
    from picktree.session import ResumeRequest, Resumption

    class AtOnce(Interrupter):
        def stops(self) -> bool:
            return True

    beside = out / f"{HANDOVER}.part"
    shutil.rmtree(beside, ignore_errors=True)
    with Resumption(ResumeRequest(folder, beside, limit)) as resumption:
        resumption.session([AtOnce()]).run()
    shutil.rmtree(out / HANDOVER, ignore_errors=True)
    beside.rename(out / HANDOVER)


if __name__ == "__main__":
    sys.exit(main())
