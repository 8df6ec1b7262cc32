"""Runs of a mission with physics, each run again from its log in another process: are they identical?

    python benchmarks/resim.py --runs 10

Prints its cost first. Each seed is run, re-simulated, and continued from its middle checkpoint with nothing
changed. Exit code 1 when one of them differs.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from picktree.analysis import Run, resimulate, what_if
from picktree.session import RecordedRun, RunRequest, Session

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
COST = 30.0
"""CPU seconds of one seed with physics."""


@dataclass(frozen=True)
class Row:
    seed: int
    status: str
    items: str
    seconds: float
    """Simulated."""
    ticks: int
    digest: str
    resim: str
    continuation: str
    cpu: float


def one(seed: int, mission: Path, scene: str | None, backend: str, out: Path) -> Row:
    begun = _cpu()
    request = RunRequest(mission, scene=scene, seed=seed, backend=backend, out=out)  # type: ignore[arg-type]
    result = Session(request).run()
    again = resimulate(result.log)
    with Run(result.log) as run, RecordedRun(run) as recorded:
        names = recorded.checkpoints()
        time_ = recorded.state(names[len(names) // 2]).time if names else 0.0
    on = what_if(result.log, f"{time_}s", out=out)
    return Row(
        seed,
        result.status,
        f"{result.items.sorted}/{result.items.total}",
        result.sim_seconds,
        again.recorded_ticks,
        result.digest[:12],
        "identical" if again.identical and again.digest == result.digest else again.to_text().splitlines()[0],
        f"{on.checkpoint.removesuffix('.json')}: identical"
        if on.identical and on.exact and on.now.digest == result.digest
        else f"{on.checkpoint}: {on.difference}",
        _cpu() - begun,
    )


def _cpu() -> float:
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=10, help="seeds 0 … N-1")
    parser.add_argument("--mission", type=Path, default=EXAMPLES / "sort_by_colour.yaml")
    parser.add_argument("--scene", default=None)
    parser.add_argument("--backend", choices=("physics", "kinematic"), default="physics")
    given = parser.parse_args()
    cost = COST if given.backend == "physics" else COST / 4
    print(f"{given.runs} seeds, about {given.runs * cost / 60:.1f} CPU minutes on one processor", flush=True)
    begun = time.perf_counter()
    different = 0
    print(
        "seed  status       items   sim s  ticks  digest        resim; what-if without a change", flush=True
    )
    with tempfile.TemporaryDirectory(prefix="picktree-") as folder:
        for seed in range(given.runs):
            row = one(seed, given.mission, given.scene, given.backend, Path(folder))
            different += row.resim != "identical" or not row.continuation.endswith("identical")
            print(
                f"{row.seed:>4}  {row.status:<10}  {row.items:>6}  {row.seconds:6.1f}  {row.ticks:>5}  "
                f"{row.digest:<12}  {row.resim}; {row.continuation} ({row.cpu:.0f} CPU s)",
                flush=True,
            )
    wall = time.perf_counter() - begun
    print(f"{given.runs - different} of {given.runs} identical; {wall:.0f} s of wall time")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
