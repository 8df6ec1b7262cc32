"""Campaign: things that nobody has catalogued are taken out of a tote; how many, and what goes wrong.

    python benchmarks/heaps.py --runs 20 --first 100
    python benchmarks/heaps.py --runs 20 --first 100 --friction 0.3

A grasp is a closing of the fingers. It succeeds when the thing is still held after the transport, just before
the hand opens above the bin. Cleared are things that end in any bin, as the simulator has them. Runs with
another noise, camera or friction are laid on the scene: the robot is not told of them.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from _campaign import MissionJob, Row, campaign, finished, mission_options, rate, seeds
from picktree.world.events.skill_events import ItemDoneEvent, PickEvent

import numpy as np

COST_A_RUN = 60.0
"""CPU seconds of 18 things, for the forecast."""


@dataclass(frozen=True)
class Job(MissionJob):
    noise: float | None
    """Noise of the overhead camera's depth, m; None: as the scene has it."""
    camera_off: float
    """Distance by which the overhead camera hangs off, m."""
    friction: float | None
    """Friction of the things; None: as the scene has it."""


def one(job: Job, folder: Path) -> Row:
    """Run one seed; its counts by the scorer, and its grasps by the log."""
    from picktree.analysis.run import Run
    from picktree.session.session import RunRequest, Session
    from picktree.simulation.scoring.scorer import score

    request = RunRequest(mission=Path(job.mission), scene=_scene(job, folder), seed=job.seed, out=folder)
    session = Session(request)
    result = session.run()
    execution = session.execution
    truth = execution.hardware.truth()
    scored = score(truth, execution.recipe.scene)
    bins = {bin_.id for bin_ in execution.recipe.scene.bins if not bin_.is_tote}
    by_class: dict[str, Counter[str]] = {}
    for body, item in zip(truth, scored.items, strict=True):
        by_class.setdefault(body.colour, Counter())[item.verdict] += 1
    with Run(result.folder) as run:
        picks = [at.record for at in run.events if isinstance(at.record, PickEvent)]
        placed = {at.record.object for at in run.events if isinstance(at.record, ItemDoneEvent)}
        forces = run.wrenches.forces
    return {
        "classes": by_class,
        "cleared": sum(item.bin in bins for item in scored.items),
        "total": len(scored.items),
        "grasps": [[_stage(pick.candidate), _end(pick, placed)] for pick in picks],
        "failures": dict(result.failures),
        "crushed": len(result.crushed),
        "force": round(float(np.linalg.norm(forces, axis=1).max(initial=0.0)), 1),
        "seconds": round(result.sim_seconds, 2),
        "cpu": round(result.cpu_seconds, 2),
        "digest": result.digest[:16],
    }


def _end(pick: PickEvent, placed: set[str]) -> str:
    return "carried" if pick.object in placed else "lost" if pick.held else "missed"


def _stage(candidate: str) -> str:
    """Return the stage of the search from which a grasp comes: its name begins with it."""
    return candidate.split(" yaw ")[0].split(" to ")[0]


def _scene(job: Job, folder: Path) -> str:
    """Return the scene, with another camera or friction laid on it."""
    camera: dict[str, Any] = {}
    if job.noise is not None:
        camera["depth_noise"] = job.noise
    if job.camera_off:
        camera["error"] = [job.camera_off, 0.0, 0.0]
    patch: dict[str, Any] = {"cameras": {"overhead": camera}} if camera else {}
    if job.friction is not None:
        patch["assortment"] = {"friction": job.friction}
    if not patch:
        return job.scene
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "scene.yaml"
    path.write_text(json.dumps({"picktree": 1, "kind": "scene", "base": job.scene} | patch))
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
    given = options.parse_args()
    changes = (given.noise, given.camera_off, given.friction)
    jobs = [Job(given.mission, given.scene, seed, *changes) for seed in seeds(given)]
    print(report(campaign(given, jobs, one, cost=COST_A_RUN, short=_short)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
