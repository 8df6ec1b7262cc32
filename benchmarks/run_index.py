"""Run index: CPU time until the first row, of all rows, and of a filter, over many runs.

    python benchmarks/run_index.py LOG --runs 10000

The runs are folders with hard links to LOG. `cold`: nothing is in the cache; `warm`: in a new index whose
rows are.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from picktree.files.disk_cache import VARIABLE
from picktree.logs.run_index import RunFilter, RunIndex, RunRow


def cpu(work: Callable[[], object]) -> float:
    """Return the CPU time of a call, s."""
    began = time.process_time()
    work()
    return time.process_time() - began


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("log", type=Path)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=5)
    chosen = parser.parse_args()
    with TemporaryDirectory(dir=chosen.log.parent) as base:
        os.environ[VARIABLE] = f"{base}/cache"
        folder = Path(base) / "runs"
        for number in range(chosen.runs):
            run = folder / f"run-{number}-20261123-090000"
            run.mkdir(parents=True)
            os.link(chosen.log, run / "log.mcap")

        def first() -> RunRow:
            return next(RunIndex(folder).rows())

        def every() -> list[RunRow]:
            return list(RunIndex(folder).rows())

        print(f"cold, first row   {cpu(first):.3f} s")
        print(f"cold, all rows    {cpu(every):.3f} s")
        rows = every()
        for name, work in (("first row", first), ("all rows", every)):
            print(f"warm, {name:<12}{median(cpu(work) for _ in range(chosen.rounds)):.3f} s")
        where = RunFilter.parse("status == 'success' and lost >= 0 and 'grasp.missed' not in causes")
        spent = median(cpu(lambda: [row for row in rows if where(row)]) for _ in range(chosen.rounds))
        print(f"filter            {spent:.3f} s over {len(rows)} rows")


if __name__ == "__main__":
    main()
