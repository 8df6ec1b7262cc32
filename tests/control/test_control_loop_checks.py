"""What the control loop makes of one reading: contact or inertia, brake or comply, hold or let go."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from picktree.control.execution.control_loop import ControlLoop
from picktree.control.joints.external_torque import EffortCheck
from picktree.control.joints.joint_controllers import HoldController, TrajectoryController
from picktree.control.safety.motion_lease import ForceGuard, Lease
from picktree.control.wrist.payload_estimate import Payload
from picktree.simulation.kinematic.backend import KinematicHardware
from picktree.world.protocols import Hardware
from picktree.world.values import GRAVITY, Array, JointState, Wrench

from .control_cell import HOME, MODEL, TICK, Backend, Cell, swing

STILL = np.zeros(7)
ASIDE = HOME + 0.3
PERIOD = 1 / 240


class FeelingHardware(KinematicHardware):
    """The kinematic backend, whose drives tell their efforts."""

    feels_effort = True  # type: ignore[assignment]


class Readings:
    """Arm and wrist sensor of a cell, which say what the test says, and do not follow their commands."""

    def __init__(self, cell: Cell) -> None:
        self.position, self.velocity = HOME.copy(), STILL
        self.force = np.zeros(3)
        """Beyond the weight of the hand, N in the world."""
        self.torque = STILL
        """Beyond the arm's own weight, Nm."""
        self.told: tuple[Array, Array] | None = None
        self.torque_told: Array | None = None
        hardware = cast("Hardware", _Scripted(cell.hardware, self))
        cell.loop = ControlLoop(hardware, cell.model, cell.monitor)

    def read(self) -> JointState:
        return JointState(self.position, self.velocity, MODEL.gravity(self.position) + self.torque)

    def follow(self, position: Array, velocity: Array) -> None:
        self.told = position, velocity

    def apply_torque(self, torque: Array) -> None:
        self.torque_told = torque


class _Scripted:
    """Hardware with another arm and another wrist sensor."""

    def __init__(self, hardware: Hardware, readings: Readings) -> None:
        self._hardware = hardware
        self.arm, self.wrench = readings, _Sensor(readings)

    def __getattr__(self, name: str) -> object:
        return getattr(self._hardware, name)


class _Sensor:
    def __init__(self, readings: Readings) -> None:
        self._readings = readings

    def read(self) -> Wrench:
        weight = np.array([0.0, 0.0, -MODEL.hand_mass * GRAVITY])
        lever = MODEL.flange(self._readings.position).rotation() @ np.array(MODEL.hand_com)
        x, y, z = (weight + self._readings.force).tolist()
        a, b, c = np.cross(lever, weight).tolist()
        return Wrench((x, y, z), (a, b, c))


def scripted(backend: Backend = KinematicHardware) -> tuple[Cell, Readings]:
    cell = Cell(backend=backend)
    return cell, Readings(cell)


def steps(cell: Cell, count: int) -> None:
    for _ in range(count):
        cell.loop.step()


def guarded(cell: Cell, limit: float = 15.0) -> tuple[Lease, ForceGuard]:
    lease, guard = cell.loop.acquire("test"), ForceGuard(limit, (0.0, 0.0, 0.0))
    lease.run(HoldController(), guard)
    return lease, guard


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_guard_feels_what_is_more_than_before_on_each_axis(axis: int) -> None:
    before = (3.0, -5.0, 8.0)
    guard = ForceGuard(10.0, before)
    for by in (9.9, -9.9, 10.1, -10.1):
        force = [*before]
        force[axis] += by
        x, y, z = force
        assert guard.size((x, y, z)) == pytest.approx(abs(by))
        assert guard.touched((x, y, z)) is (abs(by) > 10.0)
        touch = [0.0, 0.0, 0.0]
        touch[axis] = by
        assert guard.contact == (pytest.approx(touch) if abs(by) > 10.0 else None)
        guard.contact = None
    assert not ForceGuard(10.0, (0.0, 0.0, 0.0)).touched((0.0, 6.0, 8.0))  # just as much is none
    together = ForceGuard(10.0, before)
    assert not together.touched((3.0 + 5.7, -5.0 + 5.7, 8.0 + 5.7))
    assert together.touched((3.0 + 5.8, -5.0 + 5.8, 8.0 + 5.8))


def hand_acceleration(change: Array) -> Array:
    """Of the hand's centre of mass (3,), when the joints' speeds change so within a period, m/s²."""

    def centre(q: Array) -> Array:
        flange = MODEL.flange(q)
        return flange.rotation() @ np.array(MODEL.hand_com) + np.array(flange.position)

    return (centre(HOME + 1e-6 * change) - centre(HOME - 1e-6 * change)) / 2e-6 / PERIOD


@pytest.mark.parametrize("payload", [0.0, 0.4])
def test_what_accelerates_the_hand_is_no_contact(payload: float) -> None:
    first = np.array([0.1, 0.0, -0.1, 0.05, 0.0, 0.1, 0.0])
    change = np.array([0.3, -0.2, 0.1, 0.2, 0.6, -0.5, 0.4])
    inertia = -(MODEL.hand_mass + payload) * hand_acceleration(change)
    assert np.linalg.norm(inertia) > 20.0
    for touch, felt in (((0.0, 0.0, 0.0), False), ((3.0, -17.0, 8.0), True)):
        cell, readings = scripted(FeelingHardware)
        if payload:
            cell.loop.wrist.carry(Payload(payload, 0.01))
        _, guard = guarded(cell)
        readings.velocity = first
        steps(cell, 1)
        readings.velocity = first + change
        readings.force = inertia + np.array(touch)
        assert np.linalg.norm(readings.force) > 15.0
        steps(cell, 1)
        assert guard.contact == (pytest.approx(touch, abs=1e-3) if felt else None)


def test_what_is_hardly_felt_is_no_contact_however_the_arm_is_accelerated() -> None:
    cell, readings = scripted(FeelingHardware)
    _, guard = guarded(cell)
    readings.velocity = np.array([0.3, -0.2, 0.1, 0.2, 0.6, -0.5, 0.4])
    readings.force = np.array([0.0, 0.0, 14.9])
    steps(cell, 1)
    assert guard.contact is None


def test_where_the_drives_tell_no_efforts_what_is_felt_is_a_contact() -> None:
    cell, readings = scripted()
    _, guard = guarded(cell)
    readings.velocity = np.array([0.3, -0.2, 0.1, 0.2, 0.6, -0.5, 0.4])
    readings.force = np.array([0.0, 12.0, 12.0])
    steps(cell, 1)
    assert guard.contact == pytest.approx((0.0, 12.0, 12.0))


@pytest.mark.parametrize(("force", "controller"), [(19.9, "Brake"), (20.1, "Comply")])
def test_a_contact_that_is_strong_is_complied_with(force: float, controller: str) -> None:
    cell, readings = scripted()
    guarded(cell)
    readings.velocity = np.full(7, 0.3)
    readings.force = np.array([0.0, 0.6 * force, -0.8 * force])
    steps(cell, 1)
    assert cell.loop.controller == controller


def moving() -> tuple[Cell, Readings, TrajectoryController, Lease]:
    cell, readings = scripted()
    track = TrajectoryController(swing(HOME, ASIDE, 3.0), MODEL, cell.loop.period)
    lease = cell.loop.acquire("test")
    lease.run(track)
    steps(cell, 1)
    return cell, readings, track, lease


def test_on_its_way_the_arm_brakes_along_it() -> None:
    """Of too fast a joint, and outside of the workspace, it is where it was told to be."""
    cell, readings, track, _ = moving()
    readings.velocity = 5.0 * np.eye(7)[2]
    steps(cell, 1)
    stop = cell.monitor.stopped
    assert stop is not None and stop.cause.name == "safety.speed_limit"
    assert (cell.loop.controller, track.braking) == ("Track", True)


def test_off_its_way_it_brakes_from_where_it_is() -> None:
    cell, readings, track, _ = moving()
    readings.position, readings.velocity = HOME + 0.06 * np.eye(7)[1], np.full(7, 0.3)
    steps(cell, 1)
    stop = cell.monitor.stopped
    assert stop is not None and stop.cause.name == "control.tracking"
    assert (cell.loop.controller, track.braking) == ("Brake", False)


def test_pushed_off_it_gives_way() -> None:
    cell, readings, track, _ = moving()
    readings.force = np.array([0.0, 90.0, 0.0])
    steps(cell, 40)
    stop = cell.monitor.stopped
    assert stop is not None and stop.cause.name == "safety.force_limit"
    assert (cell.loop.controller, track.braking) == ("Comply", False)


def test_overloaded_it_brakes_from_where_it_is() -> None:
    cell, readings, track, _ = moving()
    readings.torque, readings.velocity = MODEL.torque_limit * np.eye(7)[0], np.full(7, 0.3)
    steps(cell, 122)
    stop = cell.monitor.stopped
    assert stop is not None and stop.cause.name == "safety.torque_limit"
    assert (cell.loop.controller, track.braking) == ("Brake", False)


@pytest.mark.parametrize(
    ("off", "speed", "controller"),
    [(0.009, 0.0, "Hold"), (0.011, 0.0, "Brake"), (0.011, 0.019, "Brake"), (0.011, 0.021, "Hold")],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_arm_that_stands_beside_where_it_should_be_is_held_where_it_is(
    sign: float, off: float, speed: float, controller: str
) -> None:
    """Told to go back there it would jump as soon as what keeps it away lets go."""
    cell, readings = scripted()
    readings.position, readings.velocity = HOME + sign * off * np.eye(7)[3], speed * np.eye(7)[3]
    steps(cell, 1)
    cell.loop.acquire("test")
    assert cell.loop.controller == controller
    steps(cell, 1)
    assert (cell.loop.reference is None) is (controller == "Brake")
    steps(cell, 40)
    if controller == "Brake" and not speed:
        assert cell.loop.controller == "Hold"
        assert np.allclose(cell.loop.held_position, readings.position)


def test_an_arm_that_is_told_to_move_stands_beside_nothing() -> None:
    cell, readings, track, _ = moving()
    for _ in range(360):
        cell.loop.step()
        setpoint, _ = track.trajectory.sample(track.progress)
        readings.position = setpoint + 0.02
        if track.progress > 1.4:
            break
    cell.loop.acquire("other")
    assert (cell.loop.controller, track.braking) == ("Track", True)


def test_who_takes_the_arm_over_need_not_look_after_how_it_brakes() -> None:
    cell = Cell()
    track = TrajectoryController(swing(HOME, ASIDE, 1.0), MODEL, cell.loop.period)
    lease = cell.loop.acquire("test")
    lease.run(track)
    for _ in range(10):
        cell.loop.step_tick(TICK)
        assert lease.valid
    cell.loop.step_tick(TICK)
    cell.loop.acquire("other")
    cell.loop.step_tick(0.25)
    assert track.braking
    assert cell.monitor.stopped is None


def test_who_holds_the_arm_still_need_not_look_after_it() -> None:
    cell, _ = scripted()
    cell.loop.acquire("test").run(HoldController())
    cell.loop.step_tick(TICK)
    for _ in range(3):
        cell.loop.step_tick(0.25)
    assert cell.monitor.stopped is None


def test_who_takes_the_arm_over_is_not_stopped_by_the_guard_of_before() -> None:
    cell, readings = scripted()
    _, guard = guarded(cell)
    cell.loop.acquire("other")
    readings.force = np.array([0.0, 0.0, 30.0])
    steps(cell, 2)
    assert guard.contact is None
    assert cell.loop.controller == "Hold"


def test_a_contact_is_felt_once_and_need_not_be_looked_after() -> None:
    for force in (16.0, 30.0):  # braked, and complied with
        cell, readings = scripted()
        _, guard = guarded(cell)
        readings.velocity, readings.force = np.full(7, 0.3), np.array([0.0, 0.0, -force])
        steps(cell, 1)
        assert guard.contact == pytest.approx((0.0, 0.0, -force))
        readings.force = np.array([0.0, 0.0, -40.0])
        cell.loop.step_tick(TICK)
        cell.loop.step_tick(0.25)
        assert guard.contact == pytest.approx((0.0, 0.0, -force))
        assert cell.monitor.stopped is None


def test_what_is_let_off_for_a_retreat_stops_whoever_else_moves_the_arm() -> None:
    for owner, stops in (("Main/SafeRetreat", 1), ("Main/GoTo", 2)):
        cell, _ = scripted()
        cell.monitor.check_tool((9.0, 0.0, 0.5))
        cell.monitor.acknowledge("Main/SafeRetreat")
        lease = cell.loop.acquire(owner)
        lease.run(HoldController())
        assert cell.monitor.stops == 1
        lease.run(TrajectoryController(swing(HOME, ASIDE, 3.0), MODEL, cell.loop.period))
        assert cell.monitor.stops == stops


@pytest.mark.parametrize(
    ("speed", "periods", "learnt"),
    [(0.0, 23, False), (0.0, 24, True), (0.019, 24, True), (0.021, 24, False)],
)
def test_the_bias_of_the_wrist_is_learnt_after_a_tenth_of_a_second_at_rest(
    speed: float, periods: int, learnt: bool
) -> None:
    cell, readings = scripted()
    readings.force = np.array([0.5, 2.0, -1.0])
    readings.velocity = speed * np.array([0.6, 0.0, -0.8, 0.0, 0.0, 0.0, 0.0])
    steps(cell, periods)
    assert cell.loop.wrist.zeroed is learnt
    assert cell.loop.wrist.force == pytest.approx((0.0, 0.0, 0.0) if learnt else (0.5, 2.0, -1.0))


def test_a_moment_of_motion_lets_the_rest_begin_anew() -> None:
    cell, readings = scripted()
    steps(cell, 20)
    readings.velocity = np.full(7, 0.1)
    steps(cell, 1)
    readings.velocity = STILL
    steps(cell, 23)
    assert not cell.loop.wrist.zeroed
    steps(cell, 1)
    assert cell.loop.wrist.zeroed


def test_what_is_moved_is_not_at_rest_however_slowly() -> None:
    cell, *_ = moving()
    steps(cell, 40)
    assert not cell.loop.wrist.zeroed


def test_a_bias_turns_with_the_hand() -> None:
    cell, readings = scripted()
    bias = np.array([2.0, -1.0, 0.5])
    readings.force = bias
    steps(cell, 30)
    assert cell.loop.wrist.force == pytest.approx((0.0, 0.0, 0.0))
    readings.position = HOME + 1.2 * np.eye(7)[6] + 0.3 * np.eye(7)[5]
    turn = MODEL.tcp(readings.position).rotation() @ MODEL.tcp(HOME).rotation().T
    readings.force = turn @ bias
    steps(cell, 5)
    assert cell.loop.wrist.force == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def borne(force: Array) -> Array:
    """Torques of the joints that bear a force (3,) on the hand, at HOME, Nm."""
    return -flange_jacobian(HOME)[:3].T @ force


@pytest.mark.parametrize(
    ("force", "stops"),
    [
        ((0.0, 0.0, -40.0), "safety.payload"),
        ((0.0, 0.0, -20.0), ""),
        ((0.0, 0.0, 40.0), ""),
        ((0.0, -40.0, 0.0), ""),
    ],
)
def test_a_load_is_weighed_at_rest(force: tuple[float, float, float], stops: str) -> None:
    """The drives tell nothing here: what the wrist says is believed."""
    cell, readings = scripted()
    readings.force = np.array(force)
    steps(cell, 23)
    assert cell.monitor.stopped is None
    steps(cell, 5)
    stop = cell.monitor.stopped
    assert ("" if stop is None else stop.cause.name) == stops
    if stop is not None:
        assert stop.evidence["mass"] == pytest.approx(40.0 / GRAVITY, abs=1e-3)


def test_a_load_that_no_joint_bears_is_a_bias() -> None:
    load = np.array([0.0, 0.0, -40.0])
    for share, stops in ((0.0, ""), (1.0, "safety.payload")):
        cell, readings = scripted(FeelingHardware)
        steps(cell, 30)
        assert cell.loop.wrist.zeroed
        readings.force, readings.torque = load, share * borne(load)
        steps(cell, 60)
        stop = cell.monitor.stopped
        assert ("" if stop is None else stop.cause.name) == stops
        felt = load if share else np.zeros(3)
        assert cell.loop.wrist.force == pytest.approx(felt.tolist(), abs=0.1)


def test_a_load_that_swings_is_not_weighed_yet() -> None:
    load = np.array([0.0, 0.0, -40.0])
    cell, readings = scripted(FeelingHardware)
    steps(cell, 30)
    for k in range(120):
        swinging = load + 2.0 * np.sin(2.0 * k) * np.eye(3)[0]
        readings.force, readings.torque = swinging, borne(swinging)
        steps(cell, 1)
    assert cell.monitor.stopped is None
    readings.force, readings.torque = load, borne(load)
    steps(cell, 60)
    assert cell.monitor.stopped is not None
    assert cell.monitor.stopped.cause.name == "safety.payload"


def test_a_push_at_the_arm_stops_and_a_wrist_that_lies_does_not() -> None:
    """What only the wrist feels is its own fault, and is learnt when the arm comes to rest."""
    push = np.array([25.0, 15.0, 10.0])
    for wrist, joints, stops in ((0.0, 1.0, "safety.torque_limit"), (1.0, 0.0, ""), (1.0, 1.0, "")):
        cell, readings = scripted(FeelingHardware)
        steps(cell, 30)
        readings.velocity = np.full(7, 0.03)  # not at rest
        readings.force, readings.torque = wrist * push, 1.3 * joints * borne(push) / max(1.0, 1.3 * wrist)
        steps(cell, 120)
        stop = cell.monitor.stopped
        assert ("" if stop is None else stop.cause.name) == stops, (wrist, joints)
        readings.velocity = STILL
        steps(cell, 40)
        kept = wrist * joints * push
        assert cell.loop.wrist.force == pytest.approx(kept.tolist(), abs=0.5), (wrist, joints)


def test_commands_go_to_the_arm() -> None:
    cell, readings, track, _ = moving()
    steps(cell, 20)
    position, velocity = track.trajectory.sample(track.progress)
    assert readings.told is not None
    assert np.allclose(readings.told[0], position)
    assert np.allclose(readings.told[1], velocity)
    assert np.allclose(cell.loop.held_position, position)
    cell, readings = scripted()
    guarded(cell)
    readings.velocity, readings.force = np.full(7, 0.3), np.array([0.0, 0.0, -30.0])
    steps(cell, 3)
    assert readings.torque_told is not None
    assert cell.loop.reference is None


def test_who_moves_the_arm_must_look_after_it() -> None:
    cell, _, _, lease = moving()
    cell.loop.step_tick(TICK)
    cell.loop.step_tick(0.2)
    assert cell.monitor.stopped is None
    assert lease.valid
    cell.loop.step_tick(0.25)
    assert cell.monitor.stopped is None  # there was a sign since
    cell.loop.step_tick(0.25)
    assert cell.monitor.stopped is not None
    assert cell.monitor.stopped.evidence["seconds"] == 0.25


def test_what_the_hand_carries_is_known_after_a_twentieth_of_a_second_at_rest() -> None:
    weight = np.array([1.0, -2.0, -5.0])
    for periods, felt, known in (
        (11, weight, STILL[:3]),
        (12, weight, weight),
        (12, np.array([0.0, -11.9, -15.9]), np.array([0.0, -11.9, -15.9])),
        (12, np.array([0.0, -12.1, -16.1]), STILL[:3]),  # that is touched, not carried
    ):
        cell, readings = scripted()
        readings.force = felt
        steps(cell, periods)
        cell.loop.acquire("test").run(HoldController())
        assert cell.loop.save().carried[:3] == pytest.approx(known.tolist()), (periods, felt)
        assert cell.loop.save().carried[3:] == (0.0, 0.0, 0.0)


def test_efforts_are_looked_at_every_twentieth_of_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    cell, _ = scripted(FeelingHardware)
    elapsed: list[float] = []

    def explained(unexplained: Array, since: float) -> bool:
        elapsed.append(since)
        return True

    monkeypatch.setattr(cell.monitor, "explained", explained)
    steps(cell, 240)
    assert elapsed == pytest.approx([0.0625, *[0.05] * 18])  # a check of the tool apart


def test_where_the_drives_tell_no_efforts_none_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    cell, readings = scripted()
    readings.torque = 0.5 * MODEL.torque_limit
    steps(cell, 60)
    assert cell.monitor.stopped is None
    cell, readings = scripted(FeelingHardware)
    readings.torque = 0.5 * MODEL.torque_limit
    steps(cell, 60)
    assert cell.monitor.stopped is not None
    assert cell.monitor.stopped.cause.name == "safety.torque_limit"


@pytest.mark.parametrize(("share", "believed"), [(0.49, False), (0.51, True)])
def test_the_joints_believe_what_they_bear_half_of(share: float, believed: bool) -> None:
    """In each direction, whatever hand and load weigh besides."""
    judge = EffortCheck(MODEL)
    load = np.array([0.5, -0.3, -12.0, 0.4, 0.2, 0.1])
    for axis in range(3):
        push = 8.0 * np.eye(6)[axis]
        jacobian = flange_jacobian(ASIDE)
        # Gravity of the whole arm holds the hand, too; what hangs on it and pushes comes on top.
        held = MODEL.gravity(ASIDE) - jacobian.T @ (load + share * push)
        assert judge.believes(JointState(ASIDE, STILL, held), push, load) is believed, axis
    moving_ = JointState(ASIDE, np.full(7, 0.5), MODEL.gravity(ASIDE) - flange_jacobian(ASIDE).T @ load)
    assert judge.believes(moving_, np.zeros(6), load)  # nothing is claimed


def flange_jacobian(q: Array) -> Array:
    """(6, n) about the sensor, world axes, by finite differences."""
    rows = np.zeros((6, 7))
    for k in range(7):
        step = 1e-6 * np.eye(7)[k]
        ahead, behind = MODEL.flange(q + step), MODEL.flange(q - step)
        rows[:3, k] = np.subtract(ahead.position, behind.position) / 2e-6
        turn = (ahead.rotation() @ behind.rotation().T) / 2e-6
        rows[3:, k] = (
            (turn[2, 1] - turn[1, 2]) / 2,
            (turn[0, 2] - turn[2, 0]) / 2,
            (turn[1, 0] - turn[0, 1]) / 2,
        )
    return rows


def test_without_the_wrist_the_hand_and_its_load_are_explained_by_what_they_weigh() -> None:
    """The hand's centre of mass is beside the sensor's axis in this posture, and no twist is made up."""
    judge = EffortCheck(MODEL)
    load = np.array([0.5, -0.3, -12.0, 0.4, 0.2, 0.1])
    q = HOME + np.array([0.3, 0.2, -0.4, 0.5, 0.7, -0.6, 0.8])
    state = JointState(q, STILL, MODEL.gravity(q) - flange_jacobian(q).T @ load)
    assert judge.without_wrist(state, STILL, load) == pytest.approx(STILL, abs=1e-4)
    pushed = replace(state, effort=state.effort + 3.0 * np.eye(7)[2])
    assert judge.without_wrist(pushed, STILL, load) == pytest.approx(3.0 * np.eye(7)[2], abs=1e-4)
