"""Campaign: run a sorting mission over many seeds and say how well it does, with intervals.

    python benchmarks/sorting.py --scene three_bins --runs 40
    python benchmarks/sorting.py --scene dense --runs 20

Each finished run is a line in the results file; a campaign that was interrupted goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parent.parent
COST_A_RUN = 12.0
"""CPU seconds that a run of twelve items takes, for the forecast."""


@dataclass(frozen=True)
class Job:
    mission: str
    scene: str
    seed: int
    out: str
    verify: bool
    faults: str | None = None


def one(job: Job) -> dict[str, object]:
    """Run one seed in this process; the JSON of its result, or the error that it died of."""
    from picktree.logs.session import RunRequest, Session

    request = RunRequest(
        mission=Path(job.mission),
        scene=job.scene,
        seed=job.seed,
        out=Path(job.out) / f"{job.scene}-{job.seed}",
        verify=job.verify,
        faults=Path(job.faults) if job.faults else None,
    )
    try:
        return {"seed": job.seed, "result": Session(request).run().to_json()}
    except Exception as error:  # noqa: BLE001  a crash is a figure of the campaign
        return {"seed": job.seed, "crash": f"{type(error).__name__}: {error}"}


def wilson(hits: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a rate (Wilson 1927)."""
    if n == 0:
        return (0.0, 1.0)
    p = hits / n
    centre = p + z * z / (2 * n)
    spread = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return ((centre - spread) / (1 + z * z / n), (centre + spread) / (1 + z * z / n))


def rate(name: str, hits: int, n: int) -> str:
    low, high = wilson(hits, n)
    share = 100 * hits / n if n else math.nan
    return (
        f"{name:<28} {hits:>5} of {n:<5} {share:6.2f} %   95 % interval {100 * low:.1f} … {100 * high:.1f} %"
    )


def report(rows: list[dict[str, object]]) -> str:
    done = [r["result"] for r in rows if "result" in r]
    lines = [f"runs {len(rows)}, crashed {len(rows) - len(done)}"]
    total = sum(r["items"]["total"] for r in done)
    lines.append(rate("items sorted", sum(r["items"]["sorted"] for r in done), total))
    lines.append(rate("items misplaced", sum(r["items"]["misplaced"] for r in done), total))
    lines.append(rate("runs that reached the goal", sum(r["status"] == "success" for r in done), len(done)))
    forms: Counter[str] = Counter()
    right: Counter[str] = Counter()
    for r in done:
        for form, counts in r["items"].get("by_form", {}).items():
            forms[form] += counts["total"]
            right[form] += counts["sorted"]
    lines += [rate(f"  {form}", right[form], forms[form]) for form in sorted(forms)]
    first = sum(r["picks"]["held_first_try"] for r in done)
    items = sum(r["picks"].get("objects", r["picks"]["tried"]) for r in done)
    lines.append(rate("held at the first try", first, items))
    held = sum(r["picks"]["held"] for r in done)
    simulated = sum(r["sim_seconds"] for r in done)
    cpu = sum(r["cpu_seconds"] for r in done)
    lines.append(
        f"picks an hour (simulated)    {3600 * held / simulated:.0f}   "
        f"seconds a pick: {simulated / held:.2f} simulated, {cpu / held:.2f} CPU   "
        f"simulated a CPU second: {simulated / cpu:.1f}"
    )
    cost = median(r["cpu_seconds"] / max(1, r["picks"]["held"]) for r in done)
    lines.append(f"CPU seconds a pick, median over runs: {cost:.2f}")
    walls = {k: sum(r["wall_seconds"][k] for r in done) for k in done[0]["wall_seconds"]}
    lines.append(
        "wall split: " + ", ".join(f"{k} {100 * v / walls['total']:.0f} %" for k, v in walls.items())
    )
    causes: Counter[str] = Counter()
    for r in done:
        causes.update(r["failures"])
    lines.append("failures by cause: " + (", ".join(f"{k} {v}" for k, v in causes.most_common()) or "none"))
    bad = [r for r in rows if "crash" in r or r["result"]["items"]["sorted"] < r["result"]["items"]["total"]]
    for r in bad[:20]:
        what = r.get("crash") or {
            k: r["result"]["items"][k] for k in ("sorted", "misplaced", "left", "total")
        }
        lines.append(f"  seed {r['seed']}: {what}")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mission", default=str(ROOT / "examples" / "sort_by_colour.yaml"))
    parser.add_argument("--scene", default="three_bins")
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--verify", action="store_true")
    parser.add_argument("--faults", default=None)
    parser.add_argument("--out", default=str(ROOT / "runs" / "campaign"))
    options = parser.parse_args()
    out = Path(options.out)
    out.mkdir(parents=True, exist_ok=True)
    name = f"{Path(options.mission).stem}-{options.scene}{'-verify' if options.verify else ''}"
    results = out / f"{name}.jsonl"
    rows = [json.loads(line) for line in results.read_text().splitlines()] if results.exists() else []
    wanted = range(options.first, options.first + options.runs)
    have = {row["seed"] for row in rows}
    jobs = [
        Job(options.mission, options.scene, seed, str(out), options.verify, options.faults)
        for seed in wanted
        if seed not in have
    ]
    forecast = len(jobs) * COST_A_RUN / options.workers
    print(
        f"{len(jobs)} runs to do, {len(wanted) - len(jobs)} done; about {forecast / 60:.1f} minutes",
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
            short = row.get("crash") or row["result"]["items"]
            print(f"  seed {row['seed']}: {short}", file=sys.stderr, flush=True)
    print(f"{name}: {time.perf_counter() - started:.0f} s")
    print(report([row for row in rows if row["seed"] in wanted]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
