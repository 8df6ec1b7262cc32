"""Campaign: cameras and tool that are off, and what `picktree calibrate` leaves of that.

    python benchmarks/calibration.py --runs 20

For each seed both cameras are 8 mm and 2° from where they are believed to be, the tool is 3 mm off, in
directions and about axes drawn evenly, and the target stands up to 5 mm and 2° (and tilted) from where it
was put. Each is calibrated in two settings: with the camera on the hand, and without it, where the overhead
camera has only what the fingers have touched to go by. The truth is read from the scene files, by this
program alone.
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from _campaign import Row, campaign, options, rate, seeds

import numpy as np

if TYPE_CHECKING:
    from picktree.world import Pose

COST_A_SEED = 26.0
"""CPU seconds of both settings, for the forecast."""
SHIFT, TURN, TOOL = 0.008, math.radians(2.0), 0.003
CLOSE, ALIGNED = 0.001, math.radians(0.3)
"""Largest errors of position, m, and of orientation, rad, that count as calibrated."""
SETTINGS = {
    "camera on the hand": ("three_bins_wrist", ("overhead", "wrist")),
    "fingers alone": ("three_bins", ("overhead",)),
}
ASKED = {"overhead": "overhead camera", "wrist": "camera on the hand"}


@dataclass(frozen=True)
class Job:
    seed: int
    robot: str | None


def one(job: Job, folder: Path) -> Row:
    """Calibrate in both settings of one seed."""
    return {"settings": {name: _run(job, folder, name) for name in SETTINGS}}


def _run(job: Job, folder: Path, setting: str) -> Row:
    from picktree.apps.commissioning import CalibrationRequest, calibrate
    from picktree.world.scene import load_scene

    base, cameras = SETTINGS[setting]
    file = folder / f"{base}.yaml"
    file.write_text(_scene(job.seed, base, cameras))
    started = time.process_time()
    written = folder / f"{base}-found.yaml"
    asked = CalibrationRequest(
        str(file), robot=job.robot, seed=job.seed, output=written, replace=True, out=folder
    )
    answer = calibrate(asked)
    row: Row = {"cpu": time.process_time() - started, "why_not": answer.why_not, "off": {}}
    if answer.known is None:
        return row
    scene = load_scene(str(written))
    for found in answer.known.cameras:
        camera = next(c for c in scene.cameras if c.name == found.name)
        believed, truly = camera.pose, camera.pose @ camera.error
        if camera.on == "hand":
            believed, truly = scene.tool @ believed, scene.tool_error @ truly
        row["off"][found.name] = {
            "position": believed.distance(truly),
            "angle": believed.angle(truly),
            "scores": _scores(believed, truly, found.deviation.position, found.deviation.angle),
        }
    tool = answer.known.tool
    if tool is not None:
        misses = np.subtract(scene.tool.position, scene.tool_error.position)
        row["tool"] = {
            "position": float(np.linalg.norm(misses)),
            "scores": (np.abs(misses) / np.array(tool.deviation)).tolist(),
            "touches": tool.touches,
        }
    return row


def _scores(believed: Pose, truly: Pose, position: object, angle: object) -> list[float]:
    """Return the error of each component, in its standard deviations."""
    from picktree.world import Pose as Frame

    turn = Frame(orientation=believed.orientation) @ Frame(orientation=truly.orientation).inverse()
    x, y, z, w = turn.orientation
    turned = 2.0 * np.array([x, y, z]) * (1.0 if w >= 0 else -1.0)
    shifted = np.subtract(believed.position, truly.position)
    return [*np.abs(shifted / np.array(position)).tolist(), *np.abs(turned / np.array(angle)).tolist()]


def _scene(seed: int, base: str, cameras: tuple[str, ...]) -> str:
    from picktree.world import Pose as Frame

    rng = np.random.default_rng([seed, 7])
    lines = ["picktree: 1", "kind: scene", f"base: {base}", "cameras:"]
    for camera in ("overhead", "wrist"):
        way, axis = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
        x, y, z = (float(c) * math.sin(TURN / 2) for c in axis)
        rpy = Frame(orientation=(x, y, z, math.cos(TURN / 2))).rpy()
        if camera in cameras:
            offset = f"offset: {_list(way * SHIFT)}, rpy: {_list(np.array(rpy))}"
            lines.append(f"  {camera}: {{error: {{{offset}}}}}")
    way = rng.standard_normal(3)
    lines.append(f"tool_error: {_list(way / np.linalg.norm(way) * TOOL)}")
    return "\n".join(lines) + "\n"


def _list(numbers: np.ndarray) -> str:
    return "[" + ", ".join(f"{n:.7f}" for n in numbers.tolist()) + "]"


def report(rows: list[Row]) -> str:
    done = [row for row in rows if "settings" in row]
    lines = [f"seeds {len(rows)}, crashed {len(rows) - len(done)}"]
    lines += [f"  seed {row['seed']}: {row['crash']}" for row in rows if "crash" in row]
    for setting, (_, cameras) in SETTINGS.items() if done else ():
        runs = [row["settings"][setting] for row in done]
        lines += ["", setting]
        lines += [
            f"  seed {row['seed']}: {row['settings'][setting]['why_not']}"
            for row in done
            if row["settings"][setting]["why_not"]
        ]
        for camera in cameras:
            found = [run["off"][camera] for run in runs if camera in run["off"]]
            lines += _left(f"  {ASKED[camera]}", found, len(runs))
        tools = [run["tool"] for run in runs if "tool" in run]
        lines += _spread("  tool, mm", [1000 * tool["position"] for tool in tools])
        lines += _coverage(tools)
        lines.append(
            f"  CPU                          {sum(run['cpu'] for run in runs) / len(runs):.1f} s a run"
        )
    return "\n".join(lines)


def _left(name: str, found: list[Row], runs: int) -> list[str]:
    close = sum(off["position"] < CLOSE and off["angle"] < ALIGNED for off in found)
    lines = [rate(f"{name} < 1 mm, 0.3°", close, runs)]
    lines += _spread("    left, mm", [1000 * off["position"] for off in found])
    lines += _spread("    left, °", [math.degrees(off["angle"]) for off in found])
    return [*lines, *_coverage(found)]


def _spread(name: str, values: list[float]) -> list[str]:
    if not values:
        return []
    middle, high, most = np.percentile(values, (50, 95, 100)).tolist()
    return [f"{name:<28} {middle:.3f} median, {high:.3f} in 95 %, {most:.3f} at most"]


def _coverage(found: list[Row]) -> list[str]:
    scores = [score for off in found for score in off["scores"]]
    return [rate("    within 2 deviations", sum(score < 2.0 for score in scores), len(scores))]


def _short(row: Row) -> str:
    parts: list[str] = []
    for setting, run in row["settings"].items():
        told = [f"{name} {1000 * off['position']:.2f} mm" for name, off in run["off"].items()]
        told += [f"tool {1000 * run['tool']['position']:.2f} mm"] if "tool" in run else []
        parts.append(f"{setting}: {', '.join(told) or run['why_not']}")
    return "; ".join(parts)


def main() -> int:
    parser = options(__file__, __doc__, runs=20)
    parser.add_argument("--robot", help="instead of the scenes' own")
    given = parser.parse_args()
    jobs = [Job(seed, given.robot) for seed in seeds(given)]
    print(report(campaign(given, jobs, one, cost=COST_A_SEED, short=_short)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
