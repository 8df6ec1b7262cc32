"""Campaign: sorting with cameras that hang 8 mm and 2° from where they are believed to hang, with and
without a camera on the hand that looks before each grasp.

    python benchmarks/servoing.py --runs 40

Direction of the shift and axis of the turn are drawn for each seed and camera, evenly over all directions;
nobody tells the robot. Each seed's items are sorted in five settings: the overhead camera right or off and
nobody looks again; and with the camera on the hand the overhead camera off, the hand's camera off, and both.
Two of the six items are cartons of 66 mm: fingers that open by 80 mm have 7 mm to spare at each side.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from _campaign import ROOT, Row, campaign, options, rate, seeds

import numpy as np

if TYPE_CHECKING:
    from picktree.world import Array, Vector3

COST_A_SEED = 28.0
"""CPU seconds that five runs of six items take, for the forecast."""
SHIFT, TURN = 0.008, math.radians(2.0)
SETTINGS = {
    "exact, believed": (False, ()),
    "overhead off, believed": (False, ("overhead",)),
    "overhead off, servoing": (True, ("overhead",)),
    "hand's off, servoing": (True, ("wrist",)),
    "both off, servoing": (True, ("overhead", "wrist")),
}
"""Whether there is a camera on the hand, and which cameras are off."""
KEPT = ("status", "items", "picks", "failures", "sim_seconds", "cpu_seconds")
"""Fields of a run's result that a row keeps."""
SCENE = """\
picktree: 1
kind: scene
base: {base}
{cameras}
catalogue:
  carton: {{box: [66 mm, 66 mm, 40 mm], mass: 150 g, friction: 0.6}}
spawn:
  - of: {{carton: 2, brick: 1, can: 1, plate: 1, nut: 1}}
    colours: [red, green, blue]
    area: {{min: [0.38, -0.20], max: [0.62, 0.20]}}
    gap: 25 mm
    lying: 0.35
"""


@dataclass(frozen=True)
class Job:
    mission: str
    seed: int
    shift: float
    turn: float


def errors(seed: int, shift: float, turn: float) -> dict[str, str]:
    """Return the errors of each camera, as text of a scene file."""
    rng = np.random.default_rng([seed, 2026])
    told: dict[str, str] = {}
    for camera in ("overhead", "wrist"):
        way, axis = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
        offset = ", ".join(f"{c:.6f}" for c in way * shift)
        rpy = ", ".join(f"{c:.6f}" for c in _rpy(axis, turn))
        told[camera] = f"  {camera}: {{error: {{offset: [{offset}], rpy: [{rpy}]}}}}"
    return told


def _rpy(axis: Array, turn: float) -> Vector3:
    """Roll, pitch and yaw of a turn about a unit axis (3,), rad."""
    from picktree.world import Pose

    x, y, z = (float(c) * math.sin(turn / 2) for c in axis)
    return Pose(orientation=(x, y, z, math.cos(turn / 2))).rpy()


def one(job: Job, folder: Path) -> Row:
    """Run all settings of one seed."""
    return {"settings": {name: _run(job, folder, name) for name in SETTINGS}}


def _run(job: Job, folder: Path, setting: str) -> Row:
    from picktree.session import RunRequest, Session

    on_hand, off = SETTINGS[setting]
    wrong = errors(job.seed, job.shift, job.turn)
    cameras = "\n".join(["cameras:", *(wrong[camera] for camera in off)]) if off else ""
    name = f"{setting.replace(', ', '-').replace(' ', '_')}-{job.seed}".replace("'", "")
    file = folder / f"{name}.yaml"
    file.write_text(SCENE.format(base="three_bins_wrist" if on_hand else "three_bins", cameras=cameras))
    out = folder / f"run-{name}"
    result = Session(RunRequest(mission=Path(job.mission), scene=str(file), seed=job.seed, out=out)).run()
    told = result.to_json()
    return {**{key: told[key] for key in KEPT}, "aims": _aims(result.folder)}


def _aims(run: Path) -> list[float]:
    """Return the horizontal error of each item's believed position when the fingers closed on it, m.

    Belief and truth are those before the hand came. Among items that are alike the nearest one counts."""
    from picktree.logs import RunLog

    found: list[float] = []
    with RunLog(run) as log:
        before = next(iter(log.truths())).record.bodies
        free: dict[str, tuple[float, float]] = {}
        held: set[str] = set()
        for at in log.beliefs():
            for body in at.record.bodies:
                x, y, _ = body.pose.position
                if not body.attached:
                    free[body.id] = (x, y)
                elif body.id in free and body.id not in held:
                    held.add(body.id)
                    alike = [b for b in before if (b.kind, b.colour) == (body.kind, body.colour)]
                    away = [math.dist(free[body.id], b.pose.position[:2]) for b in alike]
                    found += [min(away)] if away else []
    return found


def report(rows: list[Row]) -> str:
    done = [row["settings"] for row in rows if "settings" in row]
    lines = [f"seeds {len(rows)}, crashed {len(rows) - len(done)}"]
    lines += [f"  seed {row['seed']}: {row['crash']}" for row in rows if "crash" in row]
    for setting in SETTINGS if done else ():
        runs = [row[setting] for row in done]
        lines += ["", setting]
        total = sum(r["items"]["total"] for r in runs)
        lines.append(rate("  items sorted", sum(r["items"]["sorted"] for r in runs), total))
        first = sum(r["picks"]["held_first_try"] for r in runs)
        objects = sum(r["picks"]["objects"] for r in runs)
        lines.append(rate("  held at the first try", first, objects))
        aims = sorted(1000 * aim for r in runs for aim in r.get("aims", ()))
        if aims:
            high = aims[min(len(aims) - 1, int(0.95 * len(aims)))]
            lines.append(f"  aimed beside the item      {median(aims):.1f} mm median, {high:.1f} mm in 95 %")
        held = max(1, sum(r["picks"]["held"] for r in runs))
        simulated, cpu = sum(r["sim_seconds"] for r in runs), sum(r["cpu_seconds"] for r in runs)
        lines.append(
            f"  a pick takes               {simulated / held:.2f} s simulated, {cpu / held:.2f} s CPU"
        )
        causes: Counter[str] = Counter()
        for r in runs:
            causes.update(r["failures"])
        counted = ", ".join(f"{cause} {count}" for cause, count in causes.most_common())
        lines.append(f"  failures by cause          {counted or 'none'}")
        missed = [
            row["seed"]
            for row in rows
            if "settings" in row
            and row["settings"][setting]["items"]["sorted"] < row["settings"][setting]["items"]["total"]
        ]
        if missed:
            lines.append(f"  not all sorted in seeds    {', '.join(map(str, missed))}")
    return "\n".join(lines)


def _short(row: Row) -> str:
    return ", ".join(
        f"{setting} {r['items']['sorted']}/{r['items']['total']}" for setting, r in row["settings"].items()
    )


def main() -> int:
    parser = options(__file__, __doc__, runs=40)
    parser.add_argument("--mission", default=str(ROOT / "examples" / "sort_by_colour.yaml"))
    parser.add_argument("--shift", type=float, default=SHIFT, help="m")
    parser.add_argument("--turn", type=float, default=math.degrees(TURN), help="degrees")
    given = parser.parse_args()
    jobs = [Job(given.mission, seed, given.shift, math.radians(given.turn)) for seed in seeds(given)]
    print(report(campaign(given, jobs, one, cost=COST_A_SEED, short=_short)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
