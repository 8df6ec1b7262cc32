"""Run index: CPU time until the first row, of all rows, and of a filter, over many runs.

    python benchmarks/run_index.py LOG --runs 10000

The runs are folders with hard links to LOG. `cold`: nothing is in the cache; `warm`: in a new index whose
rows are. `studio`: the same rows in the table of the studio, filtered and sorted.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from picktree.apps.studio.run_slice import Query, RunTable
from picktree.apps.studio.workspace import Workspace
from picktree.files.disk_cache import VARIABLE
from picktree.logs.run_index import RunFilter, RunIndex, RunRow


def cpu(work: Callable[[], object]) -> float:
    """Return the CPU time of a call, s."""
    began = time.process_time()
    work()
    return time.process_time() - began


def studio_queries(base: Path, rounds: int) -> Iterator[tuple[str, float]]:
    """Yield names and CPU times of questions to the studio's table, each asked for the first time."""
    os.environ["XDG_STATE_HOME"] = f"{base}/state"
    table = RunTable(Workspace(base))
    yield "all rows", cpu(table.look)
    words = [Query(text=f"success {number}") for number in range(rounds)]
    yield "words", median(cpu(lambda each=each: table.select(each)) for each in words)
    conditions = [
        Query(where=f"lost >= 0 and 'grasp.missed' not in causes and seed < {n}") for n in range(rounds)
    ]
    yield "condition", median(cpu(lambda each=each: table.select(each)) for each in conditions)
    yield "order", cpu(lambda: table.select(Query(sort="mission", descending=False)))


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
        for name, seconds in studio_queries(Path(base), chosen.rounds):
            print(f"studio, {name:<10}{seconds:.3f} s")


if __name__ == "__main__":
    main()
