"""What control and physics cost while a held item is pressed onto the table and slid over it, at each rate.

    python benchmarks/contact.py
    python benchmarks/contact.py --runs 5 --rates 240,500,1000,2000

The arm really picks the item up, touches the table with it, then slides a circle under Cartesian impedance
while it presses with 8 N. CPU time; the real-time factor is simulated time over CPU time of both together.
Beside it the bare calls of pinocchio that a control step cannot do without, in the same run.
"""

from __future__ import annotations

import argparse
import importlib.util
import math
import sys
import time
from collections.abc import Generator
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from picktree.robot import World
from picktree.robot.control import CartesianStiffness, CompliantMotion, ContactState

import numpy as np
import pinocchio as pin

T = TypeVar("T")
ROOT = Path(__file__).resolve().parent.parent
SLIDING = 2.0
"""s"""
RADIUS, TURNS = 0.004, 1.0
PRESS = 8.0
"""N"""
SPRING = CartesianStiffness(linear=(600.0, 600.0, 0.0), angular=15.0)
COST = 12.0
"""CPU seconds of one run of one rate at 500 Hz."""
PICK = """\
Sequence:
  - Observe: {camera: overhead, objects: "{items}"}
  - ForEach:
      in: "{items}"
      out: "{item}"
      do: {Grasp: {object: "{item}", onward: false}}
"""


class Slide(CompliantMotion):
    """Press down and go round in a small circle."""

    def step(self, felt: ContactState) -> None:
        angle = 2.0 * math.pi * TURNS * felt.elapsed / SLIDING
        away = np.array([math.cos(angle) - 1.0, math.sin(angle), 0.0])
        self.position = self.origin + RADIUS * away
        self.wrench[2] = -PRESS
        self.finished = felt.elapsed >= SLIDING


class Counted:
    """The hardware with the CPU time of its steps counted."""

    def __init__(self, world: World) -> None:
        self.steps, self.cpu = 0, 0.0
        hardware = world.control.hardware
        step = hardware.step

        def counted() -> None:
            before = time.process_time()
            step()
            self.cpu += time.process_time() - before
            self.steps += 1

        hardware.step = counted  # type: ignore[method-assign]


def tests_cell() -> ModuleType:
    """What the tests drive missions with."""
    spec = importlib.util.spec_from_file_location("cell", ROOT / "tests" / "skills" / "cell.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["cell"] = module
    spec.loader.exec_module(module)
    return module


def driven(world: World, doing: Generator[None, None, T]) -> T:
    """What a generator comes to, tick by tick."""
    while True:
        try:
            next(doing)
        except StopIteration as end:
            return end.value
        world.control.step_tick(world.tick)


def sliding(world: World, rate: int) -> tuple[float, float, float, float]:
    """Control and physics, µs a step; real-time factor; mean force, N."""
    with world.control.contact(rate):
        down = driven(world, world.move.guarded((0, 0, -1), 0.3, force=4.0, speed=0.03))
        assert down.contact
        counted, begun, cpu = Counted(world), world.clock.now, time.process_time()
        course = Slide()
        driven(world, world.move.comply(course, 2 * SLIDING, stiffness=SPRING))
        cpu, simulated = time.process_time() - cpu, world.clock.now - begun
    control = (cpu - counted.cpu) / counted.steps
    return control * 1e6, counted.cpu / counted.steps * 1e6, simulated / cpu, course.peak


def bare(world: World, calls: int = 20000) -> float:
    """Nonlinear effects, Jacobians and the frame's placement, µs."""
    arm, q = world.robot.arm, world.robot.named("home")
    data, v = arm.createData(), np.zeros(world.robot.n)
    before = time.process_time()
    for _ in range(calls):
        pin.nonLinearEffects(arm, data, q, v)
        pin.computeJointJacobians(arm, data, q)
        pin.getFrameJacobian(arm, data, world.robot.tcp_frame, pin.LOCAL_WORLD_ALIGNED)
        pin.updateFramePlacement(arm, data, world.robot.tcp_frame)
    return (time.process_time() - before) / calls * 1e6


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=3, help="seeds for each rate")
    parser.add_argument("--rates", default="240,500,1000", help="Hz")
    given = parser.parse_args()
    rates = [int(rate) for rate in given.rates.split(",")]
    cost = sum(COST * rate / 500 for rate in rates) * given.runs
    print(f"{given.runs} runs at each of {len(rates)} rates, about {cost:.0f} CPU s", flush=True)
    cell = tests_cell()
    print("| rate, Hz | control, µs a step | physics, µs a step | real-time factor | greatest force, N |")
    print("|---|---|---|---|---|")
    for rate in rates:
        rows: list[tuple[float, float, float, float]] = []
        for seed in range(given.runs):
            one = cell.Cell(cell.mission(PICK), cell.items(block=1), "physics", 40 + seed)
            one.finish()
            assert one.world.scene.held is not None, f"seed {seed}: nothing in the hand"
            rows.append(sliding(one.world, rate))
        control, physics, factor, force = (float(np.median(c)) for c in zip(*rows, strict=True))
        print(f"| {rate} | {control:.0f} | {physics:.0f} | {factor:.1f} | {force:.1f} |", flush=True)
    print(f"\nbare pinocchio calls of a control step: {bare(one.world):.1f} µs")


if __name__ == "__main__":
    main()
