"""Campaign: halt the sorting mission at random ticks in physics; the arm must rest, the mission then finish.

    python benchmarks/halting.py --runs 200
    python benchmarks/halting.py --runs 200 --scene three_bins --out elsewhere

Each seed is run once and halted in branches of it. A finished seed is a line in the results file; a campaign
that was interrupted goes on where it stopped.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import multiprocessing
import os
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parent.parent
HALTS = 10
"""In each seed's run; fewer when it is over before."""
LAST_TICK = 420
"""A run of four items has about that many ticks."""
COST = {"sort_small": 1.5, "three_bins": 7.0}
"""CPU seconds a halt, for the forecast."""


@dataclass(frozen=True)
class Job:
    scene: str
    seed: int
    halts: int


def _cell() -> ModuleType:
    """What the tests drive missions with."""
    spec = importlib.util.spec_from_file_location("cell", ROOT / "tests" / "skills" / "cell.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["cell"] = module
    spec.loader.exec_module(module)
    return module


def one(job: Job) -> dict[str, object]:
    """One seed's run with its halts, each with what came of it, or the error that it died of."""
    import numpy as np

    from picktree.world.scene.load import load_scene

    cell = _cell()
    last = LAST_TICK if job.scene == "sort_small" else 3 * LAST_TICK
    draw = np.random.default_rng([job.seed, 1])
    ticks = sorted(int(t) + 1 for t in draw.choice(last, job.halts, replace=False))
    run = cell.Cell(cell.sorting(), load_scene(job.scene), "physics", job.seed)
    answers: list[dict[str, object]] = []

    def wanted(tick: int) -> bool:
        if tick in ticks:
            try:
                halted = cell.branch(lambda: cell.halt_and_finish(run, tick))
                answers.append({**asdict(halted), "fine": halted.fine})
            except AssertionError as error:
                answers.append({"tick": tick, "leaf": run.leaf, "fine": False, "died": str(error)})
        return False

    cell.halted_at(run, wanted)
    return {"seed": job.seed, "unhalted": run.score().sorted, "halts": answers}


def wilson(hits: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a rate (Wilson 1927)."""
    if n == 0:
        return (0.0, 1.0)
    p = hits / n
    centre = p + z * z / (2 * n)
    spread = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return ((centre - spread) / (1 + z * z / n), (centre + spread) / (1 + z * z / n))


def report(rows: list[dict[str, object]]) -> tuple[str, bool]:
    halts = [halt | {"seed": row["seed"]} for row in rows for halt in row["halts"]]
    fine = sum(halt["fine"] for halt in halts)
    low, high = wilson(fine, len(halts))
    lines = [
        f"at rest and finished  {fine} of {len(halts)}   95 % interval {100 * low:.1f} … {100 * high:.1f} %"
    ]
    rests = sorted(halt["to_rest"] for halt in halts if "to_rest" in halt)
    if rests:
        lines.append(
            f"time to rest          {rests[len(rests) // 2]:.2f} s median, {rests[-1]:.2f} s at most"
        )
    leaves = Counter(halt["leaf"] or "between skills" for halt in halts)
    lines.append("halted in             " + ", ".join(f"{leaf} {n}" for leaf, n in leaves.most_common()))
    lines.append(f"needed recovery       {sum(bool(halt.get('recoveries')) for halt in halts)}")
    for halt in halts:
        if not halt["fine"]:
            what = halt.get("died") or (halt["status"], halt["sorted"], halt["total"], halt["complaints"])
            lines.append(f"  seed {halt['seed']} tick {halt['tick']} in {halt['leaf']}: {what}")
            lines += [f"    {recovery}" for recovery in halt.get("recoveries", ())]
    return "\n".join(lines), fine == len(halts)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="sort_small")
    parser.add_argument("--runs", type=int, default=200, help=f"halts, up to {HALTS} in each seed")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--out", default=str(ROOT / "runs" / "halting"))
    options = parser.parse_args()
    out = Path(options.out)
    out.mkdir(parents=True, exist_ok=True)
    results = out / f"{options.scene}.jsonl"
    rows = [json.loads(line) for line in results.read_text().splitlines()] if results.exists() else []
    seeds = range(options.first, options.first + math.ceil(1.08 * options.runs / HALTS))
    have = {row["seed"] for row in rows}
    jobs = [Job(options.scene, seed, HALTS) for seed in seeds if seed not in have]
    forecast = len(jobs) * HALTS * COST.get(options.scene, 7.0)
    print(
        f"{len(jobs)} seeds to do, {len(seeds) - len(jobs)} done; "
        f"about {forecast / 60:.1f} CPU minutes on {options.workers} workers",
        flush=True,
    )
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[variable] = "1"
    started = time.perf_counter()
    with ProcessPoolExecutor(options.workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        for future in as_completed([pool.submit(one, job) for job in jobs]):
            row = future.result()
            rows.append(row)
            with results.open("a") as file:
                file.write(json.dumps(row) + "\n")
            fine = sum(halt["fine"] for halt in row["halts"])
            print(f"  seed {row['seed']}: {fine} of {len(row['halts'])}", file=sys.stderr, flush=True)
    print(f"{options.scene}: {time.perf_counter() - started:.0f} s")
    text, fine = report([row for row in rows if row["seed"] in seeds])
    print(text)
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
