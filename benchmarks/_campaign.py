"""What all campaigns share: jobs on worker processes, results in a file that can be taken up, rates."""

from __future__ import annotations

import json
import math
import multiprocessing
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, Protocol, TypeVar

from picktree.arithmetic import restart

restart()

ROOT = Path(__file__).resolve().parent.parent
Row = dict[str, Any]


class Seeded(Protocol):
    @property
    def seed(self) -> int: ...


J = TypeVar("J", bound=Seeded)


def campaign(
    results: Path,
    jobs: Sequence[J],
    one: Callable[[J], Row],
    *,
    cost: float,
    workers: int,
    short: Callable[[Row], object],
    fresh: bool = False,
) -> list[Row]:
    """Run the jobs whose seeds the results file does not hold yet; a row for each of the jobs.

    cost: CPU seconds of one job, for the forecast. short: what is printed of a finished row.
    fresh: each job in a process of its own, so that its memory is its own, too.
    """
    results.parent.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = (
        [json.loads(line) for line in results.read_text().splitlines()] if results.exists() else []
    )
    have = {row["seed"] for row in rows}
    missing = [job for job in jobs if job.seed not in have]
    print(
        f"{results.stem}: {len(missing)} of {len(jobs)} to do, about {len(missing) * cost / 60:.1f} "
        f"CPU minutes on {workers} workers; results in {results}",
        flush=True,
    )
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, max_tasks_per_child=1 if fresh else None) as pool:
        for future in as_completed([pool.submit(one, job) for job in missing]):
            row = future.result()
            rows.append(row)
            with results.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(f"  seed {row['seed']}: {short(row)}", file=sys.stderr, flush=True)
    wanted = {job.seed for job in jobs}
    return sorted((row for row in rows if row["seed"] in wanted), key=lambda row: row["seed"])


def wilson(hits: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a rate (Wilson 1927)."""
    if n == 0:
        return (0.0, 1.0)
    p = hits / n
    centre = p + z * z / (2 * n)
    spread = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return (max(0.0, (centre - spread) / (1 + z * z / n)), min(1.0, (centre + spread) / (1 + z * z / n)))


def rate(name: str, hits: int, n: int) -> str:
    """A line with N and the interval."""
    low, high = wilson(hits, n)
    share = f"{100 * hits / n:6.2f} %" if n else "     –  "
    return f"{name:<28} {hits:>5} of {n:<5} {share}   95 % interval {100 * low:.1f} … {100 * high:.1f} %"


def split(rows: Iterable[Row], total: str) -> str:
    """Shares of wall time by part."""
    sums: dict[str, float] = {}
    for row in rows:
        for part, seconds in row.items():
            sums[part] = sums.get(part, 0.0) + seconds
    whole = sums.pop(total)
    return ", ".join(f"{part} {100 * seconds / whole:.0f} %" for part, seconds in sums.items())
