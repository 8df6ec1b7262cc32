"""Contact by position: an arm without torques in both simulations, and late or noisy devices."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
import pytest

from picktree.robot.control import CompliantMotion, ContactThresholds, GripperControl
from picktree.robot.control.admittance import AdmittanceReflex, VirtualBody
from picktree.robot.control.compliant_motion import GuardedMove
from picktree.robot.control.contact_motion import CompliantMotionResult
from picktree.robot.control.wrist_wrench import WristWrench
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware
from picktree.world import GripperCommand, GripperState, Pose, Wrench

from .control_cell import DOWN as LOOKING_DOWN
from .control_cell import HOME, MODEL, ROBOT, TICK, Backend, Cell, reach, swing
from .test_control_comply import DOWN_FREE, Press

DOWN = (0.0, 0.0, -1.0)


class KinematicPositions(KinematicHardware):
    """An arm that takes no torques."""

    takes_torque = False


class PhysicsPositions(PhysicsHardware):
    """An arm that takes no torques; the efforts of its rigid servo say nothing in a contact."""

    takes_torque = False
    feels_effort = False  # type: ignore[assignment]


BACKENDS = pytest.mark.parametrize("backend", [KinematicPositions, PhysicsPositions])
STILL = np.zeros(7)


def by_position(backend: Backend) -> Cell:
    """A cell in which a torque fails the test."""
    cell = Cell(backend=backend)

    def refuse(torque: object) -> None:
        raise AssertionError("a torque was commanded")

    cell.hardware.arm.apply_torque = refuse  # type: ignore[method-assign]
    return cell


@BACKENDS
def test_a_guarded_move_meets_the_table_slowly_and_stops_at_the_force(backend: Backend) -> None:
    cell = by_position(backend)
    cell.go(0.5, 0.1, 0.03)
    doing = cell.move.guarded(DOWN, 0.08, force=4.0, speed=0.05)
    cell.ticks(doing, 8)
    assert cell.loop.controller == "CartesianAdmittance"
    speeds: list[float] = []
    before = cell.loop.tcp.position[2]
    for _ in range(10):
        cell.ticks(doing, 1)
        speeds.append((before - cell.loop.tcp.position[2]) / TICK)
        before = cell.loop.tcp.position[2]
    assert max(speeds) == pytest.approx(0.015, abs=1e-3)
    result = cell.run(doing)
    assert result.contact and 4.0 < result.force < 55.0
    assert result.travelled == pytest.approx(0.03 - ROBOT.gripper.tip, abs=1.5e-3)
    assert cell.monitor.stopped is None


def test_a_tool_leaves_a_contact_by_the_force_before_it() -> None:
    """By the force in the contact, the missing one would pull it back towards the table, by 2 mm here."""
    cell = by_position(PhysicsPositions)
    cell.go(0.5, 0.1, 0.03)
    touched = cell.run(cell.move.guarded(DOWN, 0.08, force=4.0, speed=0.02, press=15.0))
    assert touched.contact
    begin = cell.loop.tcp.position[2]
    left = cell.run(cell.move.guarded((0.0, 0.0, 1.0), 0.03, force=25.0, speed=0.02, zero=touched.zero))
    assert not left.contact and left.zero is touched.zero
    assert cell.loop.tcp.position[2] - begin == pytest.approx(0.03, abs=5e-4)


def test_without_stiffness_along_an_axis_the_wrench_is_the_force() -> None:
    cell = by_position(KinematicPositions)
    cell.go(0.5, 0.1, 0.02)
    course = Press(8.0, 1.6)

    def press(course: CompliantMotion) -> Generator[None, None, CompliantMotionResult]:
        with cell.loop.contact(500):
            return (yield from cell.move.comply(course, 3.0, stiffness=DOWN_FREE))

    assert cell.run(press(course)).finished
    assert float(np.mean(course.felt[-200:])) == pytest.approx(8.0, abs=0.7)
    assert max(map(abs, course.felt)) < 30.0


@BACKENDS
def test_a_soft_motion_gives_way_to_the_table(backend: Backend) -> None:
    cell = by_position(backend)
    cell.go(0.5, 0.1, 0.03)
    start = cell.loop.held_position
    into = swing(start, reach(Pose((0.5, 0.1, -0.005), LOOKING_DOWN), start), 3.0)
    result = cell.run(cell.move.softly(into, ContactThresholds(1.2, 3.0)))
    assert result.touched and not result.completed
    assert result.push[2] > 2.0
    assert cell.loop.tcp.position[2] > 0.0
    assert cell.monitor.stopped is None
    free = swing(cell.loop.held_position, start, 2.0)
    assert cell.run(cell.move.softly(free, ContactThresholds(1.2, 3.0))).completed


@dataclass
class Sensor:
    """A wrist that reads the weight of the hand and `force`."""

    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    now: float = 0.0

    def read(self) -> Wrench:
        x, y, z = self.force
        return Wrench((x, y, z - MODEL.hand_mass * 9.81))


def test_a_reflex_goes_with_the_push_and_ends_when_nothing_pushes() -> None:
    sensor = Sensor((0.0, 25.0, 0.0))
    wrist = WristWrench(sensor, MODEL, sensor)
    cell = Cell()
    state, setpoint = cell.loop.state, cell.loop._drive.setpoint
    reflex = AdmittanceReflex(MODEL, 0.005, wrist, np.zeros(6), latency=0.0)
    reflex.start(0.0, state, setpoint)
    begin = np.array(MODEL.tcp(setpoint.position).position)
    for k in range(60):
        sensor.force = (0.0, 25.0 if k < 20 else 0.0, 0.0)
        sensor.now += 0.005
        wrist.sample()
        command = reflex.update(sensor.now, state)
        if reflex.done:
            break
    moved = np.array(MODEL.tcp(command.position).position) - begin
    assert reflex.done and reflex.calm
    assert 0.003 < moved[1] < 0.03
    assert np.abs(moved[[0, 2]]).max() < 0.002


def contact_force(latency: float, delay: float, damping: float = 1.0) -> float:
    """Greatest force of a body that presses with 10 N on a wall of 10⁵ N/m, felt after `delay` s."""
    body = VirtualBody(MODEL, 0.005, latency, damping)
    jacobian = MODEL.jacobian(HOME)
    felt = deque([0.0] * (1 + round(delay / 0.005)))
    depth = greatest = 0.0
    for _ in range(400):
        push = np.array([0.0, 0.0, felt.popleft() - 10.0, 0.0, 0.0, 0.0])
        body.move(np.zeros((6, 6)), np.zeros(6), np.zeros(6), push)
        depth -= 0.005 * float((jacobian @ body.follow(jacobian, STILL))[2])
        felt.append(1e5 * max(depth, 0.0))
        greatest = max(greatest, felt[-1])
    return greatest


def test_a_late_force_is_damped_by_its_latency() -> None:
    assert contact_force(0.0, 0.0) < 30.0
    assert contact_force(0.04, 0.04) < 60.0 < contact_force(0.0, 0.04)


def test_a_guarded_move_does_not_bounce_on_a_rigid_contact() -> None:
    assert contact_force(0.0, 0.01, GuardedMove.damping) < 20.0 < 60.0 < contact_force(0.0, 0.01)


def test_the_inertia_of_the_hand_does_not_shake_the_arm() -> None:
    """The wrist feels, one period late, the torque that turns the hand."""
    body = VirtualBody(MODEL, 0.005, 0.0)
    jacobian = MODEL.jacobian(HOME)
    turning, felt, rates = np.zeros(3), np.array([0.0, 0.0, 0.5]), []
    for _ in range(200):
        body.move(np.zeros((6, 6)), np.zeros(6), np.zeros(6), np.concatenate([np.zeros(3), felt]))
        now = (jacobian @ body.follow(jacobian, STILL))[3:]
        felt, turning = -MODEL.hand_inertia * (now - turning) / 0.005, now
        rates.append(float(np.abs(now).max()))
    assert max(rates) < 0.05 and rates[-1] < 1e-3


def test_a_noisy_wrist_is_not_taken_for_a_vibration() -> None:
    sensor = Sensor()
    wrist = WristWrench(sensor, MODEL, sensor)

    def sample(*force: float) -> None:
        sensor.now += 0.005
        sensor.force = (force[0], force[1], force[2])
        wrist.sample()

    rng = np.random.default_rng(0)
    for _ in range(400):
        sample(*rng.normal(0.0, 1.0, 3))
        assert len(wrist.stamps) < 20 or not wrist.vibrates(0.1, 0.6)
    assert wrist.unrest(0.1) > 0.6
    assert wrist.noise(0.1) == pytest.approx(1.0, abs=0.4)
    assert wrist.zero(0.1, HOME)
    for k in range(40):  # a vibration of 10 Hz
        sample(4.0 * float(np.sin(2 * np.pi * 10 * 0.005 * k)), 0.0, 0.0)
    assert wrist.vibrates(0.1, 0.6)


@dataclass
class LateFingers:
    """Fingers that begin to move some time after their command, and say so."""

    latency: float
    now: float = 0.0
    width: float = 0.02
    target: float = 0.02
    since: float = -1.0

    def read(self) -> GripperState:
        pending = self.now - self.since < self.latency
        return GripperState(self.width, 0.0, 0.0, busy=pending and self.width != self.target)

    def command(self, command: GripperCommand) -> None:
        self.target, self.since = command.width, self.now

    def tick(self) -> None:
        self.now += TICK
        if self.now - self.since >= self.latency:
            self.width += min(max(self.target - self.width, -0.2 * TICK), 0.2 * TICK)


@pytest.mark.parametrize("latency", [0.0, 0.25])
def test_fingers_that_are_busy_are_waited_for(latency: float) -> None:
    fingers = LateFingers(latency)
    doing = GripperControl(fingers, fingers, ROBOT.gripper).open()
    while next(doing, "done") is None:
        fingers.tick()
    assert fingers.width == pytest.approx(0.08, abs=2e-3)


def test_tracking_is_judged_by_the_set_point_of_a_latency_ago() -> None:
    cell = Cell()
    cell.hardware.latency = 0.04  # type: ignore[misc]
    loop, told = cell.loop, []
    for k in range(12):
        told.append(loop._told(np.full(7, float(k))))
        cell.hardware.clock.periods += 1
    delay = round(0.04 * 240)
    assert told[-1] is not None and told[-1][0] == pytest.approx(11 - delay, abs=1)
