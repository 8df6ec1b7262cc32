"""What keeps limits where nothing was planned: contact, guarded moves, and braking off a path."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from picktree.robot.control import SafetyMonitor, distance_to_workspace_edge
from picktree.robot.control.commands import JointCommand
from picktree.robot.control.impedance import ContactReflex
from picktree.robot.control.joint_controllers import BrakeController, TrajectoryController
from picktree.robot.control.soft_limits import SoftJointLimits
from picktree.robot.planning import Scaling, time_corners
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Array, Bounds, Failure, JointState
from picktree.world.scene import SafetyLimits

from .control_cell import HOME, MODEL, Cell, swing

PERIOD = 1 / 240
DAMPING = 3.0
"""Of a motion that is pushed, over its inertia, 1/s."""


def beyond(q: Array) -> float:
    """How far the worst joint is beyond its soft limit; negative: within, rad."""
    return float(np.maximum(q - MODEL.upper, MODEL.lower - q).max())


@pytest.mark.parametrize("joint", [0, 3, 5])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_torque_towards_a_limit_does_not_reach_it(joint: int, side: float) -> None:
    bounds = SoftJointLimits(MODEL)
    q, v = HOME.copy(), np.zeros(7)
    limit = MODEL.upper[joint] if side > 0 else MODEL.lower[joint]
    q[joint] = limit - side * 0.4
    push = np.zeros(7)
    push[joint] = side * 0.3 * MODEL.torque_limit[joint]
    nearest = 9.0
    for _ in range(300):
        torque = bounds.held(q, v, MODEL.bias(q, v) + push - DAMPING * MODEL.mass_matrix(q) @ v)
        v = v + MODEL.forward_dynamics(q, v, torque) * PERIOD
        q = q + v * PERIOD
        nearest = min(nearest, float(side * (limit - q[joint])))
        assert (np.abs(torque) <= MODEL.torque_limit).all()
    assert -0.001 < nearest < 0.02


def test_torques_far_from_limits_are_not_touched() -> None:
    torque = MODEL.gravity(HOME) + 5.0
    assert SoftJointLimits(MODEL).held(HOME, np.full(7, 0.5), torque) is torque


def test_giving_way_at_full_speed_next_to_a_limit_stays_within_it() -> None:
    """Joint 4 comes down to its upper limit and something is felt on the way: it gave way 0.06 rad beyond."""
    cell = Cell(backend=PhysicsHardware)
    goal = HOME.copy()
    goal[3] = MODEL.planned_upper[3]
    goal[1] = -1.2
    cell.ticks(cell.move.along(swing(HOME, goal, 1.9)), 27)
    loop = cell.loop
    assert loop.state.velocity[3] > 0.8
    lease = loop.acquire("test")
    lease.run(ContactReflex(cell.model, loop.period, np.zeros(6)))
    worst = -9.0
    for _ in range(240):
        loop.step()
        worst = max(worst, beyond(cell.hardware.arm.read().position))
    assert worst < 0.0


def test_braking_off_the_path_needs_no_more_torque_than_there_is() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        q = np.clip(HOME + rng.uniform(-0.8, 0.8, 7), MODEL.lower, MODEL.upper)
        v = rng.uniform(-1.0, 1.0, 7) * MODEL.velocity_limit
        brake = BrakeController(MODEL, PERIOD)
        brake.start(0.0, JointState(q, v, np.zeros(7)), JointCommand(q, v))
        periods, at, before = 0, q, v
        while not brake.done:
            command = brake.update(0.0, JointState(at, before, np.zeros(7)))
            change = (command.velocity - before) / PERIOD
            torque = MODEL.inverse_dynamics(at, before, change)
            assert (
                np.abs(torque) <= np.maximum(0.9 * MODEL.torque_limit, np.abs(MODEL.bias(at, before)))
            ).all()
            assert (np.abs(command.velocity) <= np.abs(before) + 1e-12).all()
            assert (np.abs(change) <= MODEL.acceleration_limit * (1 + 1e-9)).all()
            at, before = command.position, command.velocity
            periods += 1
        assert periods * PERIOD < 1.5


def test_braking_on_the_path_needs_no_more_torque_than_there_is() -> None:
    """Plans take at most 0.7 of it. A motion that was handed over took 1.4 when nobody went on with it."""
    rng = np.random.default_rng(5)
    reached = 0.0
    for _ in range(8):
        way = [np.clip(HOME + rng.uniform(-1.0, 1.0, 7), MODEL.lower, MODEL.upper) for _ in range(3)]
        trajectory = time_corners(MODEL, np.array(way), Scaling(1.0, 1.0), 0.1)
        assert trajectory is not None
        for start in np.linspace(0.1, 0.9, 9):
            track = TrajectoryController(trajectory, MODEL, PERIOD)
            track.start(0.0, JointState(way[0], np.zeros(7), np.zeros(7)), JointCommand(way[0], np.zeros(7)))
            at = JointCommand(*trajectory.sample(0.0))
            while track.progress < start * trajectory.duration:
                at = track.update(0.0, JointState(at.position, at.velocity, np.zeros(7)))
            track.brake()
            began, periods = track.progress, 0
            while not track.done:
                before, at = at, track.update(0.0, JointState(at.position, at.velocity, np.zeros(7)))
                if not track.done:  # the last step ends between two periods
                    change = (at.velocity - before.velocity) / PERIOD
                    torque = MODEL.inverse_dynamics(before.position, before.velocity, change)
                    reached = max(reached, float((np.abs(torque) / MODEL.torque_limit).max()))
                periods += 1
            assert periods * PERIOD <= 1.05 and track.progress - began < 0.5
    assert 0.8 < reached < 0.95  # of the path at the next period, which bends on


@pytest.mark.parametrize(
    ("height", "direction", "distance"),
    [
        (0.3, (0.0, 0.0, -1.0), 0.298),
        (0.3, (0.6, 0.8, 0.0), 0.398 / 0.6 * 0.9384422),
        (1.2, (0.0, 0.0, 1.0), 0.0),
        (1.2, (0.0, 0.0, -1.0), 1.198),
    ],
)
def test_a_line_is_inside_as_far_as_its_first_side(
    height: float, direction: tuple[float, float, float], distance: float
) -> None:
    box = Bounds((0.0, -0.5, 0.0), (0.8, 0.5, 1.0))
    found = distance_to_workspace_edge(box, (0.4, 0.0, height), np.array(direction))
    assert found == pytest.approx(distance)


def test_a_guarded_move_ends_at_the_edge_of_the_workspace() -> None:
    cell = Cell()
    cell.loop.monitor = SafetyMonitor(
        MODEL, SafetyLimits(60.0, Bounds((0.2, -0.2, 0.0), (0.8, 0.2, 1.0))), cell.journal
    )
    cell.go(0.5, 0.0, 0.3)
    with pytest.raises(Failure) as caught:
        cell.run(cell.move.guarded((0.0, 1.0, 0.0), 0.3, force=5.0, speed=0.3))
    text = "a guarded move of 300 mm comes to the edge of the workspace after 198 mm, without a contact"
    assert str(caught.value) == f"safety.workspace: {text}"
    assert cell.loop.monitor.stopped is None
    with pytest.raises(Failure, match=r"^safety.workspace: a guarded move of 10 mm .* after 0 mm, without"):
        cell.run(cell.move.guarded((0.0, 1.0, 0.0), 0.01, force=5.0, speed=0.3))
    assert cell.run(
        cell.move.guarded((0.0, -1.0, 0.0), 0.1, force=5.0, speed=0.3)
    ).travelled == pytest.approx(0.1, abs=2e-3)


def test_a_guarded_move_ends_where_a_joint_comes_to_its_limit() -> None:
    cell = Cell()
    start = HOME.copy()
    start[5] = MODEL.planned_upper[5] - 0.15
    cell.run(cell.move.along(swing(HOME, start)))
    with pytest.raises(Failure) as caught:
        cell.run(cell.move.guarded((0.0, 0.0, -1.0), 0.3, force=20.0, speed=0.2))
    travelled = round(float(cast("float", caught.value.evidence["travelled"])) * 1000)
    text = f"panda_joint6 comes to its limit after {travelled} mm of a guarded move of 300 mm"
    assert str(caught.value) == f"safety.joint_limit: {text}"
    assert 30 < travelled < 150
    assert cell.loop.monitor.stopped is None
    assert 0.0 < MODEL.upper[5] - cell.loop.state.position[5] < 0.01


def test_lowering_with_the_elbow_turned_ends_at_the_limit_of_the_first_joint() -> None:
    """Joint 1 was driven beyond its limit, a safety stop; here the others cannot do without it."""
    cell = Cell(backend=PhysicsHardware)
    turned = np.array([2.85, -0.557, -1.678, -2.533, -0.875, 2.387, -2.018])
    cell.run(cell.move.along(swing(HOME, turned, 5.0)))
    begin = cell.loop.tcp
    with pytest.raises(
        Failure, match=r"^safety.joint_limit: panda_joint1 comes to its limit after \d\d mm of"
    ):
        cell.run(cell.move.guarded((0.0, 0.0, -1.0), 0.06, force=4.0, speed=0.12))
    assert cell.loop.monitor.stopped is None
    assert cell.hardware.arm.read().position[0] < MODEL.upper[0]
    assert np.linalg.norm(np.subtract(cell.loop.tcp.position, begin.position)[:2]) < 0.008
