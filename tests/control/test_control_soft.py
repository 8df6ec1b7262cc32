"""Soft motions: external torques are seen without accelerations, and a touch is given way to."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pinocchio as pin
import pytest

from picktree.robot.control import ContactThresholds
from picktree.robot.control.external_torque import ExternalTorqueObserver
from picktree.robot.control.impedance import (
    MAX_IMPULSE,
    GravityCompensationController,
    JointImpedanceController,
    slowed_trajectory,
)
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Array, Failure, JointState
from picktree.world.robot_model import RobotModel, load_robot

from ..planning.motion_cell import down
from ..robots.arms import ROBOT, mini
from .control_cell import HOME, MODEL, Cell, reach, swing

PERIOD = 1 / 240


def no_wrench(window: float, q: Array) -> Array:
    """The wrist feels nothing."""
    return np.zeros(6)


NO_WRENCH = cast("Any", SimpleNamespace(force=(0.0, 0.0, 0.0), over=no_wrench))


def test_the_observer_finds_what_pushes_while_the_arm_moves() -> None:
    pushes = np.array([3.0, -2.0, 1.0, 2.0, 0.5, -0.5, 0.2])
    q, v = HOME.copy(), np.array([0.2, -0.1, 0.1, 0.2, 0.3, -0.2, 0.1])
    observer = ExternalTorqueObserver(MODEL, PERIOD)
    driven = np.zeros(MODEL.n)
    for step in range(120):
        observer.watch(JointState(q, v, driven), driven)
        if step == 40:
            assert np.abs(observer.torque).max() < 0.1
        driven = MODEL.bias(q, v) + 2.0 * np.sin(0.05 * step + np.arange(MODEL.n)) * 0.1
        outside = pushes if step > 40 else np.zeros(MODEL.n)
        v = v + MODEL.forward_dynamics(q, v, driven + outside) * PERIOD
        q = q + v * PERIOD
    assert np.abs(observer.torque - pushes).max() < 0.15


def test_a_soft_motion_in_the_open_arrives() -> None:
    cell = Cell()
    goal = reach(down(0.45, 0.1, 0.3), cell.loop.held_position)
    result = cell.run(
        cell.move.softly(swing(cell.loop.held_position, goal, 2.0), ContactThresholds(torque=1.0, force=3.0))
    )
    assert (result.completed, result.touched) == (True, False)
    assert np.abs(cell.loop.state.position - goal).max() < 2e-3
    assert cell.loop.at_rest


TURN = np.array([0.5, 0.2, 0.0, 0.3, 0.0, 0.2, 0.0])


def test_a_slower_trajectory_goes_the_same_way_and_nothing_is_faster_than_it_may() -> None:
    fast = swing(HOME, HOME + TURN, 1.0)
    slow = slowed_trajectory(MODEL, fast, 0.05)
    assert np.array_equal(slow.position, fast.position)
    speeds = [
        np.linalg.norm((MODEL.jacobian(q) @ v)[:3]) for q, v in zip(slow.position, slow.velocity, strict=True)
    ]
    assert 0.049 < max(speeds) <= 0.05 + 1e-9
    assert slowed_trajectory(MODEL, slow, 0.25) is slow


def test_a_slower_trajectory_is_as_fast_as_before_where_that_is_slow_enough() -> None:
    fast = swing(HOME, HOME + TURN, 2.0)
    slow = slowed_trajectory(MODEL, fast, 0.05)
    assert np.array_equal(slow.times[:15], fast.times[:15])
    # On nearly all of its path something moves as fast as it may.
    fastest = [_fastest(q, v) for q, v in zip(slow.position, slow.velocity, strict=True)]
    at_most = np.array(fastest) > 0.045
    assert float(np.diff(slow.times)[at_most[1:] & at_most[:-1]].sum()) > 0.8 * slow.duration


def test_a_slower_trajectory_moves_between_its_samples_as_its_samples_say() -> None:
    slow = slowed_trajectory(MODEL, swing(HOME, HOME + TURN, 1.0), 0.25)
    h = 1e-4
    for t in np.linspace(h, slow.duration - h, 400):
        (q0, v0), (q1, v1) = slow.sample(t - h), slow.sample(t + h)
        assert np.abs((q1 - q0) / (2 * h) - slow.sample(t)[1]).max() < 1e-4
        assert (np.abs(v1 - v0) / (2 * h) <= MODEL.acceleration_limit).all()
    for t, a in zip(slow.times[1:-1], slow.acceleration[1:-1], strict=True):
        assert np.abs((slow.sample(t + h)[1] - slow.sample(t - h)[1]) / (2 * h) - a).max() < 1e-2


def test_no_part_of_a_slower_trajectory_hits_a_rigid_obstacle_with_more_than_its_impulse() -> None:
    stretched = reach(down(0.6, 0.0, 0.5), HOME)
    fast = swing(stretched, stretched + np.array([1.2, 0.3, 0.0, 0.2, 0.0, 0.0, 0.0]), 1.0)
    slow = slowed_trajectory(MODEL, fast, 0.25)
    impulses = [
        _impulse(q, v, joint)
        for q, v in zip(slow.position[1:-1], slow.velocity[1:-1], strict=True)
        for joint in range(3, MODEL.n + 1)
    ]
    assert 0.9 * MAX_IMPULSE < max(impulses) <= MAX_IMPULSE * 1.001


@pytest.mark.parametrize("offset", [0.0, 0.0001, 0.006])
def test_a_shoulder_beside_the_first_axis_does_not_slow_an_arm_down(offset: float, tmp_path: Path) -> None:
    # An obstacle meets the housing around the shoulder, not its centre.
    edit = ('<origin xyz="0 0 0.18"/>', f'<origin xyz="0 {offset} 0.18"/>')
    (tmp_path / "mini.urdf").write_text(mini(edit), encoding="utf-8")
    (tmp_path / "mini.yaml").write_text(ROBOT, encoding="utf-8")
    model = RobotModel(load_robot(str(tmp_path / "mini.yaml")))
    home = model.named("home")
    slow = slowed_trajectory(model, swing(home, home + np.eye(6)[0], 1.0), 0.25)
    assert 3.0 < slow.duration < 30.0


def _linear(q: Array, joint: int) -> Array:
    """Return the Jacobian (3, n) of a joint's origin, by differences."""
    data, h = MODEL.arm.createData(), 1e-6
    columns: list[Array] = []
    for step in h * np.eye(MODEL.n):
        ends: list[Array] = []
        for at in (q + step, q - step):
            pin.forwardKinematics(MODEL.arm, data, at)
            ends.append(data.oMi[joint].translation.copy())
        columns.append((ends[0] - ends[1]) / (2 * h))
    return np.array(columns).T


def _fastest(q: Array, v: Array) -> float:
    """Return the speed of the fastest of joints and tool, m/s."""
    points = [_linear(q, joint) @ v for joint in range(1, MODEL.n + 1)]
    return max(float(np.linalg.norm(point)) for point in [*points, (MODEL.jacobian(q) @ v)[:3]])


def _impulse(q: Array, v: Array, joint: int) -> float:
    """Return the impulse against the motion of a joint's origin that stops it, Ns."""
    linear = _linear(q, joint)
    motion = linear @ v
    if float(np.linalg.norm(motion)) < 1e-6:
        return 0.0
    along = motion / np.linalg.norm(motion)
    for_one: Array = linear @ np.linalg.solve(MODEL.mass_matrix(q), linear.T @ along)
    return float(along @ motion / (along @ for_one))


def soft_motion(push_from: int, effort: float = 0.0) -> JointImpedanceController:
    """Run the first 0.15 s of a soft motion, with 6 Nm against joint 2 from period `push_from` on.

    `effort`: of that joint at rest, beyond its weight, Nm.
    """
    soft = JointImpedanceController(
        swing(HOME, HOME + 0.1, 2.0),
        MODEL,
        PERIOD,
        wrist=NO_WRENCH,
        carried=np.zeros(3),
        torque=1.2,
        force=3.0,
    )
    q, v, joint = HOME.copy(), np.zeros(MODEL.n), np.eye(MODEL.n)[1]
    torque = MODEL.gravity(q)
    soft.start(0.0, JointState(q, v, torque + effort * joint), cast("Any", SimpleNamespace(position=q)))
    for period in range(36):
        torque = soft.update(period * PERIOD, JointState(q, v, torque)).torque
        v = v + MODEL.forward_dynamics(q, v, torque - (period >= push_from) * 6.0 * joint) * PERIOD
        q = q + v * PERIOD
    return soft


def test_a_contact_at_the_beginning_of_a_soft_motion_is_one() -> None:
    assert soft_motion(push_from=8).touched
    assert not soft_motion(push_from=99).touched


def test_pressure_that_is_released_at_the_beginning_of_a_soft_motion_is_no_contact() -> None:
    assert not soft_motion(push_from=99, effort=15.0).touched


def test_the_reflex_leaves_what_the_arm_has_hit_before_the_stiff_servo_takes_over() -> None:
    cell = Cell(backend=PhysicsHardware)
    hardware = cell.hardware
    assert isinstance(hardware, PhysicsHardware)
    cell.go(0.45, 0.1, 0.25)
    start = cell.loop.held_position
    into = reach(down(0.45, 0.1, -0.05), start)
    with pytest.raises(Failure, match="N at the wrist"):
        cell.run(cell.move.along(swing(start, into, 1.2), guard=25.0))
    forces: list[float] = []
    for _ in range(300):
        cell.loop.step()
        forces.append(sum(c.force for c in hardware.true_contacts() if "table" in (c.one, c.other)))
    assert cell.loop.controller == "Hold"
    assert np.mean(forces[100:]) < 0.5


def of_box(mass: float, centre: Array, sides: Array) -> pin.Inertia:
    """A box of that mass, kg, with its centre and its sides, m."""
    whole = mass / 12 * np.diag(float(sides @ sides) - sides**2)
    return cast("Any", pin.Inertia)(mass, centre, whole)


def random_arm(seed: int) -> RobotModel:
    """An arm with the iiwa's joints and links of any mass and size: joints in line turn together, against a
    hundredth of the inertia of either alone."""
    rng = np.random.default_rng(seed)
    model = RobotModel(load_robot("iiwa"))
    for k in range(1, model.n + 1):
        mass, size = 10 ** rng.uniform(-1.0, 0.7), 10 ** rng.uniform(-2.0, -0.7)
        sides = size * 10 ** rng.uniform(-0.5, 0.5, 3)
        model.arm.inertias[k] = of_box(mass, rng.uniform(-0.1, 0.1, 3), sides)
    return model


def follow(controller: Any, model: RobotModel, q: Array, steps: int, rng: np.random.Generator) -> list[Array]:
    """Configurations of an arm under a torque controller with noisy encoders, each command a period late."""
    v, path = np.zeros(model.n), [q]
    torque = model.gravity(q)
    controller.start(0.0, JointState(q, v, torque), cast("Any", SimpleNamespace(position=q)))
    for step in range(steps):
        noise = rng.normal(size=(2, model.n)) * [[1e-5], [1e-4]]
        command = controller.update(step * PERIOD, JointState(q + noise[0], v + noise[1], torque))
        v = v + model.forward_dynamics(q, v, torque) * PERIOD
        q = q + v * PERIOD
        torque = command.torque
        path.append(q)
        assert np.abs(v).max() < 2.0, f"unstable after {step} periods"
    return path


@pytest.mark.parametrize("seed", range(4))
def test_soft_motions_are_stable_on_any_arm(seed: int) -> None:
    rng, model = np.random.default_rng(100 + seed), random_arm(seed)
    start = rng.uniform(model.lower, model.upper) * 0.8
    goal = np.clip(start + rng.uniform(-0.6, 0.6, model.n), model.lower, model.upper)
    soft = JointImpedanceController(
        swing(start, goal, 2.0),
        model,
        PERIOD,
        wrist=NO_WRENCH,
        carried=np.zeros(3),
        torque=math.inf,
        force=math.inf,
    )
    offset = start + rng.uniform(-0.01, 0.01, model.n)
    assert np.abs(follow(soft, model, offset, 720, rng)[-1] - goal).max() < 0.02
    drift = GravityCompensationController(model, PERIOD, np.zeros(3))
    assert np.abs(follow(drift, model, start, 240, rng)[-1] - start).max() < 0.05
