"""The safety monitor: latched, acknowledged by one voice, and no trap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.robot.control import SafetyMonitor
from picktree.world import Array, Bounds, Failure, JointState, Journal, Pose, Vector3
from picktree.world.scene import SafetyLimits

from .control_cell import DOWN, HOME, MODEL, Cell, reach, swing

CALM: Vector3 = (0.0, 0.0, 0.0)
PERIOD = 1 / 240


def state(position: Array = HOME, velocity: Array | None = None) -> JointState:
    return JointState(position, np.zeros(7) if velocity is None else velocity, np.zeros(7))


def monitor() -> SafetyMonitor:
    return SafetyMonitor(MODEL, SafetyLimits(60.0, Bounds((0.0, -0.5, 0.0), (0.8, 0.5, 1.0))), Journal())


def test_each_limit_stops_with_its_cause() -> None:
    fast = np.zeros(7)
    fast[4] = -3.2
    beyond = HOME.copy()
    beyond[3] = 0.0
    cases = [
        (state(velocity=fast), HOME, CALM, "safety.speed_limit: panda_joint5 moves at -3.20 rad/s"),
        (
            state(beyond),
            beyond,
            CALM,
            "safety.joint_limit: panda_joint4 at 0.0 deg is 4.0 deg beyond its limit of -4.0 deg",
        ),
        (
            state(),
            HOME + 0.06 * np.eye(7)[5],
            CALM,
            "control.tracking: panda_joint6 is 0.060 rad from where it was told to be",
        ),
        (
            state(),
            HOME,
            (0.0, 60.0, 45.0),
            "safety.force_limit: 61 N at the wrist, above the limit of 60 N",
        ),
    ]
    for reading, commanded, force, text in cases:
        watch = monitor()
        tripped = [watch.check(reading, commanded, force, PERIOD) for _ in range(60)]
        assert tripped.count(True) == 1
        assert watch.stopped is not None
        assert f"{watch.stopped.cause}: {watch.stopped.message}" == text
        assert watch.stops == 1


def test_workspace() -> None:
    watch = monitor()
    assert not watch.check_tool((0.4, 0.0, 0.3))
    assert watch.check_tool((0.4, 0.53, 0.3))
    assert watch.stopped is not None
    assert watch.stopped.message == "the tool is 30 mm outside the workspace: y = 530 mm, at most 500 mm"


def test_a_short_blow_is_no_stop_but_a_push_is() -> None:
    watch = monitor()
    for size in (400.0, 120.0, 30.0, 0.0):
        assert not watch.check(state(), HOME, (0.0, 0.0, size), PERIOD)
    for _ in range(60):
        watch.check(state(), HOME, CALM, PERIOD)
    periods = 1
    while not watch.check(state(), HOME, (0.0, 0.0, 165.0), PERIOD):
        periods += 1
    assert periods == 5


def test_after_acknowledging_what_stands_is_tolerated_until_it_grows() -> None:
    watch = monitor()

    def push(size: float) -> bool:
        tripped = [watch.check(state(), HOME, (0.0, 0.0, size), PERIOD) for _ in range(120)]
        return any(tripped)

    assert push(80.0)
    assert not push(80.0)
    watch.acknowledge()
    assert not push(82.0)
    assert not push(70.0)
    assert push(90.0)
    watch.acknowledge()
    assert not push(0.0)
    assert push(65.0)
    assert watch.stops == 3


def crashed() -> Cell:
    """A cell whose arm has run into the table: a stop is latched."""
    cell = Cell(force=30.0)
    cell.go(0.5, 0.1, 0.08)
    start = cell.loop.held_position
    into_table = reach(Pose((0.5, 0.1, -0.02), DOWN), start)
    with pytest.raises(Failure, match=r"^safety.force_limit: \d+ N at the wrist, above the limit of 30 N$"):
        cell.run(cell.move.along(swing(start, into_table, 1.0)))
    return cell


def test_latched_stop_refuses_motion_until_acknowledged() -> None:
    cell = crashed()
    events = [e for e in cell.events() if e.kind == "safety_stop"]
    assert [e.data["cause"] for e in events] == ["safety.force_limit"]
    cell.run(cell.move.rest())
    assert abs(cell.loop.wrist.force[2]) < 10.0
    start = cell.loop.held_position
    up = swing(start, reach(Pose((0.5, 0.1, 0.1), DOWN), start))
    guarded = cell.move.guarded((0.0, 0.0, 1.0), 0.05, force=5.0, speed=0.05)
    for motion in (cell.move.along(up), guarded):
        with pytest.raises(Failure, match=r"^safety.stop: a safety stop is not acknowledged: \d+ N at"):
            cell.run(motion)
    cell.run(cell.move.rest())
    cell.monitor.acknowledge()
    cell.run(cell.move.along(up))
    assert cell.loop.tcp.position[2] == pytest.approx(0.1, abs=1e-6)
    assert cell.monitor.stopped is None and cell.monitor.stops == 1


def test_save_and_restore_at_rest() -> None:
    cell = crashed()
    cell.run(cell.move.rest())
    cell.loop.tare()
    saved = cell.loop.save()
    twin = Cell(force=30.0)
    twin.hardware.restore(cell.hardware.checkpoint())
    twin.loop.restore(saved)
    assert twin.loop.save() == saved
    assert twin.monitor.stopped == cell.monitor.stopped
    for one in (cell, twin):
        one.monitor.acknowledge()
        start = one.loop.held_position
        one.run(one.move.along(swing(start, HOME)))
    assert twin.hardware.checkpoint() == cell.hardware.checkpoint()
    assert twin.loop.save() == cell.loop.save()


def test_no_saving_while_moving() -> None:
    cell = Cell()
    cell.ticks(cell.move.along(swing(HOME, HOME + 0.1)), 5)
    with pytest.raises(PicktreeError, match="only be saved while the arm is held at rest"):
        cell.loop.save()


def test_a_lease_from_before_a_restore_is_stale() -> None:
    cell = Cell()
    cell.loop.step_tick(0.05)
    saved = replace(cell.loop.save())
    lease = cell.loop.acquire("before")
    cell.loop.restore(saved)
    assert not lease.valid
