"""The parts of the control loop, each by itself: sampling, drive, contact guard, bias, supervision."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from picktree.robot.control import HoldController, SafetyMonitor
from picktree.robot.control.commands import JointCommand
from picktree.robot.control.control_loop import ArmDrive, ArmSampler, Supervision, Watchdog
from picktree.robot.control.force_guard import ContactGuard, ForceGuard
from picktree.robot.control.impedance import ContactReflex
from picktree.robot.control.joint_controllers import BrakeController, TrajectoryController
from picktree.robot.control.wrist_wrench import BiasEstimator, WristWrench
from picktree.world import GRAVITY, Array, Hardware, JointState, Journal, SensorStamps, Wrench, safety

from .control_cell import HOME, MODEL, swing, table_scene

STILL = np.zeros(7)
PERIOD = 1 / 240


@dataclass
class Bench:
    """Hardware without physics: an arm and a wrist sensor that read what the test sets."""

    position: Array = field(default_factory=HOME.copy)
    velocity: Array = field(default_factory=STILL.copy)
    force: Array = field(default_factory=lambda: np.zeros(3))
    """Contact force on the hand, N in the world."""
    torque: Array = field(default_factory=STILL.copy)
    """Efforts beyond the arm's own weight, Nm."""
    now: float = 0.0
    period: float = PERIOD
    feels_effort: bool = True
    followed: list[Array] = field(default_factory=list[Array])

    @property
    def arm(self) -> Any:
        return SimpleNamespace(read=self.state, follow=self._follow, apply_torque=print)

    def _follow(self, position: Array, velocity: Array) -> None:
        self.followed.append(position)

    @property
    def wrench(self) -> Any:
        return SimpleNamespace(read=self._wrench)

    @property
    def clock(self) -> Any:
        return self

    @property
    def stamps(self) -> SensorStamps:
        return SensorStamps(self.now, self.now, self.now)

    def state(self) -> JointState:
        return JointState(self.position, self.velocity, MODEL.gravity(self.position) + self.torque)

    def _wrench(self) -> Wrench:
        weight = np.array([0.0, 0.0, -MODEL.hand_mass * GRAVITY])
        lever = MODEL.flange(self.position).rotation() @ np.array(MODEL.hand_com)
        x, y, z = (weight + self.force).tolist()
        a, b, c = np.cross(lever, weight).tolist()
        return Wrench((x, y, z), (a, b, c))


def parts(bench: Bench) -> SimpleNamespace:
    hardware = cast("Hardware", bench)
    journal = Journal()
    monitor = SafetyMonitor(MODEL, table_scene().limits, journal)
    sampler = ArmSampler(hardware, MODEL)
    bias = BiasEstimator(MODEL, monitor, sampler.wrist)
    supervision = Supervision(hardware, MODEL, monitor, sampler, bias)
    return SimpleNamespace(
        journal=journal, monitor=monitor, sampler=sampler, bias=bias, supervision=supervision
    )


def sampled(bench: Bench, sampler: ArmSampler, count: int = 1, *, held: bool = True) -> JointState:
    for _ in range(count):
        bench.now += PERIOD
        sampler.sample(held)
    return sampler.state


def test_the_time_at_rest_counts_while_the_arm_is_held_and_stands() -> None:
    bench = Bench()
    sampler = ArmSampler(cast("Hardware", bench), MODEL)
    sampled(bench, sampler, 24)
    assert sampler.standing == 24
    assert sampler.rested(0.1) and not sampler.rested(0.105)
    sampled(bench, sampler, held=False)
    assert sampler.standing == 0
    sampled(bench, sampler, 3)
    bench.velocity = np.full(7, 0.02)
    sampled(bench, sampler)
    assert sampler.standing == 0


def test_the_acceleration_is_that_of_the_last_period() -> None:
    bench = Bench()
    sampler = ArmSampler(cast("Hardware", bench), MODEL)
    bench.velocity = np.full(7, 0.5)
    sampled(bench, sampler)
    bench.velocity = np.full(7, 0.6)
    sampled(bench, sampler)
    assert sampler.acceleration == pytest.approx(np.full(7, 24.0))
    sampler.restore(5)
    assert sampler.standing == 5 and not sampler.acceleration.any()


def test_a_drive_holds_when_its_motion_is_over() -> None:
    bench = Bench()
    drive = ArmDrive(cast("Hardware", bench), MODEL, bench.state())
    assert drive.held and drive.reference is not None
    motion = swing(HOME, HOME + 0.1, 0.2)
    drive.begin(TrajectoryController(motion, MODEL, PERIOD), bench.state())
    assert not drive.held
    for _ in range(60):
        drive.command(bench.state())
        bench.now += PERIOD
    assert drive.held
    assert bench.followed[-1] == pytest.approx(HOME + 0.1)
    assert drive.reference == pytest.approx(HOME + 0.1)


def test_a_drive_off_its_set_point_brakes_where_the_arm_stands() -> None:
    for off, controller in ((0.005, HoldController), (0.02, BrakeController)):
        bench = Bench()
        drive = ArmDrive(cast("Hardware", bench), MODEL, bench.state())
        bench.position = HOME + off
        drive.brake(bench.state())
        assert type(drive.controller) is controller
        assert drive.braking
        assert (drive.reference is None) is (controller is BrakeController)


@pytest.mark.parametrize(("pushed", "controller"), [(False, BrakeController), (True, ContactReflex)])
def test_a_drive_complies_after_a_contact_only(pushed: bool, controller: type) -> None:
    bench = Bench()
    drive = ArmDrive(cast("Hardware", bench), MODEL, bench.state())
    drive.stop_at_once(bench.state(), pushed=pushed)
    assert type(drive.controller) is controller
    assert drive.reference is None
    assert isinstance(drive.setpoint, JointCommand)


def test_the_arm_is_pushed_by_a_force_at_the_wrist_or_by_efforts_that_nothing_explains() -> None:
    bench = Bench()
    loop = parts(bench)
    assert [loop.supervision.pushed((0.0, force, 0.0)) for force in (19.0, 21.0)] == [False, True]
    loop.monitor.explained(MODEL.torque_limit, 1.0)
    loop.monitor.check_efforts(explained=False)
    assert loop.supervision.pushed((0.0, 0.0, 0.0))


@pytest.mark.parametrize("feels_effort", [True, False])
def test_the_inertia_of_the_hand_is_no_contact_where_efforts_are_measured(feels_effort: bool) -> None:
    bench = Bench()
    wrist = WristWrench(bench.wrench, MODEL, bench.clock)
    guard = ContactGuard(MODEL, wrist, feels_effort=feels_effort)
    acceleration = np.array([60.0, -40.0, 20.0, 50.0, 140.0, -120.0, 90.0])
    free = ContactGuard(MODEL, wrist, feels_effort=True)
    x, y, z = free._without_inertia(bench.state(), acceleration, (0.0, 0.0, 0.0))  # pyright: ignore[reportPrivateUsage]
    guard.guard = ForceGuard(15.0, (0.0, 0.0, 0.0))
    assert np.linalg.norm((x, y, z)) > 15.0
    assert guard.touched(bench.state(), acceleration, (-x, -y, -z)) is not feels_effort
    guard.guard = ForceGuard(15.0, (0.0, 0.0, 0.0))
    assert guard.touched(bench.state(), STILL, (0.0, 0.0, 16.0))
    assert guard.guard.contact == pytest.approx((0.0, 0.0, 16.0))
    guard.guard = None
    assert not guard.touched(bench.state(), STILL, (0.0, 0.0, 99.0))


def test_the_first_rest_learns_a_bias_and_a_later_one_only_in_doubt() -> None:
    bench = Bench()
    loop = parts(bench)
    bench.force = np.array([1.0, 0.0, 0.0])
    state = sampled(bench, loop.sampler, 24)
    loop.bias.come_to_rest(state)
    assert loop.sampler.wrist.zeroed
    learnt = loop.sampler.wrist.learnt
    bench.force = np.array([2.0, 0.0, 0.0])
    state = sampled(bench, loop.sampler, 24)
    loop.bias.come_to_rest(state)
    assert loop.sampler.wrist.learnt == learnt
    loop.bias.doubtful = True
    loop.bias.come_to_rest(state)
    assert not loop.bias.doubtful
    assert loop.sampler.wrist.learnt != learnt


def test_an_empty_hand_is_tared_even_where_no_bias_is_learnt() -> None:
    bench = Bench()
    loop = parts(bench)
    state = sampled(bench, loop.sampler, 24)
    assert not loop.bias.zero_empty(state, rested=False)
    assert not loop.sampler.wrist.zeroed
    assert loop.bias.zero_empty(state, rested=True)
    assert loop.sampler.wrist.zeroed


def watch(bench: Bench, loop: SimpleNamespace, periods: int, force: float = 0.0) -> list[bool]:
    found = list[bool]()
    for _ in range(periods):
        state = sampled(bench, loop.sampler)
        found.append(loop.supervision.check(state, bench.position, (force, 0.0, 0.0), PERIOD))
    return found


def test_the_workspace_is_checked_in_every_fourth_period() -> None:
    bench = Bench()
    loop = parts(bench)
    assert not any(watch(bench, loop, 4))
    bench.position = HOME.copy()
    bench.position[[1, 3]] += (1.8, 0.5)  # the tool is below the table
    assert MODEL.tcp(bench.position).position[2] < -0.02
    assert watch(bench, loop, 4) == [False, False, False, True]
    assert loop.monitor.stopped is not None and loop.monitor.stopped.cause is safety.WORKSPACE
    assert not loop.supervision.is_off_path()


def test_a_force_takes_the_arm_off_its_way() -> None:
    bench = Bench()
    loop = parts(bench)
    assert watch(bench, loop, 30, force=100.0).count(True) == 1
    assert loop.monitor.stopped.cause is safety.FORCE_LIMIT
    assert loop.supervision.is_off_path()


def test_efforts_that_nothing_explains_stop_the_arm() -> None:
    bench = Bench()
    loop = parts(bench)
    watch(bench, loop, 24)
    loop.bias.come_to_rest(loop.sampler.state)
    bench.torque = MODEL.torque_limit * np.array([0.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert any(watch(bench, loop, 120))
    assert loop.monitor.stopped.cause is safety.TORQUE_LIMIT


@pytest.mark.parametrize(
    ("attended", "expired"),
    [({0, 1, 2, 3, 4, 5, 6, 7}, False), ({0}, True), ({0, 4}, False)],
)
def test_a_watchdog_expires_after_a_fifth_of_a_second(attended: set[int], expired: bool) -> None:
    watchdog = Watchdog()
    found = list[bool]()
    for k in range(8):
        watchdog.attended = k in attended
        found.append(watchdog.expired(0.05, moving=True))
    assert any(found) is expired
    assert not Watchdog().expired(1.0, moving=False)
