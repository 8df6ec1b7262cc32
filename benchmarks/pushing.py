"""Campaign: push an object 10 cm to a random pose, looking through the real camera: how far off is it?

    python benchmarks/pushing.py --runs 100
    python benchmarks/pushing.py --runs 100 --kinds nut

Seed by seed the same object is pushed from the same place to the same pose twice: in as many strokes as it
takes, looked at in between, and open loop: one look, one stroke.
"""

from __future__ import annotations

import math
import random
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from _campaign import Row, campaign, finished, options, rate, seeds

if TYPE_CHECKING:
    from picktree.simulation import TrueBody
    from picktree.world.scene import SceneDescription

COST_A_RUN = 9.0
"""CPU seconds of one seed, both ways, for the forecast."""
KINDS = ("block", "brick", "plate", "can", "ball")
WAY = 0.10
"""Distance from the start to the goal, m."""
AREA = ((0.42, -0.15), (0.58, 0.15))
"""Corners (x, y) of the area of the starts, in the world, m."""
ROOM = ((0.38, -0.20), (0.62, 0.20))
"""Corners (x, y) of the area of the goals, in the world, m."""
LIMIT = 180.0
"""Simulated seconds after which a push counts as hung."""


@dataclass(frozen=True)
class Job:
    seed: int
    kinds: tuple[str, ...]
    noise: float


def one(job: Job, folder: Path) -> Row:
    """One seed in this process, closed loop and open loop."""
    kind = job.kinds[job.seed % len(job.kinds)]
    row: Row = {"kind": kind}
    for name, extra in (("closed", ""), ("open", ", strokes: 1")):
        try:
            row[name] = _push(job, kind, extra)
        except Exception as error:  # noqa: BLE001  a crash is a figure of the campaign
            row[name] = {"crash": f"{type(error).__name__}: {error}"}
    return row


def _push(job: Job, kind: str, extra: str) -> dict[str, Any]:
    from picktree.session import assemble_world
    from picktree.session.execution import TICK_LENGTH
    from picktree.simulation import build_hardware
    from picktree.trees import NodeStatus, build
    from picktree.trees.loading import NodeRegistry, parse_mission
    from picktree.world import outline
    from picktree.world.planar_geometry import planar, wrap_angle
    from picktree.world.robot_model import load_robot

    scene = _scene(kind, job.noise)
    robot = load_robot(scene.robot)
    hardware = build_hardware("physics", scene, robot, job.seed)
    world = assemble_world(hardware, scene, robot, job.seed)
    begun = hardware.truth()[0]
    x, y, yaw = _goal(begun, job.seed)
    shape = outline(begun.shape, begun.pose)
    turned = "" if shape.round else f", yaw: {yaw:.6f}"

    def run(body: str) -> str:
        text = f"picktree: 1\nkind: mission\ntrees:\n  Main:\n    {body}\n"
        tree = build(parse_mission(text, Path("pushing.yaml"), NodeRegistry()), world)
        until = world.clock.now + LIMIT
        while True:
            tree.tick()
            if tree.status is not NodeStatus.RUNNING:
                return "" if tree.failure is None else f"{tree.failure.cause}: {tree.failure.message}"
            if world.clock.now > until:
                return "hung"
            world.control.step_tick(TICK_LENGTH)
            world.scene.carry(world.control.tcp)

    run('Observe: {camera: overhead, objects: "{items}"}')
    before = world.clock.now
    item = next(o.id for o in world.scene.objects if o.role == "item")
    failure = run(f"Push: {{object: {item}, to: [{x:.6f}, {y:.6f}]{turned}{extra}}}")
    ended = hardware.truth()[0]
    at = planar(ended.shape, ended.pose)
    return {
        "off": math.hypot(at.x - x, at.y - y),
        "turned": 0.0 if shape.round else abs(wrap_angle(yaw - at.yaw, shape.turn)),
        "seconds": world.clock.now - before,
        "failure": failure,
    }


def _scene(kind: str, noise: float) -> SceneDescription:
    from picktree.world.scene import load_scene

    scene = load_scene("three_bins")
    spawn = replace(scene.spawn[0], counts={kind: 1}, area=AREA, lying=0.0)
    cameras = tuple(replace(camera, depth_noise=noise) for camera in scene.cameras)
    return replace(scene, spawn=(spawn,), cameras=cameras)


def _goal(begun: TrueBody, seed: int) -> tuple[float, float, float]:
    """WAY from where it stands, with any heading."""
    rng = random.Random(f"pushing {seed}")
    (x0, y0), (x1, y1) = ROOM
    while True:
        angle = rng.uniform(-math.pi, math.pi)
        x = begun.pose.position[0] + WAY * math.cos(angle)
        y = begun.pose.position[1] + WAY * math.sin(angle)
        if x0 < x < x1 and y0 < y < y1:
            return x, y, rng.uniform(-math.pi, math.pi)


def report(rows: Sequence[Row]) -> str:
    lines: list[str] = []
    for name in ("closed", "open"):
        done = [row[name] for row in rows if "off" in row[name]]
        crashed = len(rows) - len(done)
        lines.append(f"{name} loop: {len(rows)} runs, {crashed} crashed")
        if not done:
            continue
        reached = sum(not r["failure"] for r in done)
        close = sum(r["off"] <= 0.001 and r["turned"] <= math.radians(1.0) for r in done)
        lines.append("  " + rate("within its tolerance", reached, len(rows)))
        lines.append("  " + rate("truly within 1 mm and 1 deg", close, len(rows)))
        lines.append("  " + _spread("off", [1000 * r["off"] for r in done], "mm"))
        headed = [math.degrees(row[name]["turned"]) for row in rows if row["kind"] not in ("can", "ball")]
        if headed:
            lines.append("  " + _spread("turned", headed, "deg"))
        lines.append("  " + _spread("simulated", [r["seconds"] for r in done], "s"))
        for kind in sorted({row["kind"] for row in rows}):
            of = [row[name] for row in rows if row["kind"] == kind and "off" in row[name]]
            lines.append("    " + _spread(kind, [1000 * r["off"] for r in of], "mm"))
        causes = Counter(r["failure"].split(":")[0] for r in done if r["failure"])
        told = ", ".join(f"{cause} {n}" for cause, n in causes.most_common())
        lines.append(f"  failures by cause: {told or 'none'}")
    lines += [f"  seed {r['seed']}: {r['closed']['crash']}" for r in rows if "crash" in r["closed"]]
    lines += [
        f"  seed {r['seed']} ({r['kind']}): {r['closed']['failure']}"
        for r in rows
        if r["closed"].get("failure")
    ]
    return "\n".join(lines)


def _spread(name: str, values: Sequence[float], unit: str) -> str:
    ordered = sorted(values)
    high = ordered[min(len(ordered) - 1, math.ceil(0.95 * len(ordered)) - 1)]
    return (
        f"{name:<10} median {median(ordered):.2f} {unit}, 95 % below {high:.2f}, worst {ordered[-1]:.2f} "
        f"(N = {len(ordered)})"
    )


def main() -> int:
    parser = options(__file__, __doc__, runs=100)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS))
    parser.add_argument("--noise", type=float, default=0.002, help="of the camera's depth at 0.7 m, m")
    given = parser.parse_args()
    rows = campaign(
        given,
        [Job(seed, tuple(given.kinds), given.noise) for seed in seeds(given)],
        one,
        cost=COST_A_RUN,
        short=lambda row: " ".join(
            f"{name} {1000 * row[name]['off']:.2f} mm" if "off" in row[name] else f"{name} crashed"
            for name in ("closed", "open")
        ),
    )
    print(report(finished(rows)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
