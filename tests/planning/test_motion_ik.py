"""Inverse kinematics against forward kinematics."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from picktree.robot.planning import InverseKinematics
from picktree.robot.planning.inverse_kinematics import (
    ANGLE_ACCURACY,
    MAX_FAILED_DESCENTS,
    MIN_SOLUTION_DIFFERENCE,
    POSITION_ACCURACY,
)
from picktree.world import Pose

from .motion_cell import HOME, MODEL, down

seeds = st.integers(0, 2**32 - 1)


@given(seeds, st.integers(0, 6), st.sampled_from([0.0, 1.0, None]))
def test_every_reachable_pose_is_solved(seed: int, joint: int, end: float | None) -> None:
    """Also with one joint at the end of the range that is planned with."""
    share = np.random.default_rng(seed).uniform(size=7)
    share[joint] = share[joint] if end is None else end
    target = MODEL.tcp(MODEL.planned_lower + share * (MODEL.planned_upper - MODEL.planned_lower))
    found = InverseKinematics(MODEL).solutions(target, np.random.default_rng(0), HOME, want=1)
    assert len(found) == 1
    (q,) = found
    assert np.all(q >= MODEL.planned_lower) and np.all(q <= MODEL.planned_upper)
    reached = MODEL.tcp(q)
    assert reached.distance(target) <= 1.01 * POSITION_ACCURACY
    turned = reached.rotation() @ target.rotation().T
    assert np.linalg.norm(turned - np.eye(3)) <= 2 * ANGLE_ACCURACY


def test_solutions_differ_and_the_nearest_comes_first() -> None:
    ik = InverseKinematics(MODEL)
    found = ik.solutions(down(0.5, 0.1, 0.2), np.random.default_rng(3), HOME)
    assert len(found) == 4
    far = [float(np.linalg.norm(q - HOME)) for q in found]
    assert far == sorted(far)
    assert (
        min(float(np.abs(a - b).max()) for i, a in enumerate(found) for b in found[:i])
        > MIN_SOLUTION_DIFFERENCE
    )
    assert ik.solves >= 4


def test_out_of_reach_gives_nothing_and_ends() -> None:
    ik = InverseKinematics(MODEL)
    assert ik.solutions(Pose((0.9, 0.0, 0.0)), np.random.default_rng(0), HOME) == []
    assert ik.solves == MAX_FAILED_DESCENTS


def test_further_away_than_the_arm_is_long_takes_no_descent() -> None:
    ik = InverseKinematics(MODEL)
    assert ik.solutions(Pose((1.5, 0.0, 0.5)), np.random.default_rng(0), HOME) == []
    assert ik.solves == 0
