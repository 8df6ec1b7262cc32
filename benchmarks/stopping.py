"""How far and how long the arm goes on when it is stopped at full speed, in physics.

    python benchmarks/stopping.py --runs 40

Planned motions between random configurations above the table at full speed are stopped at a random moment in
three ways: halted (the arm brakes on its path), by a safety stop that says it is off its way, by a contact's
reflex; and jogs at full speed are halted. For each way: how far the tool went and the time until it stands,
and how far the worst joint was beyond its soft limit (negative: within).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Generator
from typing import TypeVar

from picktree.robot import World
from picktree.robot.control import MAX_TWIST_SPEED, Twist
from picktree.robot.control.impedance import ContactReflex
from picktree.robot.control.joint_controllers import BrakeController
from picktree.robot.planning import JointGoal
from picktree.session import assemble_world
from picktree.simulation import build_hardware
from picktree.world import Array, Failure
from picktree.world.robot_model import load_robot
from picktree.world.scene import load_scene

import numpy as np

T = TypeVar("T")
WAYS = ("halted", "off its way", "contact", "jog halted")
SPREAD = 0.7
"""Of the configurations around home, rad."""
COST = 0.5
"""CPU seconds a stop."""
STANDING = 0.01
"""m/s"""


def cell(seed: int) -> World:
    scene, robot = load_scene("sort_small"), load_robot("panda")
    return assemble_world(build_hardware("physics", scene, robot, seed), scene, robot, seed)


def beyond(world: World) -> float:
    q, model = world.control.hardware.arm.read().position, world.robot
    return float(np.maximum(q - model.upper, model.lower - q).max())


def stopped(world: World, way: str, rng: np.random.Generator) -> tuple[float, float, float, float] | None:
    """Speed of the tool when it was stopped, how far it went, how long, and by what a joint was beyond."""
    model, control = world.robot, world.control
    if way == "jog halted":
        along = rng.normal(size=3) * np.array([1.0, 1.0, 0.2])
        x, y, z = along / np.linalg.norm(along) * MAX_TWIST_SPEED
        doing = world.move.jog(Twist((x, y, z)))
        last = 12
    else:
        goal = np.clip(
            model.named("home") + rng.uniform(-SPREAD, SPREAD, model.n),
            model.planned_lower,
            model.planned_upper,
        )
        try:
            plan = finished(world, world.plan.to(JointGoal(goal), node="stopping"))
        except Failure:
            return None
        doing = world.move.along(plan.trajectory)
        last = max(4, round(0.6 * plan.trajectory.duration / world.tick))
    try:
        for _ in range(int(rng.integers(3, last + 1))):
            next(doing)
            control.step_tick(world.tick)
    except (StopIteration, Failure):
        return None
    at, speed = control.tcp, tool_speed(world)
    doing.close()
    if way == "off its way":
        control.acquire(way).run(BrakeController(model, control.period))
    elif way == "contact":
        control.acquire(way).run(ContactReflex(model, control.period, np.zeros(6)))
    begun, worst, standing, farthest = control.now, -math.inf, control.now, 0.0
    while control.now - begun < 1.5:
        control.step()
        worst = max(worst, beyond(world))
        farthest = max(farthest, control.tcp.distance(at))
        if tool_speed(world) > STANDING:
            standing = control.now
    return speed, farthest, standing - begun, worst


def tool_speed(world: World) -> float:
    state = world.control.state
    twist: Array = world.robot.jacobian(state.position) @ state.velocity
    return float(np.linalg.norm(twist[:3]))


def finished(world: World, doing: Generator[None, None, T]) -> T:
    """Run a generator tick by tick, and return its result."""
    while True:
        try:
            next(doing)
        except StopIteration as end:
            return end.value
        world.control.step_tick(world.tick)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=40, help="stops of each kind")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    print(f"{len(WAYS) * given.runs} stops, about {len(WAYS) * given.runs * COST:.0f} CPU s", flush=True)
    print(
        "| stopped | stops | tool, m/s: median, max | way, mm: median, max | time, s: median, max "
        "| beyond, rad |"
    )
    print("|---|---|---|---|---|---|")
    for way in WAYS:
        rng = np.random.default_rng([given.seed, WAYS.index(way)])
        world = cell(given.seed)
        rows: list[tuple[float, float, float, float]] = []
        while len(rows) < given.runs:
            row = stopped(world, way, rng)
            world.control.monitor.acknowledge()
            finished(world, world.move.rest())
            if row is not None:
                rows.append(row)
            if row is None or way == "jog halted" or len(rows) % 5 == 0:
                try:
                    home = finished(world, world.plan.to(JointGoal(world.robot.named("home")), node="home"))
                    finished(world, world.move.along(home.trajectory))
                except Failure:
                    world = cell(given.seed + len(rows))
        speed, gone, time, worst = (np.array(column) for column in zip(*rows, strict=True))
        print(
            f"| {way} | {len(rows)} | {np.median(speed):.2f}, {speed.max():.2f} "
            f"| {np.median(gone) * 1000:.0f}, {gone.max() * 1000:.0f} "
            f"| {np.median(time):.2f}, {time.max():.2f} | {worst.max():.3f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
