"""Trajectory check: a timed trajectory is checked again before it counts as a plan, and when the belief has
changed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np
import pinocchio as pin

from ...robots.model import RobotModel
from ...world.trajectory import Trajectory
from ...world.values import Array
from .edges import bisection_order

MAX_TCP_STEP = 0.005
"""Greatest travel of the TCP between two checked configurations, m."""
MAX_JOINT_STEP = 0.03
"""Greatest distance in joint space between them, rad (Euclidean): the elbow may move while the TCP does
not."""
LIMIT_ROUNDING = 1e-6
"""Greatest excess over the joints' limits on a trajectory, rad."""


class ConfigurationCheck(Protocol):
    """Collision check of configurations: a `StartTolerance`, or a `CollisionChecker`, which excuses nothing
    at the start."""

    @property
    def model(self) -> RobotModel: ...

    def free(self, q: Array) -> bool: ...

    def nearly_free(self, q: Array) -> bool: ...


def is_trajectory_free(kept: ConfigurationCheck, trajectory: Trajectory) -> bool:
    """Whether a timed trajectory keeps the joints' limits and, at every step, at least half of the margins.

    Corners were cut, and its steps are elsewhere than those of the path that it was made from.
    """
    return first_collision(kept, trajectory) is None


def first_collision(kept: ConfigurationCheck, trajectory: Trajectory) -> Array | None:
    """Return a configuration (n,) of the trajectory that is not free or beyond a limit; None: there is
    none."""
    model, q = kept.model, trajectory.position
    # The start or end may be given beyond a limit. It may be left or reached, but not exceeded.
    lower = np.minimum(model.lower, np.minimum(q[0], q[-1])) - LIMIT_ROUNDING
    upper = np.maximum(model.upper, np.maximum(q[0], q[-1])) + LIMIT_ROUNDING
    outside = np.flatnonzero(((q < lower) | (q > upper)).any(axis=1))
    if outside.size:
        return q[int(outside[0])].copy()
    checked = sampled_configurations(model, trajectory)
    # The half-margin check runs only for the few configurations that fail the full margins.
    return next((at for at in _bisected(checked) if not kept.free(at) and not kept.nearly_free(at)), None)


def sampled_configurations(model: RobotModel, trajectory: Trajectory) -> Array:
    """Sample configurations (m, n) along a trajectory, start and end included, at most STEP and TURN
    apart."""
    q = trajectory.position
    tool = _tool_positions(model, q)
    moved: Array = np.linalg.norm(np.diff(tool, axis=0), axis=1) / MAX_TCP_STEP
    turned: Array = np.linalg.norm(np.diff(q, axis=0), axis=1) / MAX_JOINT_STEP
    along: Array = np.concatenate([[0.0], np.cumsum(np.maximum(moved, turned))])
    count = max(1, int(np.ceil(along[-1])))
    marks: Array = np.linspace(0.0, float(along[-1]), count + 1)
    joints: list[Array] = [np.interp(marks, along, joint) for joint in q.T]
    return np.stack(joints, axis=1)


def _tool_positions(model: RobotModel, q: Array) -> Array:
    """Return the TCP's positions in the world (m, 3), m, at configurations (m, n)."""
    arm, data, frame = model.arm, model.arm.createData(), model.tcp_frame
    points = np.empty((len(q), 3))
    for k, at in enumerate(q):
        pin.forwardKinematics(arm, data, at)
        points[k] = pin.updateFramePlacement(arm, data, frame).translation
    return points


def _bisected(checked: Array) -> Iterator[Array]:
    """Yield the start, the end, then halves, quarters, …: collisions come in stretches."""
    yield checked[0]
    count = len(checked) - 1
    for k in bisection_order(count):
        yield checked[k]
