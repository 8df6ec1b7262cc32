"""The robot model against definitions, and against pybullet's own dynamics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pybullet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from picktree.files import PicktreeError
from picktree.world import Array, Pose
from picktree.world.robot_model import RobotModel, load_robot

PANDA = load_robot("panda")
MODEL = RobotModel(PANDA)
BASE = Pose.from_rpy((0.1, 0.2, 0.3), (0.0, 0.0, 0.5))

configurations = st.integers(0, 2**32 - 1).map(
    lambda seed: np.random.default_rng(seed).uniform(MODEL.lower, MODEL.upper)
)


@settings(max_examples=25)
@given(configurations)
def test_jacobian_is_the_derivative_of_the_tcp(q: Array) -> None:
    step = 1e-6
    jacobian = MODEL.jacobian(q)
    for joint in range(MODEL.n):
        dq = np.zeros(MODEL.n)
        dq[joint] = step
        before, after = MODEL.tcp(q - dq), MODEL.tcp(q + dq)
        linear = (np.array(after.position) - np.array(before.position)) / (2 * step)
        turned = after.rotation() @ before.rotation().T
        angular = np.array([turned[2, 1], turned[0, 2], turned[1, 0]]) / (2 * step)
        np.testing.assert_allclose(jacobian[:, joint], [*linear, *angular], atol=1e-6)


@pytest.mark.parametrize("name", ["panda", "xarm6", "iiwa"])
def test_positions_along_a_path_are_those_of_the_tcp(name: str) -> None:
    model = RobotModel(replace(load_robot(name), base_in_world=BASE))
    path = np.random.default_rng(0).uniform(model.lower, model.upper, (50, model.n))
    positions = [model.tcp(q).position for q in path]
    np.testing.assert_allclose(model.tcp_positions(path), positions, rtol=0, atol=1e-12)


@settings(max_examples=25)
@given(configurations)
def test_gravity_is_the_slope_of_the_energy(q: Array) -> None:
    """Torque at rest is dU/dq, and a mass m at the TCP adds J^T m g: both ways must agree."""
    weight = np.array([0.0, 0.0, -9.81, 0.0, 0.0, 0.0])
    held = MODEL.gravity(q) - MODEL.jacobian(q).T @ weight
    acceleration = MODEL.forward_dynamics(q, np.zeros(7), held, weight)
    np.testing.assert_allclose(acceleration, np.zeros(7), atol=1e-9)


@settings(max_examples=25)
@given(configurations, st.integers(0, 2**32 - 1))
def test_forward_dynamics_inverts_the_equation_of_motion(q: Array, seed: int) -> None:
    rng = np.random.default_rng(seed)
    v, tau = rng.normal(size=7), rng.normal(size=7) * 10
    acceleration = MODEL.forward_dynamics(q, v, tau)
    np.testing.assert_allclose(MODEL.mass_matrix(q) @ acceleration + MODEL.bias(q, v), tau, atol=1e-9)
    np.testing.assert_allclose(MODEL.inverse_dynamics(q, v, acceleration), tau, atol=1e-9)


def test_agrees_with_pybullet() -> None:
    client = pybullet.connect(pybullet.DIRECT)
    try:
        pybullet.setGravity(0, 0, -9.81, physicsClientId=client)
        body = pybullet.loadURDF(
            PANDA.urdf,
            BASE.position,
            BASE.orientation,
            useFixedBase=True,
            flags=pybullet.URDF_USE_INERTIA_FROM_FILE,
            physicsClientId=client,
        )
        model = RobotModel(replace(PANDA, base_in_world=BASE))
        count = pybullet.getNumJoints(body, physicsClientId=client)
        infos = [pybullet.getJointInfo(body, i, physicsClientId=client) for i in range(count)]
        index = {info[12].decode(): i for i, info in enumerate(infos)}
        rng = np.random.default_rng(1)
        for _ in range(10):
            q, v = rng.uniform(model.lower, model.upper), rng.normal(size=7)
            width = float(rng.uniform(0, 0.08))
            joints = [*q, 0.0, 0.0]
            mass = np.array(pybullet.calculateMassMatrix(body, joints, physicsClientId=client))
            bias = pybullet.calculateInverseDynamics(
                body, joints, [*v, 0.0, 0.0], [0.0] * 9, physicsClientId=client
            )
            np.testing.assert_allclose(model.mass_matrix(q), mass[:7, :7], atol=1e-12)
            np.testing.assert_allclose(model.bias(q, v), bias[:7], atol=1e-11)
            for joint, value in enumerate(q):
                pybullet.resetJointState(body, joint, value, physicsClientId=client)
            for name in PANDA.gripper.fingers:
                pybullet.resetJointState(body, index[name], width / 2, physicsClientId=client)
            for name, pose in model.link_poses(q, width).items():
                if name not in index:
                    continue
                state = pybullet.getLinkState(
                    body, index[name], computeForwardKinematics=True, physicsClientId=client
                )
                assert pose.distance(Pose(state[4])) < 1e-6, name
                np.testing.assert_allclose(pose.rotation(), Pose(state[4], state[5]).rotation(), atol=1e-6)
    finally:
        pybullet.disconnect(client)


def test_hand_mass_and_centre() -> None:
    """Hand 0.81 kg at 40 mm, two fingers of 0.1 kg at 58.4 + 20 mm."""
    assert MODEL.hand_mass == pytest.approx(1.01)
    assert MODEL.hand_com == pytest.approx((0.0, 0.0, (0.81 * 0.04 + 0.2 * 0.0784) / 1.01))


def test_moving_the_base_moves_everything() -> None:
    moved = RobotModel(replace(PANDA, base_in_world=BASE))
    q = MODEL.named("home")
    for name, pose in MODEL.link_poses(q, 0.03).items():
        assert moved.link_poses(q, 0.03)[name].distance(BASE @ pose) < 1e-12
    assert moved.tcp(q).distance(BASE @ MODEL.tcp(q)) < 1e-12
    assert moved.flange(q).distance(moved.link_poses(q, 0.0)["panda_hand"]) < 1e-12


def test_the_opening_lies_between_the_finger_boxes() -> None:
    (box, left), (_, right) = MODEL.finger_boxes(0.05)
    assert left.position[1] - box.size[1] / 2 == pytest.approx(0.025)
    assert right.position[1] + box.size[1] / 2 == pytest.approx(-0.025)
    assert right.position[0] == pytest.approx(left.position[0])


def test_answers_are_copies() -> None:
    q = MODEL.named("home")
    jacobian, gravity, poses = MODEL.jacobian(q), MODEL.gravity(q), MODEL.link_poses(q, 0.0)
    kept = jacobian.copy(), gravity.copy(), dict(poses)
    MODEL.jacobian(q + 0.3)
    MODEL.gravity(q + 0.3)
    MODEL.link_poses(q + 0.3, 0.04)
    np.testing.assert_array_equal(jacobian, kept[0])
    np.testing.assert_array_equal(gravity, kept[1])
    assert poses == kept[2]


def test_a_wrong_name_is_refused_with_the_known_ones() -> None:
    with pytest.raises(PicktreeError) as error:
        MODEL.named("hame")
    known = ", ".join(PANDA.named)
    assert str(error.value) == f"no pose 'hame' in the robot file; known: {known}"
    with pytest.raises(PicktreeError, match=r"the URDF has no panda_joint9$"):
        RobotModel(replace(PANDA, joints=(*PANDA.joints[:-1], "panda_joint9")))
    with pytest.raises(PicktreeError, match="the joints must be given in the order panda_joint1, panda_j"):
        RobotModel(replace(PANDA, joints=PANDA.joints[::-1], limits=PANDA.limits[::-1]))
