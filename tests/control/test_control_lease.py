"""Who may move the arm, in which order, and how it comes to rest."""

from __future__ import annotations

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.robot.control import CompliantMotion, HoldController
from picktree.robot.control.impedance import (
    CartesianImpedance,
    ContactReflex,
    GravityCompensationController,
    JointImpedanceController,
)
from picktree.robot.control.joint_controllers import BrakeController, TrajectoryController
from picktree.robot.control.motion_lease import Lease
from picktree.robot.control.velocity_controller import JogController
from picktree.world import Array, Failure

from .control_cell import HOME, MODEL, Cell, swing

ASIDE = HOME + np.array([0.8, 0.3, -0.4, 0.3, 0.2, -0.3, 0.5])


def record(cell: Cell, periods: int) -> tuple[Array, Array]:
    """Positions and velocities (periods, n) of the next control periods."""
    positions: list[Array] = []
    velocities: list[Array] = []
    for _ in range(periods):
        cell.loop.step()
        state = cell.hardware.arm.read()
        positions.append(state.position.copy())
        velocities.append(state.velocity.copy())
    return np.array(positions), np.array(velocities)


@pytest.mark.parametrize("late", [0, 1, 25])
def test_preemption_new_branch_acquires_before_the_old_one_is_halted(late: int) -> None:
    cell = Cell()
    old = cell.move.along(swing(HOME, ASIDE, 2.0), node="old")
    cell.ticks(old, 12)
    assert not cell.loop.at_rest
    new = cell.move.guarded((0.0, 0.0, 1.0), 0.05, force=20.0, speed=0.05, node="new")
    next(new)
    for _ in range(late):
        cell.loop.step_tick(0.05)
        next(new)
    old.close()
    cell.loop.step_tick(0.05)
    result = cell.run(new)
    assert not result.contact
    assert result.travelled == pytest.approx(0.05, abs=5e-4)


def test_stale_release_does_nothing() -> None:
    cell = Cell()
    first = cell.loop.acquire("first")
    second = cell.loop.acquire("second")
    track = TrajectoryController(swing(HOME, ASIDE, 2.0), cell.model, cell.loop.period)
    second.run(track)
    first.release()
    cell.loop.step_tick(0.05)
    assert second.valid and not first.valid
    assert track.progress == pytest.approx(0.05)
    for _ in range(45):
        assert second.valid
        cell.loop.step_tick(0.05)
    assert track.completed


def test_stale_lease_cannot_command() -> None:
    cell = Cell()
    first = cell.loop.acquire("first")
    cell.loop.acquire("second")
    with pytest.raises(PicktreeError, match=r"^first commands the arm, but another has taken it over$"):
        first.run(HoldController())


def test_motion_that_goes_on_without_its_lease_is_a_fault_of_the_program() -> None:
    cell = Cell()
    old = cell.move.along(swing(HOME, ASIDE, 2.0), node="old")
    cell.ticks(old, 5)
    cell.loop.acquire("new")
    with pytest.raises(PicktreeError, match=r"^old continues, but another motion has taken the arm over$"):
        next(old)


def test_braking_on_the_path_within_acceleration_limits() -> None:
    trajectory = swing(HOME, ASIDE, 1.2)
    for ticks in (2, 6, 12, 18, 23):
        cell = Cell()
        lease = cell.loop.acquire("skill")
        lease.run(TrajectoryController(trajectory, cell.model, cell.loop.period))
        _, before = record(cell, 12 * ticks)
        lease.release()
        positions, velocities = record(cell, 240)
        acceleration = np.diff(np.vstack([before[-1:], velocities]), axis=0) / cell.loop.period
        assert np.all(np.abs(acceleration) <= 1.1 * MODEL.acceleration_limit)
        assert not velocities[-1].any()
        assert cell.loop.at_rest
        off_path = [path_distance(p, trajectory.position) for p in positions]
        assert max(off_path) < 2e-4


def path_distance(point: Array, path: Array) -> float:
    """Distance to a densely sampled polygon line."""
    start, way = path[:-1], np.diff(path, axis=0)
    share = np.clip(((point - start) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-12), 0, 1)
    return float(np.linalg.norm(start + share[:, None] * way - point, axis=1).min())


def test_brake_slows_each_joint_at_its_limit() -> None:
    cell = Cell()
    lease = cell.loop.acquire("skill")
    lease.run(TrajectoryController(swing(HOME, ASIDE, 1.2), cell.model, cell.loop.period))
    _, before = record(cell, 120)
    lease.run(BrakeController(cell.model, cell.loop.period))
    _, velocities = record(cell, 120)
    acceleration = np.diff(np.vstack([before[-1:], velocities]), axis=0) / cell.loop.period
    assert np.all(np.abs(acceleration) <= 1.001 * MODEL.acceleration_limit)
    assert not velocities[-1].any()


def test_torque_to_position_and_back_without_a_step() -> None:
    cell = Cell()
    lease: Lease = cell.loop.acquire("skill")
    lease.run(CartesianImpedance(cell.model, cell.loop.period, CompliantMotion()))
    positions, velocities = record(cell, 480)
    assert np.abs(positions - HOME).max() < 1e-6
    assert np.abs(velocities).max() < 1e-5
    lease.release()
    positions, _ = record(cell, 24)
    assert np.abs(positions - HOME).max() < 1e-6
    assert cell.loop.at_rest


def test_track_fades_out_a_small_offset_to_its_start() -> None:
    cell = Cell()
    shifted = HOME + 0.004
    doing = cell.move.along(swing(shifted, ASIDE, 2.0))
    next(doing)
    positions, _ = record(cell, 12)
    assert np.abs(np.diff(np.vstack([HOME[None], positions]), axis=0)).max() < 5e-4
    cell.run(doing)
    np.testing.assert_allclose(cell.loop.state.position, ASIDE, atol=1e-6)


def test_trajectory_from_elsewhere_is_refused() -> None:
    cell = Cell()
    with pytest.raises(Failure) as caught:
        cell.run(cell.move.along(swing(ASIDE, HOME)))
    assert str(caught.value) == "control.tracking: the trajectory starts 0.800 rad from where the arm is"


def test_way_back_retraces_what_was_done() -> None:
    cell = Cell()
    assert cell.move.way_back() is None
    doing = cell.move.along(swing(HOME, ASIDE, 2.0))
    cell.ticks(doing, 20)
    doing.close()
    cell.rest()
    back = cell.move.way_back()
    assert back is not None
    assert not back.velocity[0].any() and not back.velocity[-1].any()
    cell.run(cell.move.along(back))
    np.testing.assert_allclose(cell.loop.state.position, HOME, atol=1e-6)


def test_a_tick_must_be_whole_control_periods() -> None:
    with pytest.raises(PicktreeError, match="no whole number of control periods"):
        Cell().loop.step_tick(0.0501)


def test_each_controller_has_the_name_that_logs_contain() -> None:
    words = ["Hold", "Brake", "Track", "SoftTrack", "GivingWay", "CartesianImpedance", "Comply", "Jog"]
    controllers = (
        HoldController,
        BrakeController,
        TrajectoryController,
        JointImpedanceController,
        GravityCompensationController,
        CartesianImpedance,
        ContactReflex,
        JogController,
    )
    assert [vars(controller)["name"] for controller in controllers] == words  # no word is an inherited one
