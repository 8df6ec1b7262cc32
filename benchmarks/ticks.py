"""CPU time of the ticking thread while the arm moves, without simulated physics and rendering.

    python benchmarks/ticks.py sort_past_obstacles sort_tirelessly --seeds 5
    python benchmarks/ticks.py benchmarks/soak/sort_on.yaml --limit 300 --aside 60
    python benchmarks/ticks.py benchmarks/soak/sort_on.yaml --limit 300 --aside 100 --in-turn
    python benchmarks/ticks.py --aged benchmarks/results/soak/sort_on-0-… --limit 1800

A tick counts when the arm moves at its beginning: only then must the next set point come in time. With
`--aside` so many further items lie on the table from the beginning and are set aside in the belief. With
`--aged` a run goes on from its last checkpoint, beside the same run from its beginning; with `--in-turn` one
with items aside, beside one without. They take turns of a simulated minute; their whole ticks are compared.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from picktree.files import PicktreeError
from picktree.robot.control import control_loop
from picktree.session import Execution, ResumeRequest, Resumption, RunRequest
from picktree.session.run_recipe import read_recipe
from picktree.world import Stopwatch, computing_time
from picktree.world.world_facts import ASIDE

import numpy as np
import yaml

ROOT = Path(__file__).resolve().parent.parent
AREA = {"min": [0.67, -0.62], "max": [0.9, 0.62]}
"""Part of the table on which items are set aside, m: behind the loads of a feed, in sight of the camera."""
MINUTE = 60.0
"""Simulated s after which the other run has its turn."""


class ThreadClock:
    """The module `time` with the CPU time of the thread as its performance counter."""

    perf_counter = staticmethod(time.thread_time)


def request(mission: Path, seed: int, limit: float, aside: int, folder: Path) -> RunRequest:
    if not aside:
        return RunRequest(mission=mission, seed=seed, limit=limit)
    scene = str(yaml.safe_load(mission.read_text())["scene"])
    base = str(mission.parent.resolve() / scene) if scene.endswith(".yaml") else scene
    spawn = [
        {
            "of": {"block": aside // 2, "brick": aside - aside // 2},
            "colours": ["red"],
            "area": AREA,
            "gap": "10 mm",
        }
    ]
    path = folder / "aside.yaml"
    path.write_text(yaml.safe_dump({"picktree": 1, "kind": "scene", "base": base, "spawn": spawn}))
    return RunRequest(mission=mission, scene=str(path), seed=seed, limit=limit)


def started(job: RunRequest, aside: int, stopwatch: Stopwatch) -> tuple[Execution, int]:
    """Return the run before its first tick, and the number of its set-aside items."""
    run = Execution(read_recipe(job), stopwatch=stopwatch, planning_worker=True)
    scene = run.world.scene
    if aside:
        for _ in run.world.vision.observe("overhead"):
            pass
        for item in [o for o in scene.objects if o.role == "item"]:
            scene.put(replace(item, place=ASIDE), "set aside")
    return run, sum(o.place == ASIDE for o in scene.objects)


def ticks(job: RunRequest, aside: int) -> tuple[list[float], list[float], int]:
    """CPU times of the moving ticks and of all ticks, s, and the number of set-aside items."""
    stopwatch = Stopwatch()
    run, put = started(job, aside, stopwatch)
    moving, every = list[float](), list[float]()
    while True:
        moves = not run.world.control.at_rest
        before, began = stopwatch.seconds(), time.thread_time()
        run.tick()
        if run.status is not None:
            return moving, every, put
        run.pass_time()
        spent, after = time.thread_time() - began, stopwatch.seconds()
        spent -= sum(after.get(part, 0.0) - before.get(part, 0.0) for part in ("physics", "rendering"))
        every.append(spent)
        if moves:
            moving.append(spent)


def in_turn(young: Execution, old: Execution, limit: float) -> str:
    """Return the CPU times of whole ticks of two runs as a table; they take turns of a simulated minute."""
    runs = {"young": young, "old": old}
    times = {name: list[float]() for name in runs}
    for _ in range(math.ceil(limit / MINUTE)):
        for name, run in runs.items():
            until = run.world.clock.now + MINUTE
            while run.world.clock.now < until:
                began = time.thread_time()
                run.tick()
                if run.status is not None:
                    raise PicktreeError(f"the {name} run ended: {run.status}")
                run.pass_time()
                times[name].append(1000 * (time.thread_time() - began))
    figures = {
        name: np.array([np.mean(ms), np.median(ms), np.percentile(ms, 99.9)]) for name, ms in times.items()
    }
    rows = {**figures, "ratio": figures["old"] / figures["young"]}
    head = f"{len(times['old'])} ticks each    mean    median    99.9th percentile"
    return "\n".join(
        [head, *(f"  {name:<16}" + "".join(f"{x:8.2f}" for x in row) for name, row in rows.items())]
    )


def aged(log: Path, limit: float) -> str:
    """Return the table of a run that goes on from its last checkpoint, beside its beginning."""
    with Resumption(ResumeRequest(log, limit=math.inf)) as resumption:
        old = Execution(resumption.recipe)
        old.tree.look()
        old.pass_time()  # completes the tick of the checkpoint
        return in_turn(Execution(replace(resumption.recipe, start=None)), old, limit)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("missions", nargs="*")
    parser.add_argument("--aged", type=Path, metavar="RUN", help="folder or log of a run that goes on")
    parser.add_argument("--in-turn", action="store_true", help="compare runs with and without --aside")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first", type=int, default=11, help="first seed")
    parser.add_argument("--limit", type=float, default=60.0, help="simulated seconds of a run")
    parser.add_argument("--aside", type=int, default=0)
    options = parser.parse_args()
    if options.aged is not None:
        print(aged(options.aged, options.limit))
        return
    computing_time.time = ThreadClock  # type: ignore[assignment]
    control_loop.perf_counter = time.thread_time
    for name in options.missions:
        mission = Path(name) if name.endswith(".yaml") else ROOT / "examples" / f"{name}.yaml"
        moving, every, put = list[float](), list[float](), 0
        if options.in_turn:
            with tempfile.TemporaryDirectory() as folder:
                one, other = (
                    started(request(mission, options.first, math.inf, n, Path(folder)), n, Stopwatch())
                    for n in (0, options.aside)
                )
                table = in_turn(one[0], other[0], options.limit)
            print(f"{mission.stem}, {other[1]} set aside\n{table}", flush=True)
            continue
        with tempfile.TemporaryDirectory() as folder:
            for seed in range(options.first, options.first + options.seeds):
                job = request(mission, seed, options.limit, options.aside, Path(folder))
                some, all_, put = ticks(job, options.aside)
                moving += some
                every += all_
        ms = np.array(moving) * 1000
        print(
            f"{mission.stem}: {len(ms)} moving ticks, median {np.median(ms):.1f} ms, "
            f"99.9th percentile {np.percentile(ms, 99.9):.1f} ms, longest {ms.max():.1f} ms, "
            f"above 20 ms: {int((ms > 20).sum())}, above 40 ms: {int((ms > 40).sum())}; "
            f"all {len(every)} ticks: mean {1000 * sum(every) / len(every):.2f} ms; {put} set aside",
            flush=True,
        )


if __name__ == "__main__":
    main()
