"""What a start costs: CPU of short commands, of a run up to its first tick, and of a job beyond its worker.

Each round runs every row once, so that a machine that is busy is busy for all of them; medians count. The
first round, which compiles modules and fills the cache, does not. Warm: results of earlier processes are in
the cache. Cold: the cache is empty. With --jobs: the CPU that each further job adds to a batch whose mission
ends in its first tick, everything included, beside that of the same run in a process that has loaded
everything. The difference is the job's overhead: its process, its recipe, its row in the results.

    python benchmarks/startup.py --runs 9
    python benchmarks/startup.py --runs 5 --jobs 200
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from _campaign import ROOT

MISSION = "examples/sort_by_colour.yaml"
SMALL = "examples/one_pick.yaml"
FIRST_TICK = """
import os, sys, time
from picktree import __main__
from picktree.apps.cli import answer

class Stop:
    def find_spec(self, name, path, target=None):
        if name == "picktree.session.session":  # loaded by `run`: then the class is there to be changed
            sys.meta_path.remove(self)
            from picktree.session import Execution
            def tick(execution):
                real(execution)
                print(time.process_time(), file=sys.stderr, flush=True)
                os._exit(0)
            real, Execution.tick = Execution.tick, tick

sys.meta_path.insert(0, Stop())
__main__.main()
"""
"""Program that runs `picktree` and ends after the first tick with the CPU time of its process, s."""
AT_ONCE = """picktree: 1
kind: mission
name: at once
scene: sort_small
trees:
  Main: AlwaysSuccess
"""


@dataclass(frozen=True)
class Row:
    name: str
    arguments: tuple[str, ...]
    target: float | None = None
    """Greatest CPU time that is wanted, s."""
    cold: bool = False
    to_first_tick: bool = False


ROWS = (
    Row("interpreter", ("-c", "pass")),
    Row("interpreter, numpy", ("-c", "import numpy")),
    Row("picktree --help", ("-m", "picktree", "--help"), 0.1),
    Row("picktree run --help", ("-m", "picktree", "run", "--help")),
    Row("check of a small mission", ("-m", "picktree", "check", SMALL), 0.4),
    Row("check of a small mission, cold", ("-m", "picktree", "check", SMALL), cold=True),
    Row("run to the first tick", ("-c", FIRST_TICK, "run", MISSION), 0.8, to_first_tick=True),
    Row("run to the first tick, cold", ("-c", FIRST_TICK, "run", MISSION), 1.5, True, True),
    Row(
        "kinematic run to the first tick",
        ("-c", FIRST_TICK, "run", SMALL, "--backend", "kinematic"),
        to_first_tick=True,
    ),
)


def seconds(row: Row, folder: Path) -> float:
    """CPU time of the row's process, s."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    with tempfile.TemporaryDirectory(dir=folder) as empty:
        environment["PICKTREE_CACHE"] = empty if row.cold else str(folder / "cache")
        out = ("--out", empty) if row.to_first_tick else ()
        return cpu(row, (sys.executable, *row.arguments, *out), environment)


def cpu(row: Row, command: tuple[str, ...], environment: dict[str, str]) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    ran = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    if ran.returncode > 1:  # 1: the goal is missed, as it is by a mission that ends at once
        sys.exit(f"{' '.join(command)}\n{ran.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if row.to_first_tick:
        return float(ran.stderr.split()[-1])
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def batch(jobs: int, folder: Path, kind: str) -> float:
    """CPU time of a batch with this number of jobs on one worker, everything included, s."""
    mission = folder / "at_once.yaml"
    mission.write_text(AT_ONCE)
    row = Row(kind, ("-m", "picktree", "batch", "run", "--mission", str(mission), "--backend", kind))
    with tempfile.TemporaryDirectory(dir=folder) as out:
        more = ("--seeds", f"0:{jobs}", "--workers", "1", "--keep", "none", "--out", f"{out}/batch")
        environment = {**os.environ, "PICKTREE_CACHE": str(folder / "cache")}
        return cpu(row, (sys.executable, *row.arguments, *more), environment)


ALONE = """
import statistics, sys, time
from pathlib import Path
from picktree.apps.batch.local_executor import load
from picktree.session import RunRequest; from picktree.session import Session
load()
took = []
for seed in range(12):
    began = time.process_time()
    Session(RunRequest(Path(sys.argv[1]), seed=seed, backend=sys.argv[2], out=Path(sys.argv[3]))).run()
    took.append(time.process_time() - began)
print(statistics.median(took[2:]), file=sys.stderr)
"""
"""Program that repeats the job's run in one process that has loaded everything."""


def alone(folder: Path, kind: str) -> float:
    """CPU time of the job's run in a process that has loaded everything, s."""
    row = Row(kind, (), to_first_tick=True)
    environment = {**os.environ, "PICKTREE_CACHE": str(folder / "cache")}
    command = (sys.executable, "-c", ALONE, str(folder / "at_once.yaml"), kind, str(folder / "alone"))
    return cpu(row, command, environment)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=7, help="rounds that count")
    parser.add_argument("--jobs", type=int, default=0, help="jobs of the batch; 0: no batch")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        times: dict[str, list[float]] = {row.name: [] for row in ROWS}
        for number in range(arguments.runs + 1):
            for row in ROWS:
                took = seconds(row, folder)
                if number:
                    times[row.name].append(took)
        print("| what | CPU, s (median of", arguments.runs, "rounds) | least | target |")
        print("|---|---|---|---|")
        for row in ROWS:
            took, target = times[row.name], "" if row.target is None else f"{row.target:g}"
            print(f"| {row.name} | {statistics.median(took):.2f} | {min(took):.2f} | {target} |")
        if arguments.jobs:
            for kind in ("kinematic", "physics"):
                few, many = arguments.jobs // 10, arguments.jobs
                whole = (batch(many, folder, kind) - batch(few, folder, kind)) / (many - few)
                run = alone(folder, kind)
                print(
                    f"a {kind} job, of {many}: {1000 * whole:.0f} ms of CPU, its run alone {1000 * run:.0f}"
                )


if __name__ == "__main__":
    main()
