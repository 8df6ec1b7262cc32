"""Fingers close by feel: the hand gives way to what stands fast, and what is fragile is pressed gently."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from picktree.robot import World
from picktree.robot.control import ArmMotion, ControlLoop, GripperControl, SafetyMonitor
from picktree.robot.manipulation.compliant_closing import ClosingResult, close
from picktree.robot.manipulation.grip_force import grip_force
from picktree.simulation import score
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Box, Cylinder, Journal, JournalEvent, Pose
from picktree.world.event_types import CrushedEvent
from picktree.world.robot_model import RobotModel
from picktree.world.scene import CatalogueEntry, Spawn

from ..control.control_cell import DOWN, ROBOT, TICK, Cell, reach, swing, table_scene

INGOT = CatalogueEntry("ingot", "box", Box((0.04, 0.04, 0.04)), 1.5, 0.6)
CUP = CatalogueEntry("cup", "cylinder", Cylinder(0.028, 0.07), 0.06, 0.5, force_limit=8.0)


class Bench(Cell):
    """One item on the table, and the hand around it, `aside` m beside its middle along the fingers."""

    def __init__(self, entry: CatalogueEntry, aside: float) -> None:
        scene = replace(
            table_scene(),
            catalogue=(entry,),
            spawn=(Spawn({entry.kind: 1}, ("red",), ((0.5, 0.0), (0.5, 0.0))),),
        )
        self.scene = scene
        self.physics = PhysicsHardware(scene, ROBOT, 7)
        self.hardware = self.physics
        self.model = RobotModel(ROBOT)
        self.journal = Journal()
        self.monitor = SafetyMonitor(self.model, scene.limits, self.journal)
        self.loop = ControlLoop(self.hardware, self.model, self.monitor)
        self.move = ArmMotion(self.loop, self.model, self.hardware.clock, self.journal)
        self.grip = GripperControl(self.hardware.gripper, self.hardware.clock, ROBOT.gripper)
        item = self.physics.truth()[0].pose
        yaw = 2 * np.arctan2(item.orientation[2], item.orientation[3])
        self.tool = Pose((0.0, 0.0, 0.0), DOWN) @ Pose.from_rpy(
            (0.0, 0.0, 0.0), (0.0, 0.0, float(-yaw % (np.pi / 2)))
        )
        self.axis = self.tool.rotation()[:, 1]
        x, y, z = item.position + aside * self.axis
        for height in (0.15, z):
            start = self.loop.held_position
            goal = reach(Pose((float(x), float(y), float(height)), self.tool.orientation), start)
            self.run(self.move.along(swing(start, goal, 1.0)))
        self.run(self.loop.settle())
        self.before = np.array(self.physics.truth()[0].pose.position)

    def close(self, entry: CatalogueEntry) -> ClosingResult:
        world = SimpleNamespace(control=self.loop, gripper=self.grip, robot=self.model, move=self.move)
        world.clock, world.journal = self.hardware.clock, self.journal
        press = grip_force(entry, 70.0, ROBOT.gripper)
        closed = self.run(close(cast("World", world), press, "test"))
        self.grip.press(press.grip)
        for _ in range(5):
            self.loop.step_tick(TICK)
        return closed

    @property
    def moved(self) -> float:
        return float(np.linalg.norm(np.array(self.physics.truth()[0].pose.position) - self.before))

    @property
    def touching(self) -> set[str]:
        return {
            name
            for contact in self.physics.true_contacts()
            for name in (contact.one, contact.other)
            if "finger" in name and contact.force > 0.5
        }


@pytest.mark.parametrize("aside", [0.006, -0.006])
def test_the_hand_gives_way_to_what_stands_fast(aside: float) -> None:
    bench = Bench(INGOT, aside)
    closed = bench.close(INGOT)
    assert closed.gave_way == pytest.approx(-aside, abs=1.5e-3)
    assert closed.width == pytest.approx(0.04, abs=1e-3)
    assert bench.moved < 1.5e-3
    assert bench.touching == set(ROBOT.gripper.fingers)
    told = [e.message for e in bench.journal.take() if isinstance(e, JournalEvent)]
    assert [message[:20] for message in told] == ["the hand gave way by"]


def test_what_is_light_is_pushed_to_the_middle_and_not_crushed() -> None:
    bench = Bench(CUP, 0.006)
    closed = bench.close(CUP)
    assert closed.gave_way == 0.0
    assert bench.moved == pytest.approx(0.006, abs=5e-4)
    assert bench.touching == set(ROBOT.gripper.fingers)
    (pressed,) = bench.physics.crushing.greatest_forces().values()
    assert 2.0 < pressed.gripped < 0.75 * pressed.limit
    assert bench.physics.take_events() == ()


def test_what_is_gripped_too_hard_is_crushed_for_good() -> None:
    bench = Bench(CUP, 0.0)
    bench.run(bench.grip.close(12.0))
    (event,) = bench.physics.take_events()
    assert isinstance(event, CrushedEvent)
    said = f"item_00 was crushed: {event.finger} pressed with {event.force:.1f} N, and it bears 8 N"
    assert event.message == said
    bench.run(bench.grip.open())
    bench.physics.checkpoint()
    assert bench.physics.take_events() == ()
    (item,) = score(bench.physics.truth(), bench.scene).items
    (pressed,) = bench.physics.crushing.greatest_forces().values()
    assert item.verdict == "misplaced"
    assert item.reason == f"it was crushed: a finger pressed with {pressed.force:.1f} N"


def test_fingers_close_no_faster_than_they_are_told() -> None:
    bench = Bench(CUP, 0.0)
    bench.grip.start(0.0, 5.0, speed=0.02)
    for _ in range(2):
        bench.loop.step_tick(TICK)
        assert bench.grip.state.speed == pytest.approx(-0.04, abs=1e-3)
