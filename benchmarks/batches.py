"""What a batch costs beyond its jobs, and what two workers gain over one.

Phases, each done once and kept in the folder, so that a campaign that was interrupted goes on: half of a
sample of the jobs alone, each in a process of its own that has loaded what a worker loads; half of it as a
batch on one worker; all jobs as a batch on all workers; then the other halves.

Efficiency: wall time on one worker, scaled from the sample to all jobs by their simulated time, over the wall
time on all workers times their number. CPU: of the whole batch, the batch's own process and its workers
without their start-up, over that of the jobs alone, scaled likewise. The digests of the sample must be equal.

python benchmarks/batches.py --runs 200
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from _campaign import ROOT, rate

COST = {"sort_small": 2.5, "three_bins": 7.0}
"""CPU seconds of a run with physics, for the forecast."""


@dataclass(frozen=True)
class Alone:
    """One job in a process of its own, without the process's start-up."""

    seed: int
    digest: str
    cpu: float
    wall: float
    simulated: float


@dataclass(frozen=True)
class Together:
    """A batch."""

    seeds: list[int]
    workers: int
    wall: float
    """From the moment at which the first job began to the end of the last."""
    cpu: float
    """Of all its processes, start-up included."""
    simulated: float
    successes: int
    digests: dict[str, str]
    """By seed."""


@dataclass(frozen=True)
class Settings:
    mission: str
    scene: str
    backend: str
    out: Path


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--sample", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--mission", default=str(ROOT / "examples" / "sort_by_colour.yaml"))
    parser.add_argument("--scene", default="three_bins")
    parser.add_argument("--backend", choices=("physics", "kinematic"), default="physics")
    parser.add_argument("--out", default=str(ROOT / "runs" / "batches"))
    parser.add_argument("--alone", nargs=2, metavar=("SEED", "FOLDER"), help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    settings = Settings(chosen.mission, chosen.scene, chosen.backend, Path(chosen.out))
    if chosen.alone:
        print(json.dumps(asdict(run_alone(settings, int(chosen.alone[0]), Path(chosen.alone[1])))))
        return 0
    each = COST.get(chosen.scene, 7.0)
    cpu = each * (chosen.runs + 2 * chosen.sample) + 4.0 * (chosen.sample + 8)
    wall = each * chosen.runs / chosen.workers + (2 * each + 4.0) * chosen.sample + 40.0
    print(f"about {cpu / 60:.0f} CPU minutes in {wall / 60:.0f} minutes, on a quiet machine", flush=True)
    seeds = list(range(chosen.runs))
    sample = seeds[:: max(1, chosen.runs // chosen.sample)][: chosen.sample]
    halves = (sample[: len(sample) // 2], sample[len(sample) // 2 :])
    settings.out.mkdir(parents=True, exist_ok=True)
    start = phase(settings, "start-up", lambda: start_up())
    alone: list[Alone] = []
    ones: list[Together] = []
    two: Together | None = None
    for n, half in enumerate(halves):
        found = phase(settings, f"alone-{n}", lambda half=half: [asdict(apart(settings, s)) for s in half])
        alone += [Alone(**row) for row in found]
        ones.append(
            Together(
                **phase(settings, f"one-{n}", lambda half=half, n=n: batch(settings, f"one-{n}", half, 1))
            )
        )
        if n == 0:
            made = phase(settings, "all", lambda: batch(settings, "all", seeds, chosen.workers))
            two = Together(**made)
    assert two is not None
    print(report(alone, ones, two, start))
    return 0 if all(two.digests[str(a.seed)] == a.digest for a in alone) else 1


def phase(settings: Settings, name: str, doing: Callable[[], Any]) -> Any:
    """What it came to, or had come to before."""
    kept = settings.out / f"{name}.json"
    if not kept.exists():
        began = time.monotonic()
        found = doing()
        beside = kept.with_suffix(".part")
        beside.write_text(json.dumps(found))
        beside.rename(kept)
        print(f"  {name}: {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    return json.loads(kept.read_text())


def start_up() -> float:
    """CPU s that a worker takes until it is ready."""
    from picktree.apps.batch.local_executor import serve

    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    process = context.Process(target=serve, args=(theirs,))
    process.start()
    theirs.close()
    ours.recv()
    ours.close()
    process.join()
    return spent(resource.getrusage(resource.RUSAGE_CHILDREN)) - spent(before)


def apart(settings: Settings, seed: int) -> Alone:
    arguments = [sys.executable, __file__, "--mission", settings.mission, "--scene", settings.scene]
    arguments += ["--backend", settings.backend, "--alone", str(seed), str(settings.out / "alone")]
    done = subprocess.run(arguments, capture_output=True, text=True, check=True)
    return Alone(**json.loads(done.stdout.splitlines()[-1]))


def run_alone(settings: Settings, seed: int, out: Path) -> Alone:
    from picktree.apps.batch import local_executor
    from picktree.session import RunRequest, Session

    local_executor.load()
    cpu, wall = time.process_time(), time.perf_counter()
    request = RunRequest(
        Path(settings.mission),
        scene=settings.scene,
        seed=seed,
        backend=settings.backend,  # type: ignore[arg-type]
        out=out,
    )
    result = Session(request).run()
    return Alone(
        seed, result.digest, time.process_time() - cpu, time.perf_counter() - wall, result.sim_seconds
    )


def batch(settings: Settings, name: str, seeds: list[int], workers: int) -> dict[str, Any]:
    """Begun anew: its wall time is of one go."""
    folder = settings.out / f"{name}-{time.strftime('%Y%m%d-%H%M%S')}"
    command = [sys.executable, "-m", "picktree", "batch", "run", "--json", "--mission", settings.mission]
    command += ["--scene", settings.scene, "--backend", settings.backend, "--workers", str(workers)]
    command += ["--seeds", ",".join(map(str, seeds)), "--out", str(folder), "--keep", "failures"]
    before = spent(resource.getrusage(resource.RUSAGE_CHILDREN))
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    ends: list[tuple[float, dict[str, Any]]] = []
    for line in process.stdout:
        event = json.loads(line)
        if event["event"] == "ended":
            ends.append((time.monotonic(), event))
    if process.wait() not in (0, 1):
        raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}")
    cpu = spent(resource.getrusage(resource.RUSAGE_CHILDREN)) - before
    from picktree.apps.batch import RESULTS_FILE, Store

    first_job = ends[0][1]["job"]
    with Store(folder / RESULTS_FILE) as store:
        row = store.query(f"SELECT wall_seconds FROM jobs WHERE job = '{first_job}'").rows[0]
    return asdict(
        Together(
            seeds,
            workers,
            ends[-1][0] - (ends[0][0] - float(str(row[0]))),
            cpu,
            sum(event["sim_seconds"] for _, event in ends),
            sum(event["status"] == "success" for _, event in ends),
            {str(event["seed"]): event["digest"] for _, event in ends},
        )
    )


def spent(usage: resource.struct_rusage) -> float:
    return usage.ru_utime + usage.ru_stime


def report(alone: list[Alone], ones: list[Together], two: Together, start: float) -> str:
    jobs = len(two.seeds)
    one_wall, one_simulated = sum(o.wall for o in ones), sum(o.simulated for o in ones)
    scaled = one_wall * two.simulated / one_simulated
    alone_cpu = sum(a.cpu for a in alone)
    alone_scaled = alone_cpu * two.simulated / sum(a.simulated for a in alone)
    without = two.cpu - two.workers * start
    equal = sum(two.digests[str(a.seed)] == a.digest for a in alone)
    sample = sum(len(o.seeds) for o in ones)
    return "\n".join(
        [
            f"jobs on {two.workers} workers            {jobs} in {two.wall:.0f} s: "
            f"{3600 * jobs / two.wall:.0f} jobs an hour",
            rate("goal reached", two.successes, jobs),
            f"on one worker                {sample} in {one_wall:.0f} s; scaled to all {scaled:.0f} s",
            f"efficiency                   {scaled / (two.workers * two.wall):.3f}",
            f"CPU of the batch             {without:.0f} s, and {two.workers} x {start:.1f} s of start-up",
            f"CPU of {len(alone)} jobs alone          {alone_cpu:.0f} s; scaled to all {alone_scaled:.0f} s",
            f"CPU of batch over jobs       {without / alone_scaled:.3f}",
            f"digests equal to serial runs {equal} of {len(alone)}",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
