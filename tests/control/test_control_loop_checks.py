"""What the control loop makes of one reading: contact or inertia, brake or comply, hold or let go."""

from __future__ import annotations

import numpy as np
import pytest

from picktree.robot.control import HoldController, Payload
from picktree.robot.control.control_loop import Watchdog
from picktree.robot.control.force_guard import ForceGuard
from picktree.robot.control.joint_controllers import TrajectoryController
from picktree.robot.control.motion_lease import Lease
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import Array

from .control_cell import HOME, MODEL, TICK, Backend, Cell, swing
from .scripted_cell import ASIDE, PERIOD, FeelingHardware, moving, scripted, steps

SLOW = np.full(7, 0.3)


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


@pytest.mark.parametrize(
    ("backend", "force", "felt"),
    [(FeelingHardware, (0.0, 0.0, 14.9), False), (KinematicHardware, (0.0, 12.0, 12.0), True)],
    ids=["hardly felt", "no efforts told"],
)
def test_where_the_drives_tell_no_efforts_what_is_felt_is_a_contact(
    backend: Backend, force: tuple[float, float, float], felt: bool
) -> None:
    """What is hardly felt is none, however the arm is accelerated."""
    cell, readings = scripted(backend)
    _, guard = guarded(cell)
    readings.velocity = np.array([0.3, -0.2, 0.1, 0.2, 0.6, -0.5, 0.4])
    readings.force = np.array(force)
    steps(cell, 1)
    assert guard.contact == (pytest.approx(force) if felt else None)


@pytest.mark.parametrize(("force", "controller"), [(19.9, "Brake"), (20.1, "Comply")])
def test_a_contact_that_is_strong_is_complied_with(force: float, controller: str) -> None:
    cell, readings = scripted()
    guarded(cell)
    readings.velocity = SLOW
    readings.force = np.array([0.0, 0.6 * force, -0.8 * force])
    steps(cell, 1)
    assert cell.loop.controller == controller


@pytest.mark.parametrize(
    ("read", "periods", "cause", "controller"),
    [
        ({"velocity": 5.0 * np.eye(7)[2]}, 1, "safety.speed_limit", "Track"),
        ({"position": HOME + 0.06 * np.eye(7)[1], "velocity": SLOW}, 1, "control.tracking", "Brake"),
        ({"force": np.array([0.0, 90.0, 0.0])}, 40, "safety.force_limit", "Comply"),
        (
            {"torque": MODEL.torque_limit * np.eye(7)[0], "velocity": SLOW},
            122,
            "safety.torque_limit",
            "Brake",
        ),
    ],
    ids=["on its way", "off its way", "pushed off", "overloaded"],
)
def test_an_arm_brakes_along_its_way_or_where_it_is_or_gives_way(
    read: dict[str, Array], periods: int, cause: str, controller: str
) -> None:
    """Of too fast a joint, and outside of the workspace, it is where it was told to be."""
    cell, readings, track, _ = moving()
    for name, value in read.items():
        setattr(readings, name, value)
    steps(cell, periods)
    stop = cell.monitor.stopped
    assert stop is not None and stop.cause.name == cause
    assert (cell.loop.controller, track.braking) == (controller, controller == "Track")


def test_the_tool_is_looked_at_in_every_fourth_period() -> None:
    cell, readings = scripted()
    steps(cell, 4)
    below = HOME + np.array([0.0, 1.8, 0.0, 0.5, 0.0, 0.0, 0.0])
    assert MODEL.tcp(below).position[2] < -0.02
    readings.position = below
    steps(cell, 3)
    levels = [key for key, _ in cell.monitor.state().levels]
    assert "safety.workspace" not in levels
    steps(cell, 1)
    assert "safety.workspace" in [key for key, _ in cell.monitor.state().levels]


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
        readings.velocity, readings.force = SLOW, np.array([0.0, 0.0, -force])
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
    readings.velocity, readings.force = SLOW, np.array([0.0, 0.0, -30.0])
    steps(cell, 3)
    assert readings.torque_told is not None
    assert cell.loop.reference is None


@pytest.mark.parametrize(("attended", "expired"), [(set(range(8)), False), ({0}, True), ({0, 4}, False)])
def test_a_watchdog_expires_after_a_fifth_of_a_second(attended: set[int], expired: bool) -> None:
    watchdog, found = Watchdog(), list[bool]()
    for k in range(8):
        watchdog.attended = k in attended
        found.append(watchdog.expired(0.05, moving=True))
    assert any(found) is expired
    assert not Watchdog().expired(1.0, moving=False)
