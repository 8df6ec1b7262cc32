"""Campaign: many simulations of one program, on worker processes or a Ray cluster.

A campaign goes on where it stopped, in one folder. `results.jsonl` has a line for each finished run
(`_campaign_results.py`): its job, the commit, a digest of the sources, its CPU time, and its row. Results of
other sources are not counted: their jobs run again, unless --mixed is given. `logs` has a folder for each
run. Each run has a process of its own.
"""

from __future__ import annotations

import argparse
import fcntl
import hashlib
import json
import math
import os
import pickle
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from _campaign_results import REFERENCE_COST as REFERENCE_COST  # programs have it from here
from _campaign_results import Forecast, Results, Row, key, plain, source_digest
from picktree.apps.batch import Executor, LocalExecutor
from picktree.apps.batch.executor import JobFailed, JobFinished, JobOrder
from picktree.files import PicktreeError, restart
from picktree.logs import rate as batch_rate
from picktree.session.environment import hashes, revision

if TYPE_CHECKING:
    from picktree.analysis import Run

restart()

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"
"""Folder of all campaigns."""
CUT_OFF = "Cut off: "
"""Begin of the line that is printed before a result of fewer runs than were asked for."""
_WALL_LIMIT, _MEMORY_LIMIT = 4 * 3600.0, 8 * 10**9
"""Limits of one run: s, bytes."""


def options(
    file: str, words: str | None, *, runs: int | None, what: str = "seeds"
) -> argparse.ArgumentParser:
    """Return the options that all campaigns have; `what` is counted by --runs."""
    parser = argparse.ArgumentParser(description=words, formatter_class=argparse.RawDescriptionHelpFormatter)
    folder = RESULTS / Path(file).stem
    add = parser.add_argument
    add("--runs", type=int, default=runs, metavar="N", help=what + (f"; {runs} unless given" if runs else ""))
    add("--first", type=int, default=0, metavar="SEED", help="first seed")
    add("--workers", type=int, metavar="N", help="one for each core unless given")
    add("--minutes", type=float, metavar="M", help="wall time after which no run is begun or expected to end")
    add("--ray", metavar="ADDRESS", help="run on that Ray cluster (HOST:PORT, auto); local: start one here")
    add("--out", type=Path, default=folder, metavar="FOLDER", help=f"{folder.relative_to(ROOT)} unless given")
    add("--mixed", action="store_true", help="count results of other sources, too")
    return parser


def mission_options(
    file: str, words: str | None, mission: str, scene: str, *, runs: int
) -> argparse.ArgumentParser:
    """Return the options of campaigns that run a mission in a scene; `mission` is that of an example."""
    parser = options(file, words, runs=runs)
    parser.add_argument("--mission", default=str(ROOT / "examples" / f"{mission}.yaml"))
    parser.add_argument("--scene", default=scene, help=f"{scene} unless given")
    return parser


@dataclass(frozen=True)
class MissionJob:
    """Run of a mission in a scene."""

    mission: str
    scene: str
    seed: int


def mission_jobs(given: argparse.Namespace) -> list[MissionJob]:
    """Return the jobs of `mission_options`."""
    return [MissionJob(given.mission, given.scene, seed) for seed in seeds(given)]


def seeds(given: argparse.Namespace) -> range:
    """Return the seeds that were asked for."""
    return range(given.first, given.first + given.runs)


def campaign(
    given: argparse.Namespace,
    jobs: Sequence[Any],
    one: Callable[[Any, Path], Row],
    *,
    cost: float | Callable[[Any], float],
    short: Callable[[Row], object],
    order: Callable[[Any], int] = lambda job: 0,
) -> list[Row]:
    """Run the jobs that have no result in the folder yet, and return a row for each job that has one.

    They are run by `order`, and those of the same in an order without order: those of a campaign that is cut
    off are a sample of all.

    A row has the `seed` and the values of the `job`.

    one: carries a job out, with a folder for its logs. What it raises makes a row with `crash`; that job is
    tried again by the next start. cost: CPU seconds of a job on the reference machine, for the forecast until
    runs are recorded. short: what is printed of a finished row. Ends the program without any result.
    """
    try:
        with _locked(given.out) as folder:
            kept = Results(folder, reference(), _program(one), mixed=given.mixed)
            missing = sorted(filter(kept.to_do, jobs), key=lambda job: (order(job), _digest(plain(job))))
            forecast = Forecast(kept, cost)
            print(_plan(given, missing, jobs, kept, forecast), file=sys.stderr, flush=True)
            if missing:
                whole = _run(given, missing, one, kept, forecast, short)
                if not whole:
                    print("it was stopped: the same command goes on", file=sys.stderr)
    except PicktreeError as error:
        raise SystemExit(str(error)) from None
    rows = [row for job in jobs if (row := kept.row(job)) is not None]
    if not rows:
        raise SystemExit("there is no result yet")
    if len(rows) < len(jobs):
        print(f"{CUT_OFF}{len(rows)} of {len(jobs)} runs have a result.\n")
    return rows


def finished(rows: Iterable[Row]) -> list[Row]:
    """Return the rows without those that crashed, which are printed."""
    rows = list(rows)
    for row in rows:
        if "crash" in row:
            print(f"seed {row['seed']} crashed: {row['crash']}")
    return [row for row in rows if "crash" not in row]


def reference() -> float:
    """Return the CPU time of the reference, s: physics of a heap of balls, then arithmetic in Python."""
    import pybullet

    began = time.thread_time()
    client = pybullet.connect(pybullet.DIRECT)
    try:
        plane = pybullet.createCollisionShape(
            pybullet.GEOM_BOX, halfExtents=[1.0, 1.0, 0.01], physicsClientId=client
        )
        ball = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=0.03, physicsClientId=client)
        pybullet.createMultiBody(0.0, plane, physicsClientId=client)
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=client)
        for k in range(12):
            at = [0.05 * (k % 3), 0.05 * (k // 3 % 2), 0.05 + 0.07 * (k // 6)]
            pybullet.createMultiBody(0.1, ball, basePosition=at, physicsClientId=client)
        for _ in range(4000):
            pybullet.stepSimulation(physicsClientId=client)
    finally:
        pybullet.disconnect(client)
    numbers: dict[int, float] = {}
    for k in range(1_000_000):
        numbers[k % 997] = numbers.get(k % 991, 0.0) * 0.5 + k
    return time.thread_time() - began


def executor(given: argparse.Namespace) -> Executor:
    """Return the executor of the options --workers and --ray. The caller closes it."""
    if not given.ray:
        return LocalExecutor(given.workers)
    from picktree.apps.batch import RayExecutor

    return RayExecutor(given.workers, None if given.ray == "local" else given.ray)


def attempt(order: JobOrder) -> bytes:
    """Carry a job out in its worker; return its row with its CPU time. Called by the worker's process."""
    program, code, folder, content = pickle.loads(order.recipe.read_bytes())
    if source_digest(ROOT / program) != code:
        raise PicktreeError("the checkout of this machine is another than the one that deals the runs out")
    sys.path.insert(0, str((ROOT / program).parent))
    with suppress(OSError):
        os.chdir(folder)
    one, jobs = pickle.loads(content)
    job = jobs[order.seed]
    began = _cpu()
    row = {"seed": job.seed, **one(job, order.folder)}
    return json.dumps({"row": row, "cpu": _cpu() - began}).encode()


def _run(
    given: argparse.Namespace,
    jobs: Sequence[Any],
    one: Callable[[Any, Path], Row],
    results: Results,
    forecast: Forecast,
    short: Callable[[Row], object],
) -> bool:
    """Run the jobs; return False when stopped before the end."""
    began = time.monotonic()
    until = began + 60 * given.minutes if given.minutes is not None else math.inf
    recipe = _written_jobs(given.out, jobs, one, results.code)
    waiting, under_way = deque(enumerate(jobs)), dict[str, Any]()
    whole = True
    workers = executor(given)
    try:
        while waiting or under_way:
            while waiting and len(under_way) < workers.slots:
                number, job = waiting[0]
                late = time.monotonic() + forecast.of(job) > until
                edited = source_digest(_program(one)) != results.code
                if edited:
                    print("the checkout is being edited: no further run begins", file=sys.stderr)
                if late or edited:
                    waiting.clear()
                    whole = False
                    break
                waiting.popleft()
                order = _order(recipe, number, given.out / "logs" / f"{job.seed}-{_digest(plain(job))}")
                under_way[order.job] = job
                workers.submit(order)
            for event in workers.wait(1.0):
                job = under_way.pop(event.order.job)
                row, cpu = _outcome(event, job)
                results.add(job, row, cpu)
                left = forecast.total(job for _, job in waiting) / max(1, workers.slots) / 60
                told = row.get("crash") or short(row)
                print(f"  seed {row['seed']}: {told}; {left:.0f} min left", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        return False
    finally:
        workers.close()
        recipe.unlink(missing_ok=True)
    return whole


def _order(recipe: Path, number: int, folder: Path) -> JobOrder:
    program = str(Path(__file__).relative_to(ROOT))
    return JobOrder(
        str(number), 1, recipe, number, folder.absolute(), _WALL_LIMIT, _MEMORY_LIMIT, program=program
    )


def _outcome(event: object, job: Any) -> tuple[Row, float]:
    """Return the row of a job that has ended, and its CPU time, s."""
    match event:
        case JobFinished(order):
            found = json.loads(order.result.read_bytes())
            order.result.unlink()
            with suppress(OSError):
                order.folder.rmdir()  # unless there are logs
            return found["row"], found["cpu"]
        case JobFailed(_, reason):
            return {"seed": job.seed, "crash": reason}, 0.0
        case _:
            return {"seed": job.seed, "crash": "it was stopped"}, 0.0


def _written_jobs(folder: Path, jobs: Sequence[Any], one: Callable[[Any, Path], Row], code: str) -> Path:
    """Write the jobs for the workers, which import the program, the main module here, by its name.

    code: digest of the sources, which workers must have, too.
    """
    main, file = sys.modules["__main__"], _program(one)
    if one.__module__ == "__main__":
        sys.modules[file.stem] = main
        for value in vars(main).values():
            if getattr(value, "__module__", "") == "__main__" and isinstance(value, type | type(_run)):
                value.__module__ = file.stem
    program = file.relative_to(ROOT) if file.is_relative_to(ROOT) else file
    path = folder / f"jobs-{os.getpid()}.pickle"
    path.write_bytes(pickle.dumps((str(program), code, os.getcwd(), pickle.dumps((one, list(jobs))))))
    return path


def _plan(
    given: argparse.Namespace, missing: Sequence[Any], jobs: Sequence[Any], kept: Results, forecast: Forecast
) -> str:
    """Return what will be run, how long it takes, and what is there of other sources."""
    cpu = forecast.total(missing)
    workers = given.workers or (None if given.ray else len(os.sched_getaffinity(0)))
    lines = [f"{len(missing)} of {len(jobs)} runs to do, about {cpu / 60:.1f} CPU minutes"]
    if workers:
        lines[0] += f", {cpu / 60 / workers:.1f} minutes on {workers} workers of this machine"
    lines[0] += f"; {revision() or 'installed'}, results in {given.out}"
    if kept.others:
        counts = ", ".join(f"{count} of {commit}" for commit, count in kept.others.items())
        lines.append(f"results of other sources are not counted ({counts}); --mixed counts them")
    return "\n".join(lines)


@contextmanager
def _locked(folder: Path) -> Generator[Path]:
    """Lock the folder against a second campaign."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("a") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise PicktreeError(f"{folder}: another process runs this campaign") from None
        yield folder


def _program(one: Callable[[Any, Path], Row]) -> Path:
    """Return the file of a campaign's program."""
    return Path(sys.modules[one.__module__].__file__ or "").resolve()


def _digest(job: Mapping[str, Any]) -> str:
    return hashlib.sha256(key(job).encode()).hexdigest()[:6]


def _cpu() -> float:
    """Return the CPU time of this process and its ended children, s."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def explaining() -> str:
    """Return a hash of the sources that explain a log; no run depends on them."""
    files = sorted([*(ROOT / "analysis").rglob("*.py"), *(ROOT / "logs").rglob("*.py")])
    return hashlib.sha256(repr(hashes(files)).encode()).hexdigest()[:12]


def blind(folder: Path) -> Run:
    """Open a run whose log holds no word of a fault."""
    from picktree.analysis import Run
    from picktree.world.event_types import FaultEvent

    run = Run(folder)
    run.__dict__["events"] = tuple(at for at in run.events if not isinstance(at.record, FaultEvent))
    return run


def rate(name: str, hits: int, n: int) -> str:
    """Return a line with a share, its N and its 95 % interval."""
    of = batch_rate(hits, n).interval
    share = f"{100 * hits / n:6.2f} %" if n else "     –  "
    return (
        f"{name:<28} {hits:>5} of {n:<5} {share}   95 % interval {100 * of.low:.1f} … {100 * of.high:.1f} %"
    )


def split(rows: Iterable[Row], total: str) -> str:
    """Shares of wall time by part."""
    sums: dict[str, float] = {}
    for row in rows:
        for part, seconds in row.items():
            sums[part] = sums.get(part, 0.0) + seconds
    whole = sums.pop(total)
    return ", ".join(f"{part} {100 * seconds / whole:.0f} %" for part, seconds in sums.items())
