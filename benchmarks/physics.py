"""Accuracy and speed of the physics: drift of held items, slip, and a heap that comes to rest.

    python benchmarks/physics.py
    python benchmarks/physics.py --runs 5 --only drift,heap

drift: items of five shapes are gripped with 30 N, a little off their middle, lifted and swung for four
seconds; how far each moved in the hand, in the median and at most. slip: the share of 2 μF, the limit by
Coulomb, at which a gripped block begins to slip, by bisection over its mass. heap: items poured into a box
of four walls; after how long all of them sleep, and CPU time of a step while they are awake and asleep. The
same machine steps an empty scene beside it, as the reference for the CPU times.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

from _campaign import Row, campaign, finished, options, seeds
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Array, Box, Cylinder, ObjectId, Pose, Shape, Sphere
from picktree.world.robot_model import RobotDescription, RobotModel, load_robot
from picktree.world.scene import CatalogueEntry, Fixture, Form, SceneDescription, SensorNoise, Spawn

import numpy as np

RATE = 240
SILENT = SensorNoise(encoder=0.0, width=0.0, force=0.0, torque=0.0, force_bias=0.0, torque_bias=0.0)
TABLE = Fixture(ObjectId("table"), Box((0.6, 0.8, 0.04)), Pose((0.5, 0.0, -0.02)), "light_grey")
SHAPES: dict[str, tuple[Form, Shape]] = {
    "block": ("box", Box((0.04, 0.04, 0.04))),
    "brick": ("box", Box((0.03, 0.06, 0.05))),
    "plate": ("plate", Box((0.05, 0.05, 0.01))),
    "can": ("cylinder", Cylinder(0.02, 0.06)),
    "ball": ("sphere", Sphere(0.02)),
}
"""Form and shape of the items that are held, by name; sizes in m."""


def scene(name: str, count: int, mass: float, friction: float, half: float) -> SceneDescription:
    """Return a scene with `count` items of a shape within `half` m of the middle of a table."""
    form, shape = SHAPES[name]
    entry = CatalogueEntry(name, form, shape, mass, friction)
    spawn = Spawn({name: count}, ("red",), ((0.5 - half, -half), (0.5 + half, half)))
    return SceneDescription(
        name="bench",
        robot="panda",
        fixtures=(TABLE,),
        bins=(),
        cameras=(),
        catalogue=(entry,),
        spawn=(spawn,),
        destinations=(),
        noise=SILENT,
    )


def down_at(model: RobotModel, home: Array, position: Array, yaw: float) -> Array:
    """Return joints (n,), rad, with the tool at `position`, m, pointing down, turned by `yaw`, rad."""
    q = home.copy()
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    wanted = turn @ np.diag((1.0, -1.0, -1.0))
    for _ in range(100):
        tcp = model.tcp(q)
        off = wanted @ tcp.rotation().T
        spin = 0.5 * np.array([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]])
        error = np.concatenate([position - tcp.position, spin])
        step = np.linalg.pinv(model.jacobian(q)) @ error
        q = q + step * min(1.0, 0.3 / max(1e-9, np.abs(step).max()))
    return q


def go(hardware: PhysicsHardware, target: Array, duration: float) -> None:
    """Move the arm smoothly to joints `target` (n,), rad, in `duration` s."""
    start = hardware.arm.read().position
    for k in range(1, round(duration * RATE) + 1):
        s = k / (duration * RATE)
        blend, rate = s * s * (3 - 2 * s), 6 * s * (1 - s) / duration
        hardware.arm.follow(start + blend * (target - start), rate * (target - start))
        hardware.step()


def grip(hardware: PhysicsHardware, force: float, off: Array, turn: float) -> tuple[RobotModel, Array, float]:
    """Grip the only item `off` m (3,) from its middle, turned by `turn` rad, and lift it by 10 cm."""
    model, home = RobotModel(hardware.robot), np.array(hardware.robot.named["home"])
    pose = hardware.truth()[0].pose
    yaw = float(np.arctan2(pose.rotation()[1, 0], pose.rotation()[0, 0])) + turn
    at = np.array(pose.position) + off
    low = down_at(model, home, at, yaw)
    high = down_at(model, home, at + np.array((0.0, 0.0, 0.1)), yaw)
    go(hardware, high, 1.0)
    go(hardware, low, 0.5)
    hardware.gripper.command(0.0, force)
    go(hardware, low, 0.6)
    go(hardware, high, 1.0)
    return model, at, yaw


def drift(robot: RobotDescription, name: str, seed: int) -> float:
    """Return how far an item moves in the hand while it is swung for 4 s, mm; infinity: it was dropped."""
    random = np.random.default_rng(seed)
    hardware = PhysicsHardware(scene(name, 1, 0.15, 0.6, 0.0), robot, seed)
    off = np.array([*random.uniform(-0.003, 0.003, 2), 0.0])
    model, at, yaw = grip(hardware, 30.0, off, random.uniform(-0.05, 0.05))
    home = np.array(robot.named["home"])

    def in_hand() -> Array:
        return np.array((hardware.true_tcp().inverse() @ hardware.truth()[0].pose).position)

    before = in_hand()
    for k in range(4):
        over = at + np.array((0.1 * (-1) ** k, 0.15 * (-1) ** k, 0.2))
        go(hardware, down_at(model, home, over, yaw), 1.0)
    moved = 1000 * float(np.linalg.norm(in_hand() - before))
    hardware.close()
    return moved if moved < 50.0 else float("inf")


def slip(robot: RobotDescription, force: float, friction: float) -> float:
    """Return the weight at which a gripped block slips, as a share of 2 μF."""
    low, high = 0.5, 1.5
    while high - low > 0.01:
        share = (low + high) / 2
        mass = share * 2 * friction * force / 9.81
        hardware = PhysicsHardware(scene("block", 1, mass, friction, 0.0), robot, 0)
        grip(hardware, force, np.zeros(3), 0.0)
        held = hardware.truth()[0].pose.position[2] > 0.1
        hardware.close()
        low, high = (share, high) if held else (low, share)
    return (low + high) / 2


def walls(half: float) -> tuple[Fixture, ...]:
    """Return four walls, 15 cm high, around the middle of the table, `half` m away."""
    thick, high = 0.02, 0.15
    return tuple(
        Fixture(
            ObjectId(f"wall_{k}"),
            Box((thick, 2 * half, high) if x else (2 * half + 2 * thick, thick, high)),
            Pose((0.5 + x * (half + thick / 2), y * (half + thick / 2), high / 2)),
            "light_grey",
        )
        for k, (x, y) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1)))
    )


def step_cost(hardware: PhysicsHardware, steps: int = 480) -> float:
    """Return the CPU time of a step, µs: the median over tenths of the steps."""
    costs = list[float]()
    for _ in range(10):
        start = time.thread_time()
        for _ in range(steps // 10):
            hardware.step()
        costs.append(1e6 * (time.thread_time() - start) / (steps // 10))
    return median(costs)


def heap(robot: RobotDescription, name: str, count: int, seed: int) -> tuple[float, float, float]:
    """Pour items into a box of four walls.

    Returns the time after which all sleep, s, or infinity after 10 s; and the CPU time of a step while the
    items fall and in the end, µs.
    """
    from picktree.simulation.checkpoints import BodyState

    hardware = PhysicsHardware(scene(name, count, 0.08, 0.5, 0.25), robot, seed)
    start = hardware.checkpoint()
    random = np.random.default_rng(seed)
    piled = tuple(
        BodyState(
            item.id,
            (0.5 + random.uniform(-0.02, 0.02), random.uniform(-0.02, 0.02), 0.05 + 0.06 * k),
            tuple(_unit(random.normal(size=4)).tolist()),
            (0.0, 0.0, 0.0),
            (0.0, 0.0, 0.0),
            present=True,
        )
        for k, item in enumerate(start.items)
    )
    hardware.close()
    boxed = replace(start, items=piled, obstacles=walls(0.08))
    hardware = PhysicsHardware(hardware.scene, robot, seed, boxed)
    awake = step_cost(hardware, 240)
    asleep_at = float("inf")
    for k in range(9 * RATE):
        hardware.step()
        if k % 24 == 0 and all(state.asleep for state in hardware.snapshot().items):
            asleep_at = 1 + k / RATE
            break
    cost = step_cost(hardware)
    hardware.close()
    return asleep_at, awake, cost


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v)


@dataclass(frozen=True)
class Job:
    """One measurement: part, its parameters, seed."""

    part: str
    of: tuple[str | float, ...]
    seed: int


def one(job: Job, folder: Path) -> Row:
    """Measure once; infinity is None."""
    robot = load_robot("panda")
    match job.part, job.of:
        case "drift", (str(name),):
            found = (drift(robot, name, job.seed),)
        case "slip", (float(force), float(friction)):
            found = (slip(robot, force, friction),)
        case _, (str(name), float(count)):
            empty = PhysicsHardware(scene("block", 1, 0.08, 0.5, 0.0), robot, 0)
            reference = step_cost(empty)
            empty.close()
            after, falling, end = heap(robot, name, int(count), job.seed)
            found = (after, falling / reference, end / reference, reference)
        case unknown:
            raise ValueError(f"{unknown}")
    return {"found": [x if np.isfinite(x) else None for x in found]}


def told_drift(of: Row) -> list[str]:
    lines = ["| held for 4 s | runs | drift, mm, median | at most | dropped |", "|---|---|---|---|---|"]
    for (name,), rows in of.items():
        kept = [row[0] for row in rows if row[0] is not None] or [math.nan]
        dropped = sum(row[0] is None for row in rows)
        lines.append(f"| {name} | {len(rows)} | {median(kept):.2f} | {max(kept):.2f} | {dropped} |")
    return lines


def told_slip(of: Row) -> list[str]:
    lines = ["| grip, N | friction | slips at × 2 μF |", "|---|---|---|"]
    return lines + [f"| {force:g} | {mu:g} | {rows[0][0]:.3f} |" for (force, mu), rows in of.items()]


def told_heap(of: Row) -> list[str]:
    lines = ["A step is given as a multiple of one with a single sleeping item.", ""]
    lines.append("| heap | runs | asleep | after, s, median | step, falling, × | in the end, × |")
    lines.append("|---|---|---|---|---|---|")
    for (name, count), rows in of.items():
        after = [math.inf if row[0] is None else row[0] for row in rows]
        falling, end = (median(row[k] for row in rows) for k in (1, 2))
        lines.append(
            f"| {count:g} × {name} | {len(rows)} | {sum(map(math.isfinite, after))} | {median(after):.1f} "
            f"| {falling:.1f} | {end:.1f} |"
        )
    return lines


@dataclass(frozen=True)
class Part:
    """Measurements of one table: their parameters, CPU seconds of one, the lines of the table."""

    of: tuple[tuple[str | float, ...], ...]
    cost: float
    told: Callable[[Row], list[str]]


PARTS = {
    "drift": Part(tuple((name,) for name in SHAPES), 1.6, told_drift),
    "slip": Part(((20.0, 0.3), (20.0, 0.6), (30.0, 0.2), (30.0, 0.5)), 5.0, told_slip),
    "heap": Part(
        tuple((name, count) for name in ("block", "brick", "can", "ball") for count in (10.0, 20.0)),
        3.0,
        told_heap,
    ),
}


def main() -> int:
    parser = options(__file__, __doc__, runs=5, what="seeds of each row; slip has none")
    parser.add_argument("--only", default=",".join(PARTS), help="parts, with commas")
    given = parser.parse_args()
    parts = given.only.split(",")
    jobs = [
        Job(part, of, seed)
        for part in parts
        for of in PARTS[part].of
        for seed in ((0,) if part == "slip" else seeds(given))
    ]
    cost = {part: PARTS[part].cost for part in parts}
    rows = finished(
        campaign(given, jobs, one, cost=lambda job: cost[job.part], short=lambda row: row["found"])
    )
    for part in parts:
        tables: dict[tuple[str | float, ...], list[list[float]]] = {}
        for row in rows:
            if row["job"]["part"] == part:
                tables.setdefault(tuple(row["job"]["of"]), []).append(row["found"])
        print("", *PARTS[part].told(tables), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
