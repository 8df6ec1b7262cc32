"""One insertion in physics, from the table into a hole whose place is known roughly, and what came of it."""

from __future__ import annotations

import math
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Row = dict[str, Any]

PEG = 0.030
"""Diameter of the round peg, side of the square one, m."""
HEIGHT = 0.070
DEPTH = 0.030
"""Depth of the hole, m."""
LIMIT = 240.0
"""Simulated seconds after which a run counts as hung."""
REST = 25
"""Ticks after the end, in which everything comes to rest and is judged."""

SCENE = """
picktree: 1
kind: scene
base: three_bins
fixtures:
  board:
    box: [0.13, 0.13, 0.05]
    at: [0.5, 0.16, 0.025]
    holes: {{hole: {{{hole}, at: [0, 0], depth: {depth} mm}}}}
    uncertainty: {{position: 5 mm, angle: 2 deg}}
catalogue:
  peg: {{{peg}, mass: 90 g, friction: 0.5}}
spawn:
  - of: {{peg: 1}}
    colours: [red, green, blue]
    area: {{min: [0.40, -0.20], max: [0.58, -0.02]}}
    gap: 25 mm
destinations:
  - {{where: "kind == 'peg'", to: board}}
"""

MISSION = """
picktree: 1
kind: mission
trees:
  Main:
    Sequence:
      - Observe: {camera: overhead, objects: "{items}"}
      - ForEach:
          in: "{items}"
          out: "{item}"
          most: 1
          do:
            Recover:
              attempts: 3
              do:
                Sequence:
                  - Grasp: {object: "{item}"}
                  - Insert: {object: "{item}"}
              when:
                insert.*:
                  - Place: {object: "{item}", at: [0.45, -0.12, 0.0]}
                  - GoTo: {pose: home}
                  - Observe: {camera: overhead}
                "*": [SafeRetreat, {Observe: {camera: overhead}}]
      - GoTo: {pose: home}
"""


@dataclass(frozen=True)
class Setting:
    """`clearance`: of the hole's inscribed circle, or its width, beyond the peg's: both sides together, m."""

    form: str
    clearance: float

    @property
    def name(self) -> str:
        return f"{self.form}-{self.clearance * 1000:.1f}"

    def scene(self) -> str:
        wide = f"{(PEG + self.clearance) * 1000:g} mm"
        side, high = f"{PEG * 1000:g} mm", f"{HEIGHT * 1000:g} mm"
        peg = (
            f"cylinder: {{radius: {PEG * 500:g} mm, height: {high}}}"
            if self.form == "round"
            else f"box: [{side}, {side}, {high}]"
        )
        return SCENE.format(hole=f"{self.form}: {wide}", peg=peg, depth=DEPTH * 1000)


def run(setting: Setting, way: str, seed: int) -> Row:
    """`way`: `feeling`, or `straight` for position control. A row of plain values."""
    began = time.process_time()
    cell = _Cell(setting, seed)
    cell.feel() if way == "feeling" else cell.straight_down()
    return {"seed": seed, **cell.judged(), "cpu": time.process_time() - began}


class _Cell:
    """Hardware, world, and a mission in it."""

    def __init__(self, setting: Setting, seed: int) -> None:
        from picktree.session import assemble_world
        from picktree.simulation.physics import PhysicsHardware
        from picktree.world.robot_model import load_robot
        from picktree.world.scene import parse_scene

        self.scene = parse_scene(setting.scene(), Path(f"{setting.name}.yaml"))
        robot = load_robot(self.scene.robot)
        self.hardware = PhysicsHardware(self.scene, robot, seed)
        self.hardware.penetrations.every = 1
        self.world = assemble_world(self.hardware, self.scene, robot, seed)
        self.told: Row = {"failures": [], "grasps": 0}

    def feel(self) -> None:
        self._mission(MISSION)

    def straight_down(self) -> None:
        """The same pick; then stiffly to where the bottom should be, as far as the safety monitor lets it."""
        from picktree.world import Failure

        look = MISSION.replace('- Insert: {object: "{item}"}', "- AlwaysSuccess")
        self._mission(look)
        if self.world.scene.held is None:
            return
        try:
            self._drive(self._lower())
        except Failure as failure:
            self.told["failures"].append(f"{failure.cause}: {failure.message}")
        self._drive(self._open())

    def _lower(self) -> Generator[None, None, None]:
        from picktree.robot.manipulation.insertion import fit, poses_over
        from picktree.robot.planning import OffsetGoal, PoseGoal
        from picktree.world.hole_geometry import find_hole, fitting_hole

        world = self.world
        held = world.scene.held
        assert held is not None and held.object_in_tcp is not None
        hole = fitting_hole(world.scene, held.id)
        assert hole is not None
        plan = fit(*find_hole(world.scene, hole.id), held.shape, held.object_in_tcp)
        above = 0.012
        way = yield from world.plan.to(PoseGoal(poses_over(plan, above)), node="straight")
        yield from world.move.along(way.trajectory, node="straight")
        with world.scene.allow((held.id, "board"), ("gripper", "board"), ("arm", "board")):
            down = OffsetGoal((0.0, 0.0, -above - DEPTH), least_fraction=0.5)
            line = yield from world.plan.line(down, scaling=world.handling.slowly, node="straight")
            yield from world.move.along(line.trajectory, node="straight")

    def _open(self) -> Generator[None, None, None]:
        world = self.world
        yield from world.move.rest()
        for _ in range(10):
            yield
        world.gripper.start(world.gripper.width + world.handling.release)
        for _ in range(20):
            yield

    def _drive(self, steps: Generator[None, None, None]) -> None:
        for _ in steps:
            self._wait()

    def _wait(self) -> None:
        from picktree.session.execution import TICK_LENGTH

        self.world.control.step_tick(TICK_LENGTH)
        self.world.scene.carry(self.world.control.tcp)

    def _mission(self, text: str) -> None:
        from picktree.trees import NodeStatus, build
        from picktree.trees.loading import NodeRegistry, parse_mission

        self.tree = tree = build(parse_mission(text, Path("insertion.yaml"), NodeRegistry()), self.world)
        while self.world.clock.now < LIMIT:
            tree.tick()
            self._note()
            if tree.status is not NodeStatus.RUNNING:
                return
            self._wait()
        self.told["failures"].append("hung")

    def _note(self) -> None:
        from picktree.world.event_types import ItemDoneEvent, PickEvent, RecoveryEvent

        for event in self.world.journal.take():
            match event:
                case PickEvent(held=held):
                    self.told["grasps"] += held
                case RecoveryEvent(message=message):
                    self.told["failures"].append(message)
                case ItemDoneEvent(force=force, seconds=seconds, found_by=found_by):
                    self.told |= {"force": force, "seconds": seconds, "found_by": found_by}
                case _:
                    pass

    def judged(self) -> Row:
        """Return the outcome by the ground truth of the simulation, without anything believed."""
        from picktree.simulation import score

        for _ in range(REST):
            self._wait()
        body = self.hardware.truth()[0]
        item = score(self.hardware.truth(), self.scene).items[0]
        greatest = self.hardware.penetrations.greatest.get(body.id, 0.0)
        seat = body.seat
        return {
            **self.told,
            "verdict": item.verdict,
            "reason": item.reason,
            "depth": None if seat is None else seat.depth,
            "tilt": None if seat is None else math.degrees(seat.tilt),
            "penetration": greatest,
            "lasting": self.hardware.penetrations.lasting.get(body.id, 0.0),
            "simulated": self.world.clock.now,
        }
