"""The same controllers in physics, with noisy sensors and real contact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from picktree.robot.control import CartesianStiffness, CompliantMotion, HoldController
from picktree.robot.control.impedance import CartesianImpedance
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Array, Failure, Pose

from ..skills.cell import Cell as SortingCell
from ..skills.cell import items, mission
from .control_cell import DOWN, HOME, MODEL, ROBOT, Cell, reach, swing

TIP = ROBOT.gripper.tip


def cell(items: int = 0) -> Cell:
    return Cell(items, backend=PhysicsHardware)


@pytest.mark.parametrize("linear", [600.0, 1500.0, 3000.0])
def test_impedance_at_rest_stays_put(linear: float) -> None:
    one = cell()
    one.loop.step_tick(0.05)
    begin = one.hardware.true_tcp()
    lease = one.loop.acquire("test")
    lease.run(
        CartesianImpedance(one.model, one.loop.period, CompliantMotion(), CartesianStiffness(linear=linear))
    )
    speeds: list[float] = []
    for _ in range(40):
        one.loop.step_tick(0.05)
        speeds.append(float(np.abs(one.loop.state.velocity).max()))
    assert one.hardware.true_tcp().distance(begin) < 3e-4
    assert max(speeds[10:]) < 0.01
    lease.release()
    one.rest()
    assert one.hardware.true_tcp().distance(begin) < 3e-4


@pytest.mark.parametrize("speed", [0.02, 0.05, 0.1])
def test_guarded_move_onto_the_table(speed: float) -> None:
    one = cell()
    one.go(0.5, 0.1, 0.05)
    result = one.run(one.move.guarded((0.0, 0.0, -1.0), 0.08, force=4.0, speed=speed))
    assert result.contact
    assert result.travelled == pytest.approx(0.05 - TIP, abs=1.5e-3)
    assert one.loop.at_rest
    one.run(one.loop.settle())
    assert abs(one.loop.wrench_external().force[2]) < 4.0
    assert one.monitor.stopped is None
    up = one.run(one.move.guarded((0.0, 0.0, 1.0), 0.03, force=15.0, speed=0.1))
    # What was felt at its start counts as carried: up to 4 N of the contact, at 2000 N/m.
    assert not up.contact and up.travelled == pytest.approx(0.03, abs=2e-3)


def test_the_reflex_to_a_contact_carries_what_the_hand_holds() -> None:
    """The hand sank for as long as the reflex took, onto whatever was below."""
    scene = items(block=1)
    heavy = tuple(replace(e, mass=0.3) if e.kind == "block" else e for e in scene.catalogue)
    one = SortingCell(mission("Observe: {camera: overhead}"), replace(scene, catalogue=heavy), "physics")
    one.finish()
    (block,) = (o.id for o in one.world.scene.objects if o.role == "item")
    one.start(mission(f"Grasp: {{object: {block}, onward: false}}"))
    one.finish()
    one.wait()
    control = one.world.control
    control.acquire("test").run(HoldController())
    begin = one.hardware.true_tcp()
    control._drive.stop_at_once(control.state, pushed=True)  # pyright: ignore[reportPrivateUsage]
    for _ in range(240):
        control.step()
    assert control.controller == "Hold"
    assert one.hardware.true_tcp().distance(begin) < 2e-3


def test_collision_at_speed_latches_and_is_left_again() -> None:
    one = cell()
    one.go(0.5, 0.1, 0.10)
    start = one.loop.held_position
    into = swing(start, reach(Pose((0.5, 0.1, -0.05), DOWN), start), 0.8)
    with pytest.raises(Failure, match=r"^safety.force_limit: \d+ N at the wrist"):
        one.run(one.move.along(into))
    one.run(one.move.rest())
    one.run(one.loop.settle())
    assert one.loop.wrench_external().magnitude() < 15.0
    one.monitor.acknowledge()
    start = one.loop.held_position
    one.run(one.move.along(swing(start, reach(Pose((0.5, 0.1, 0.1), DOWN), start)), guard=25.0))
    assert one.monitor.stopped is None


def test_pick_feel_the_load_lower_and_let_go() -> None:
    one = cell(items=1)
    body = one.hardware.truth()[0]
    yaw = 2 * np.arctan2(body.pose.orientation[2], body.pose.orientation[3])
    x, y, _ = body.pose.position
    turn = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, float(-yaw % (np.pi / 2))))
    for height in (0.15, 0.02):
        start = one.loop.held_position
        goal = reach(Pose((x, y, height), DOWN) @ turn, start)
        one.run(one.move.along(swing(start, goal), guard=25.0))
        one.run(one.loop.settle())
    one.loop.tare()
    width = one.run(one.grip.close(30.0))
    assert width == pytest.approx(0.04, abs=1.5e-3)
    one.run(one.move.guarded((0.0, 0.0, 1.0), 0.1, force=15.0, speed=0.1))
    one.run(one.loop.settle())
    assert one.loop.load() == pytest.approx(0.1 * 9.81, abs=0.12)
    result = one.run(one.move.guarded((0.0, 0.0, -1.0), 0.15, force=4.0, speed=0.05))
    assert result.contact
    assert result.travelled == pytest.approx(0.1, abs=3e-3)
    one.run(one.grip.open())
    assert one.hardware.truth()[0].pose.position[2] == pytest.approx(0.02, abs=1e-3)
    assert one.monitor.stopped is None


def test_halting_at_random_ticks_brings_the_arm_to_rest() -> None:
    rng = np.random.default_rng(5)
    one = cell()
    goal = HOME + np.array([0.5, 0.2, -0.3, 0.3, 0.2, -0.3, 0.5])
    for _ in range(6):
        start = one.loop.held_position
        ends: Array = goal if np.abs(start - HOME).max() < 0.3 else HOME
        motion = one.move.along(swing(start, ends, 1.2))
        press = one.move.guarded((0.0, 0.0, -1.0), 0.1, force=4.0, speed=0.08)
        for doing in (motion, press):
            one.ticks(doing, int(rng.integers(1, 22)))
            doing.close()
            one.rest()
            assert np.isfinite(one.loop.state.position).all()
            assert np.all(one.loop.state.position > MODEL.lower)
    assert one.monitor.stopped is None
