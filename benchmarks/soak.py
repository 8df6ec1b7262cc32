"""Soak: sort on and on with random faults, in one process. Do memory and the time of a tick stay where they
are, and does each file of the log open by itself?

    python benchmarks/soak.py                              # 24 simulated hours
    python benchmarks/soak.py --runs 0.3 --backend kinematic
    python benchmarks/soak.py --minutes 30                 # half an hour of them
    python benchmarks/soak.py --report                     # what it has told so far

It goes on from its last checkpoint, in a process of its own each time, until the hours are full.

A feed that never ends brings items, full bins are exchanged, and faults come as benchmarks/soak/faults.yaml
draws them. Each simulated minute is a line in the soak's diary: resident memory, items; each quarter of an
hour the CPU time of its ticks. A soak that is cut off has told what it knew.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack
from pathlib import Path

from _campaign import REFERENCE_COST, RESULTS, ROOT, reference
from _soak_report import draw, report
from _soaking import Diary, Soak

HERE = ROOT / "benchmarks" / "soak"
COST_AN_HOUR = 750.0
"""CPU seconds that a simulated hour takes in physics, for the forecast."""
MB_AN_HOUR = 250.0
"""Size of the log of a simulated hour, MB."""
OVERTIME = 1800.0
"""Simulated s after which a mission that does not end when it should is ended."""
PARTS = 6
"""Files of the log of each process that are opened by themselves, drawn at random."""


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
    diary = given.out / "diary.jsonl"
    if not given.report and not (diary.exists() and Soak.read(diary).result):
        soak(given, diary)
    if not diary.exists():
        print(f"{diary}: there is no soak", file=sys.stderr)
        return 2
    if given.picture and Soak.read(diary).quarters:
        draw(Soak.read(diary), given.picture)
    return report(diary, given.runs)


def soak(given: argparse.Namespace, diary: Path) -> None:
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
            watcher = Diary(diary, 1 + len(folders), say=False, seconds=seconds)
            asked = ResumeRequest(folders[-1], given.out, until + OVERTIME, FEED_ROTATION)
            resumption = stack.enter_context(Resumption(asked))
            print(resumption.description, file=sys.stderr, flush=True)
            session = resumption.session([watcher])
        else:
            watcher = Diary(diary, say=False, seconds=seconds)
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
    watcher.opened(given.parts)


if __name__ == "__main__":
    sys.exit(main())
