"""Campaign: things that nobody has catalogued are taken out of a heap; how many, and what goes wrong.

    python benchmarks/heaps.py --runs 20 --first 100
    python benchmarks/heaps.py --runs 20 --first 100 --friction 0.3
    python benchmarks/heaps.py --scene pile --runs 40 --first 200
    python benchmarks/heaps.py --scene packed --runs 40 --first 200

A scene with a tote is emptied by `examples/empty_the_tote.yaml`. On a table each run is a round after VGN's
protocol (Breyer et al., CoRL 2020): five to ten things, and the end after two failures in a row. It runs
`examples/clear_the_pile.yaml`.

A grasp is a closing of the fingers. It succeeds when the thing is still held after the transport, just before
the hand opens above the bin. Cleared are things that end in any bin, as the simulator has them. Runs with
another noise, camera or friction are laid on the scene: the robot is not told of them.
"""

from __future__ import annotations

import itertools
import json
import random
import re
import sys
from collections import Counter
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

from _campaign import ROOT, MissionJob, Row, campaign, finished, mission_options, rate, seeds
from picktree.world.event_types import ItemDoneEvent, PickEvent

import numpy as np
import yaml

if TYPE_CHECKING:
    from picktree.analysis import Run
    from picktree.session import RunRequest

DOUBLE = "grasp.double"
"""Cause of a failure for more than one thing in the hand."""
IN_THE_AIR = 0.17
"""Height of an item's origin from which on it lies in no bin, m."""
COST_A_RUN = 60.0
"""CPU seconds of 18 things, for the forecast."""
ROUND_THINGS = (5, 10)
"""Least and greatest number of things of a round on the table."""
ROUND = {"Recover.attempts": "2", "PickAny.attempts": "1"}
"""Settings of a round: the second failure in a row ends it."""


@dataclass(frozen=True)
class Job(MissionJob):
    noise: float | None
    """Noise of the overhead camera's depth, m; None: as the scene has it."""
    camera_off: float
    """Distance by which the overhead camera hangs off, m."""
    friction: float | None
    """Friction of the things; None: as the scene has it."""
    robot: str | None
    """Name or file of the robot; None: as the scene has it."""
    half_size: bool
    """Whether the overhead camera has half as many pixels along each side."""
    tilt: bool
    """Whether the hand may lean at a grasp."""
    stir: bool
    """Whether the mission stirs."""


def one(job: Job, folder: Path) -> Row:
    """Run one seed; its counts by the scorer, and its grasps by the log."""
    from picktree.analysis import Run
    from picktree.session import Session
    from picktree.simulation import score

    request = _request(job, folder)
    session = Session(request)
    with _approaches(job):
        result = session.run()
    execution = session.execution
    truth = execution.hardware.truth()
    scored = score(truth, execution.recipe.scene)
    bins = {bin_.id for bin_ in execution.recipe.scene.bins if not bin_.is_tote}
    by_class: dict[str, Counter[str]] = {}
    for body, item in zip(truth, scored.items, strict=True):
        by_class.setdefault(body.colour, Counter())[item.verdict] += 1
    with Run(result.folder) as run:
        picks = tuple(_picks(run))
        forces = run.wrenches.forces
    return {
        "classes": by_class,
        "cleared": sum(item.bin in bins for item in scored.items),
        "total": len(scored.items),
        "grasps": [[pick.stage, pick.end] for pick in picks],
        "doubles": [[pick.carried, pick.noticed] for pick in picks if pick.end != "missed"],
        "failures": dict(result.failures),
        "ended": result.message,
        "crushed": len(result.crushed),
        "force": round(float(np.linalg.norm(forces, axis=1).max(initial=0.0)), 1),
        "seconds": round(result.sim_seconds, 2),
        "cpu": round(result.cpu_seconds, 2),
        "digest": result.digest[:16],
    }


@dataclass(frozen=True)
class _Grasp:
    """Closing of the fingers, with what came of it."""

    stage: str
    end: str
    """`carried`, `lost` or `missed`."""
    carried: int
    """Greatest number of things that truly hung on the hand at once, in the log's samples of the truth."""
    noticed: bool
    """Whether the robot noticed more than one thing."""


def _picks(run: Run) -> Iterator[_Grasp]:
    """Yield the closings of a run, by its log."""
    picks = [at for at in run.events if isinstance(at.record, PickEvent)]
    done = {at.record.object: at.time for at in run.events if isinstance(at.record, ItemDoneEvent)}
    doubles = [visit.end for visit in run.visits if visit.failed_itself and visit.cause == DOUBLE]
    for pick, following in itertools.zip_longest(picks, picks[1:]):
        record = pick.record
        assert isinstance(record, PickEvent)
        until = run.end if following is None else following.time
        end = "carried" if record.object in done else "lost" if record.held else "missed"
        carried = _in_the_air(run, pick.time, min(until, done.get(record.object, until)))
        noticed = any(pick.time <= at < until for at in doubles)
        yield _Grasp(_stage(record.candidate), end, carried, noticed)


def _in_the_air(run: Run, start: float, end: float) -> int:
    """Return the greatest number of items that were above all bins at one time: the hand carries them."""
    return max(
        (
            sum(body.pose.position[2] > IN_THE_AIR for body in truth.record.bodies)
            for truth in run.log.truths(start, end)
        ),
        default=0,
    )


def _stage(candidate: str) -> str:
    """Return the stage of the search from which a grasp comes: its name begins with it."""
    return candidate.split(" yaw ")[0].split(" to ")[0]


def _request(job: Job, folder: Path) -> RunRequest:
    """Return the request of one run; a heap on a table is a round."""
    from picktree.session import RunRequest
    from picktree.world.scene import load_scene

    scene = load_scene(job.scene)
    heap = next(spawn for spawn in scene.spawn if spawn.drop is not None)
    if heap.into is not None:
        laid = _scene(job, folder, {})
        return RunRequest(_mission(job, folder), laid, seed=job.seed, out=folder)
    spawn = yaml.safe_load(scene.text)["spawn"]
    spawn[scene.spawn.index(heap)]["of"] = {"assortment": random.Random(job.seed).randint(*ROUND_THINGS)}
    laid = _scene(job, folder, {"spawn": spawn})
    mission = ROOT / "examples" / "clear_the_pile.yaml"
    return RunRequest(mission, laid, seed=job.seed, out=folder, parameters=ROUND)


@contextmanager
def _approaches(job: Job) -> Generator[None]:
    """Limit the search to a hand that does not lean, where the job says so."""
    from picktree.robot.manipulation import heap_pick
    from picktree.robot.manipulation.heap_grasps import LOOSE_TIER, STRICT_TIER, VERTICAL, grasps

    upright = [(STRICT_TIER, (VERTICAL,)), (LOOSE_TIER, (VERTICAL,))]
    search = grasps if job.tilt else partial(grasps, stages=upright)
    with patch.object(heap_pick, "grasps", search):
        yield


def _mission(job: Job, folder: Path) -> Path:
    """Return the mission; where nothing is stirred, with a failure in the place of each `Stir`."""
    mission = Path(job.mission)
    if job.stir:
        return mission
    text = re.sub(r"Stir: \{[^}]*\}", "AlwaysFailure: {}", mission.read_text())
    folder.mkdir(parents=True, exist_ok=True)
    without = folder / mission.name
    without.write_text(text)
    return without


def _scene(job: Job, folder: Path, change: dict[str, Any]) -> str:
    """Return the scene, with a change and another camera, friction or robot laid on it."""
    camera: dict[str, Any] = {}
    if job.noise is not None:
        camera["depth_noise"] = job.noise
    if job.camera_off:
        camera["error"] = [job.camera_off, 0.0, 0.0]
    if job.half_size:
        camera["size"] = [320, 240]
    change = change | ({"cameras": {"overhead": camera}} if camera else {})
    if job.friction is not None:
        change["assortment"] = {"friction": job.friction}
    if job.robot is not None:
        change["robot"] = job.robot
    if not change:
        return job.scene
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "scene.yaml"
    path.write_text(json.dumps({"picktree": 1, "kind": "scene", "base": job.scene} | change))
    return str(path)


def report(rows: list[Row]) -> str:
    done = finished(rows)
    grasps = [(stage, end) for row in done for stage, end in row["grasps"]]
    classes: dict[str, Counter[str]] = {}
    failures: Counter[str] = Counter()
    for row in done:
        failures.update(row["failures"])
        for name, verdicts in row["classes"].items():
            classes.setdefault(name, Counter()).update(verdicts)
    verdicts = sum(classes.values(), Counter[str]())
    total = sum(row["total"] for row in done)
    carried = sum(end == "carried" for _, end in grasps)
    lines = [
        f"runs {len(rows)}, crashed {len(rows) - len(done)}",
        rate("held after transport", carried, len(grasps)),
        *_by_stage(grasps),
        rate("held after the lift", sum(end != "missed" for _, end in grasps), len(grasps)),
        rate("  lost in transport", sum(end == "lost" for _, end in grasps), len(grasps)),
        f"ended by a failure: {sum(bool(row['ended']) for row in done)} of {len(done)} runs",
        *_doubles([(carried, noticed) for row in done for carried, noticed in row["doubles"]]),
        rate("cleared", sum(row["cleared"] for row in done), total),
        rate("sorted", verdicts["sorted"], total),
        *(rate(f"  {name}", by["sorted"], by.total()) for name, by in sorted(classes.items())),
        rate("misplaced", verdicts["misplaced"], total),
        rate("left", verdicts["left"], total),
        rate("crushed", sum(row["crushed"] for row in done), total),
        "failures by cause: " + (", ".join(f"{c} {n}" for c, n in failures.most_common()) or "none"),
        f"largest force at the wrist: {max((row['force'] for row in done), default=0.0):.1f} N",
    ]
    for words, key in (("simulated", "seconds"), ("CPU", "cpu")):
        seconds = sum(row[key] for row in done)
        lines.append(f"{words} seconds a carried thing: {seconds / max(1, carried):.2f}, all {seconds:.0f}")
    return "\n".join(lines + [f"  seed {row['seed']}: {_short(row)}" for row in done])


def _by_stage(grasps: Iterable[tuple[str, str]]) -> list[str]:
    """Return a line for each stage of the search, in the order of their grasps."""
    found: dict[str, list[bool]] = {}
    for stage, end in grasps:
        found.setdefault(stage, []).append(end == "carried")
    return [rate(f"  {stage}", sum(ends), len(ends)) for stage, ends in found.items()]


def _doubles(held: list[tuple[int, bool]]) -> list[str]:
    """Return how often more than one thing was held, and how often the robot noticed, rightly or not."""
    several = [noticed for carried, noticed in held if carried > 1]
    single = [noticed for carried, noticed in held if carried <= 1]
    return [
        rate("more than one thing held", len(several), len(held)),
        rate("  noticed", sum(several), len(several)),
        rate("  falsely noticed", sum(single), len(single)),
    ]


def _short(row: Row) -> str:
    ends = Counter(end for _, end in row["grasps"])
    placed = sum(verdicts.get("sorted", 0) for verdicts in row["classes"].values())
    return (
        f"{placed} of {row['total']} sorted, {row['cleared']} cleared; grasps "
        + ", ".join(f"{n} {end}" for end, n in ends.most_common())
        + f"; {row['seconds']:.0f} s, {row['cpu']:.0f} CPU s, {row['force']:.0f} N"
    )


def main() -> int:
    options = mission_options(__file__, __doc__, "empty_the_tote", "tote", runs=20)
    options.add_argument("--noise", type=float, metavar="M", help="noise of the depth at 0.7 m")
    options.add_argument("--camera-off", type=float, default=0.0, metavar="M", help="the camera hangs off")
    options.add_argument("--friction", type=float, metavar="MU", help="friction of the things")
    options.add_argument("--robot", metavar="R", help="name or file of another robot than the scene's")
    options.add_argument("--half-size", action="store_true", help="overhead pictures of 320 × 240")
    options.add_argument("--no-tilt", action="store_true", help="the hand does not lean")
    options.add_argument("--no-stir", action="store_true", help="nothing is stirred")
    given = options.parse_args()
    changes = (
        given.noise,
        given.camera_off,
        given.friction,
        given.robot,
        given.half_size,
        not given.no_tilt,
        not given.no_stir,
    )
    jobs = [Job(given.mission, given.scene, seed, *changes) for seed in seeds(given)]
    print(report(campaign(given, jobs, one, cost=COST_A_RUN, short=_short)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
