"""Simulated seconds a CPU second of whole runs with their recording, and CPU seconds by part of the work:
medians over seeds and repetitions.

Each run has a process of its own. All clocks of the run count the CPU time of its thread, so that other work
on the machine changes little. With `--against` another checkout runs in alternation, and the table has both.

python benchmarks/run_speed.py [--runs 1] [--seeds 1 2 3] [--against CHECKOUT] [NAME …]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parent.parent
RUNS = {
    "sort_by_colour": ("sort_by_colour", None, "physics"),
    "kinematic": ("sort_by_colour", None, "kinematic"),
    "dense": ("sort_by_colour", "dense", "physics"),
    "sort_past_obstacles": ("sort_past_obstacles", None, "physics"),
    "sort_tirelessly": ("sort_tirelessly", None, "physics"),
    "continuous_sort": ("continuous_sort", None, "physics"),
}
"""Mission of the examples, scene (None: the mission's own) and backend, by name."""
PARTS = ("physics", "control", "planning", "perception", "rendering", "tree", "logging", "rest")
"""Parts of a run's CPU seconds; `rest` is its start and end, and what no other part counts."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(RUNS), help=", ".join(RUNS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3])
    parser.add_argument("--runs", type=int, default=1, help="repetitions of each seed")
    parser.add_argument("--limit", type=float, default=90.0, help="simulated s of a run at most")
    parser.add_argument("--against", type=Path, help="checkout with an environment in .venv")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.one:
        print(json.dumps(measure(chosen.one, chosen.seeds[0], chosen.limit)))
        return
    trees = {"": ROOT} if chosen.against is None else {"before": chosen.against.resolve(), "after": ROOT}
    print(f"{'':28}{'sim s':>7}{'CPU s':>7}{'sim/CPU':>9} " + "".join(f"{part:>11}" for part in PARTS))
    for name in chosen.names:
        found: dict[str, list[dict[str, float]]] = {each: [] for each in trees}
        for seed in chosen.seeds * chosen.runs:
            for each, tree in trees.items():
                found[each].append(_run(tree, name, seed, chosen.limit))
        for each, runs in found.items():
            speed = median(run["simulated"] / run["cpu"] for run in runs)
            middle = {key: median(run[key] for run in runs) for key in runs[0]}
            print(
                f"{name + ' ' + each:28}{middle['simulated']:7.1f}{middle['cpu']:7.2f}{speed:9.1f} "
                + "".join(f"{middle[part]:11.2f}" for part in PARTS),
                flush=True,
            )


def _run(tree: Path, name: str, seed: int, limit: float) -> dict[str, float]:
    """Measure one run of a checkout in a process of its own."""
    command = [str(tree / ".venv/bin/python"), __file__, name, "--one", name, "--seeds", str(seed)]
    done = subprocess.run(
        [*command, "--limit", str(limit)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
    )
    if done.returncode:
        sys.exit(done.stderr)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def measure(name: str, seed: int, limit: float) -> dict[str, float]:
    """Run a mission, and return its simulated seconds and CPU seconds, in all and by part."""
    import time

    time.perf_counter = time.thread_time  # before any module of the run takes the clock
    from picktree.session.session import RunRequest, Session

    mission, scene, backend = RUNS[name]
    path = Path(__file__).resolve().parent.parent / "examples" / f"{mission}.yaml"
    with tempfile.TemporaryDirectory() as folder:
        session = Session(
            RunRequest(path, scene=scene, seed=seed, backend=backend, out=Path(folder), limit=limit)
        )
        began = time.process_time()
        result = session.run()
        cpu = time.process_time() - began
    seconds = session.timer.stopwatch.seconds()
    parts = {part: seconds.get(part, 0.0) for part in PARTS[:-1]}
    return {
        "simulated": result.sim_seconds,
        "cpu": cpu,
        "rest": cpu - sum(parts.values()),
        **parts,
    }


if __name__ == "__main__":
    main()
