"""Cost of pages and tools: CPU and peak memory of report, explain, export, a film and a batch's page.

The log is of 300 simulated s of `continuous_sort` with faults drawn at random. `--deep` takes a mission with
five times its nodes and twenty times its images, for which no figures are wanted. The batch has 1,000 jobs:
results of a few real runs, repeated with other seeds. Both are made once and kept.
Each command is a process of its own, start included; the rounds take turns, and medians count. This process
imports little: the peak memory of another begins with that of the one that starts it.

    python benchmarks/reporting.py --rounds 5
    python benchmarks/reporting.py --deep --only export
    python benchmarks/reporting.py --log LOG --sections     # bytes and seconds of each panel of a report
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from _campaign import ROOT
from picktree.apps.batch.executor import Event, JobFinished, JobOrder

SOAK = ROOT / "benchmarks" / "soak"
SECONDS, SEED = 300.0, 7
JOBS, REAL_JOBS = 1000, 6
FILM_SECONDS = 6.0
KEPT = ROOT / "runs" / "reporting"


@dataclass(frozen=True)
class Command:
    name: str
    words: tuple[str, ...]
    """Words of the command; {log}, {batch} and {out} are replaced."""
    cpu: float
    """Greatest CPU time that is wanted, s."""
    memory: float | None = None
    """Greatest peak memory that is wanted, MB."""


_FILM = ("video", "{log}", "-o", "{out}/film.mp4", "--from", "60", "--to", f"{60 + FILM_SECONDS:g}")
COMMANDS = (
    Command("report", ("report", "{log}", "-o", "{out}/report.html"), 4.0, 250.0),
    Command("explain", ("explain", "{log}"), 2.0),
    Command("export", ("export", "{log}", "--to", "csv", "-o", "{out}/tables"), 3.0),
    Command(f"film of {FILM_SECONDS:g} s, two cores", (*_FILM, "--processes", "2"), 2 * FILM_SECONDS),
    Command(
        "page of 1,000 runs", ("batch", "report", "{batch}", "-o", "{out}/batch.html", "--runs", "0"), 3.0
    ),
    Command("the same, 5 runs' pages", ("batch", "report", "{batch}", "-o", "{out}/batch.html"), 3.0),
)


@dataclass(frozen=True)
class Cost:
    cpu: float
    """CPU time of the process and its children, s."""
    memory: float
    """Peak of the largest process, MB."""


class Repetition:
    """Executor that gives each order the result of a real job, and its run's folder."""

    slots = 1

    def __init__(self, results: Sequence[Path]) -> None:
        self._results = results
        self._given: deque[Event] = deque()

    def submit(self, order: JobOrder) -> None:
        rows = self._results[order.seed % len(self._results)]
        order.folder.mkdir(parents=True)
        order.result.write_bytes(rows.read_bytes())
        for run in (log.parent for log in rows.parent.glob("*/log.mcap")):
            (order.folder / run.name).mkdir()
            for file in run.iterdir():
                os.link(file, order.folder / run.name / file.name)
        self._given.append(JobFinished(order))

    def wait(self, seconds: float) -> Sequence[Event]:
        return [self._given.popleft()] if self._given else []

    def stop(self) -> None: ...
    def close(self) -> None: ...


def long_run(folder: Path, *, deep: bool) -> Path:
    """Return the folder of the long run; make it where it is missing."""
    kept = folder / ("deep" if deep else "log")
    if not kept.exists():
        from picktree.session import RunRequest, Session

        print(f"a run of {SECONDS:g} simulated s: about {SECONDS / 4:.0f} CPU s", flush=True)
        mission = SOAK / "sort_on.yaml" if deep else ROOT / "examples" / "continuous_sort.yaml"
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            request = RunRequest(
                mission, seed=SEED, faults=SOAK / "faults.yaml", out=Path(scratch), limit=SECONDS
            )
            Session(request).run().folder.rename(kept)
    return kept


def many_jobs(folder: Path) -> Path:
    """Return the folder of the batch; make it where it is missing."""
    if (folder / "batch" / "done").exists():
        return folder / "batch"
    from picktree.apps.batch import Batch, BatchPlan, LocalExecutor
    from picktree.apps.cli.batch_progress import progress

    faults = tuple(ROOT / "examples" / "faults" / f"{name}.yaml" for name in ("slip", "camera_mislabel"))
    missions = (ROOT / "examples" / "sort_tirelessly.yaml",)
    real, kept = folder / "real", folder / "batch"
    if not (real / "done").exists():
        print(f"{2 * REAL_JOBS} real runs: about {2 * REAL_JOBS * 6} CPU s", flush=True)
        plan = BatchPlan("real", missions, tuple(range(REAL_JOBS)), faults=faults, keep="all")
        made = Batch.resume(real) if (real / "plan.json").exists() else Batch.create(real, plan)
        with made as batch, LocalExecutor(2) as executor, progress(real, None) as seen:
            batch.run(executor, seen)
        (real / "done").touch()
    plan = BatchPlan("a thousand", missions, tuple(range(JOBS // 2)), faults=faults)
    made = Batch.resume(kept) if (kept / "plan.json").exists() else Batch.create(kept, plan)
    with made as batch, progress(kept, None) as seen:
        batch.run(Repetition(sorted(real.glob("jobs/*/rows.json"))), seen)
    (kept / "done").touch()
    return kept


def measure(command: Command, log: Path, batch: Path) -> Cost:
    """Run a command in a process of its own. Pages of runs that it adds to the batch are taken away again."""
    with tempfile.TemporaryDirectory() as out:
        words = [word.format(log=log, batch=batch, out=out) for word in command.words]
        process = subprocess.Popen(
            [sys.executable, "-m", "picktree", *words],
            cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert process.stderr is not None
        said = process.stderr.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            sys.exit(f"{' '.join(words)}\n{said}")
    for page in batch.glob("jobs/*/*/report.html"):
        page.unlink()
    return Cost(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1000)


def show_sections(log: Path) -> None:
    from picktree.analysis import Run
    from picktree.analysis.report import pack
    from picktree.analysis.report.report import PACKERS

    with Run(log) as run:
        for packer in PACKERS:
            began = time.process_time()
            section = packer(run)
            seconds = time.process_time() - began
            print(f"  {section.name:<10}{len(pack([section])) / 1e3:8.0f} kB{seconds:8.2f} s")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--log", type=Path, help="a log instead of the long run")
    parser.add_argument("--batch", type=Path, help="a batch instead of that of 1,000 jobs")
    parser.add_argument("--deep", action="store_true", help="the deep mission")
    parser.add_argument("--only", default="", help="commands whose names contain this")
    parser.add_argument("--sections", action="store_true", help="bytes and CPU s of each panel of a report")
    parser.add_argument("--kept", type=Path, default=KEPT, help="folder of the log and the batch")
    given = parser.parse_args()
    given.kept.mkdir(parents=True, exist_ok=True)
    log = given.log or long_run(given.kept, deep=given.deep)
    if given.sections:
        show_sections(log)
        return 0
    batch = given.batch or many_jobs(given.kept)
    chosen = [command for command in COMMANDS if given.only in command.name]
    costs: dict[str, list[Cost]] = {command.name: [] for command in chosen}
    for _ in range(given.rounds):
        for command in chosen:
            costs[command.name].append(measure(command, log, batch))
    print(f"{'command':<28}{'CPU, s':>8}{'wanted':>8}{'MB':>8}{'wanted':>8}")
    missed = 0
    for command in chosen:
        cpu = statistics.median(cost.cpu for cost in costs[command.name])
        memory = statistics.median(cost.memory for cost in costs[command.name])
        limit = "" if command.memory is None else f"{command.memory:g}"
        print(f"{command.name:<28}{cpu:8.2f}{command.cpu:8g}{memory:8.0f}{limit:>8}")
        missed += cpu > command.cpu or (command.memory is not None and memory > command.memory)
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
