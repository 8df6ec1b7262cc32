"""Whether a batch on a Ray cluster comes to the table of local workers when one of its workers is killed.

A Ray cluster of two workers is started on the loopback, and at random moments a process is killed with
SIGKILL: that of Ray, the worker below it, or that of the job. The results must be those of the same jobs on
local workers in every table, apart from the time that things took, the tries that the killed jobs needed,
and what is kept of those tries.

python benchmarks/clusters.py --runs 40 --kills 1
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import sqlite3
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from _campaign import ROOT
from picktree.apps.batch import (
    Batch,
    BatchPlan,
    Executor,
    Job,
    JobRow,
    LocalExecutor,
    RayExecutor,
    RecordedJob,
)
from picktree.apps.batch.job_process import children

COST = {"physics": 7.0, "kinematic": 2.0}
"""CPU seconds that a run of `sort_small` takes, for the forecast."""
APART = {"jobs": {"cpu_seconds", "wall_seconds", "attempts", "folder"}}
"""Columns in which the two tables may differ."""
TRIES = {"crashes", "versions"}
"""Tables that tell of tries and machines, not of jobs."""


class Killer:
    """Follows a batch, and kills one of the processes that work for it when so many jobs are done."""

    def __init__(self, moments: Sequence[int], rng: random.Random) -> None:
        self._moments, self._rng = list(moments), rng
        self.done = 0
        self.again: list[str] = []

    def started(self, total: int, done: Sequence[JobRow], workers: int) -> None: ...
    def stopping(self, under_way: int) -> None: ...

    def tried_again(self, job: Job, reason: str) -> None:
        self.again.append(f"seed {job.seed}: {reason}")

    def ended(self, ended: RecordedJob) -> None:
        self.done += 1

    def waiting(self) -> None:
        if self._moments and self.done >= self._moments[0]:
            foremen = [pid for pid in below(os.getpid()) if name(pid).startswith("ray::Foreman")]
            found = [pid for foreman in foremen for pid in below(foreman)]
            if len(found) > len(foremen):
                victim = self._rng.choice(found)
                print(f"after {self.done} jobs, SIGKILL for {name(victim)}", flush=True)
                os.kill(victim, signal.SIGKILL)
                self._moments.pop(0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--kills", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--backend", choices=("physics", "kinematic"), default="kinematic")
    parser.add_argument("--mission", type=Path, default=ROOT / "examples" / "sort_by_colour.yaml")
    parser.add_argument("--scene", default="sort_small")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "clusters")
    chosen = parser.parse_args()
    cost = 2 * chosen.runs * COST[chosen.backend] + 30.0
    print(f"about {cost / 60:.1f} CPU minutes on {chosen.workers} workers", flush=True)
    shutil.rmtree(chosen.out, ignore_errors=True)
    seeds = tuple(range(chosen.runs))
    plan = BatchPlan("clusters", (chosen.mission,), seeds, (chosen.scene,), backend=chosen.backend)
    rng = random.Random(chosen.seed)
    moments = sorted(rng.randrange(max(1, chosen.runs - chosen.workers)) for _ in range(chosen.kills))
    killer = Killer(moments, rng)
    with LocalExecutor(chosen.workers) as local:
        carry_out(plan, chosen.out / "local", local, Killer((), rng))
    began = time.monotonic()
    with RayExecutor(chosen.workers) as cluster:
        print(f"the cluster is there after {time.monotonic() - began:.1f} s", flush=True)
        carry_out(plan, chosen.out / "ray", cluster, killer)
    print("\n".join(killer.again) or "no job was tried again")
    wrong = differences(chosen.out / "local", chosen.out / "ray")
    print("\n".join(wrong) or "the tables are equal")
    return 1 if wrong else 0


def carry_out(plan: BatchPlan, folder: Path, executor: Executor, killer: Killer) -> None:
    began = time.monotonic()
    with Batch.create(folder, plan) as batch:
        if not batch.run(executor, killer):
            raise SystemExit("the batch was stopped")
    took = time.monotonic() - began
    jobs = len(plan.seeds)
    print(f"{folder.name}: {jobs} jobs in {took:.1f} s, {3600 * jobs / took:.0f} an hour", flush=True)


def differences(a: Path, b: Path) -> list[str]:
    """The tables in which two batches differ, with a row or two."""
    wrong: list[str] = []
    ours, theirs = contents(a), contents(b)
    for table in sorted({*ours, *theirs}):
        missing, more = ours[table] - theirs[table], theirs[table] - ours[table]
        if missing or more:
            wrong.append(f"{table}: missing {missing.most_common(2)}, too many {more.most_common(2)}")
    return wrong


def contents(folder: Path) -> dict[str, Counter[tuple[object, ...]]]:
    found: dict[str, Counter[tuple[object, ...]]] = {}
    with sqlite3.connect(folder / "results.sqlite") as results:
        tables = results.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
        for (table,) in tables:
            if table not in TRIES:
                columns = [row[1] for row in results.execute(f"PRAGMA table_info({table})")]
                kept = [column for column in columns if column not in APART.get(table, ())]
                found[table] = Counter(results.execute(f"SELECT {', '.join(kept)} FROM {table}"))
    return found


def below(pid: int) -> list[int]:
    """The process and all that it started, directly or not."""
    return [pid, *(each for child in children(pid) for each in below(child))]


def name(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/comm").read_text().strip()
    except OSError:
        return ""


if __name__ == "__main__":
    sys.exit(main())
