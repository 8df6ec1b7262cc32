"""Soft motions: external torques are seen without accelerations, and a touch is given way to."""

from __future__ import annotations

import numpy as np

from picktree.control.commands import ContactThresholds
from picktree.control.execution.motions import slowed_trajectory
from picktree.control.joints.external_torque import ExternalTorqueObserver
from picktree.world.values import JointState

from ..planning.motion_cell import down
from .control_cell import HOME, MODEL, Cell, reach, swing

PERIOD = 1 / 240


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


def test_a_slower_trajectory_goes_the_same_way_and_nothing_is_faster_than_it_may() -> None:
    fast = swing(HOME, HOME + np.array([0.5, 0.2, 0.0, 0.3, 0.0, 0.2, 0.0]), 1.0)
    slow = slowed_trajectory(MODEL, fast, 0.05)
    assert np.array_equal(slow.position, fast.position)
    speeds = [
        np.linalg.norm((MODEL.jacobian(q) @ v)[:3]) for q, v in zip(slow.position, slow.velocity, strict=True)
    ]
    assert 0.02 < max(speeds) <= 0.051
    assert slowed_trajectory(MODEL, slow, 0.25).duration == slow.duration
