"""Poses against the definition of a rigid transform, and their near-degenerate rotations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from picktree.world import Pose
from picktree.world.values import quaternion_from_rotation

number = st.floats(-2.0, 2.0)
angle = st.one_of(
    st.floats(-math.pi, math.pi), st.sampled_from([0.0, math.pi, -math.pi, 1e-9, math.pi - 1e-9])
)
poses = st.builds(
    lambda p, r: Pose.from_rpy(p, r), st.tuples(number, number, number), st.tuples(angle, angle, angle)
)


@given(poses, poses)
def test_composition_is_the_product_of_matrices(a: Pose, b: Pose) -> None:
    assert np.allclose((a @ b).matrix(), a.matrix() @ b.matrix(), atol=1e-9)


@given(poses)
def test_inverse_undoes(a: Pose) -> None:
    assert np.allclose((a @ a.inverse()).matrix(), np.eye(4), atol=1e-9)


@given(poses)
def test_matrix_round_trip_keeps_the_rotation(a: Pose) -> None:
    assert Pose.from_rotation(a.position, a.rotation()).angle(a) == pytest.approx(0.0, abs=1e-6)


@given(st.tuples(angle, angle, angle))
def test_rpy_and_quaternion_agree_with_scipy(rpy: tuple[float, float, float]) -> None:
    expected = Rotation.from_euler("xyz", rpy)
    ours = Pose.from_rpy((0.0, 0.0, 0.0), rpy)
    assert np.allclose(ours.rotation(), expected.as_matrix(), atol=1e-9)
    turned = quaternion_from_rotation(expected.as_matrix())
    assert abs(float(np.dot(turned, expected.as_quat()))) == pytest.approx(1.0, abs=1e-9)


def test_points_and_shift() -> None:
    pose = Pose.from_rpy((1.0, 2.0, 3.0), (0.0, 0.0, math.pi / 2))
    assert np.allclose(pose.apply(np.array([[1.0, 0.0, 0.0]])), [[1.0, 3.0, 3.0]])
    assert pose.shifted((0.0, 0.0, 1.0)).position == (1.0, 2.0, 4.0)
    assert pose.distance(Pose()) == pytest.approx(math.sqrt(14))


@given(st.tuples(angle, st.floats(-math.pi / 2, math.pi / 2), angle))
def test_rpy_is_the_inverse_of_from_rpy(rpy: tuple[float, float, float]) -> None:
    pose = Pose.from_rpy((1.0, 2.0, 3.0), rpy)
    assert np.allclose(Pose.from_rpy(pose.position, pose.rpy()).matrix(), pose.matrix(), atol=1e-6)
