"""Path constraints as numbers: by how much a configuration violates them, and its projection onto them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from picktree.world import Array, Pose
from picktree.world.robot_model import RobotModel

from .requests import BoxConstraint, Constraint, UprightConstraint

MIN_TILT = 0.002
"""Least tilt that is used instead of a smaller one, rad: joints move on straight segments, poses turn on
arcs."""
MIN_HALF_EXTENT = 0.0005
"""Least half extent of a box that is used instead of a smaller one, m."""
PROJECTION_RESERVE = 0.1
"""Share of its room that a projection keeps from a constraint's border, so that edges nearby keep the
constraint."""
MAX_PROJECTION_STEPS = 20
"""Greatest number of Newton steps of a projection."""
MAX_PROJECTION_CHANGE = 0.3
"""Greatest change of a joint in one Newton step, rad."""
PROJECTION_DAMPING = 1e-6


@dataclass(frozen=True, slots=True)
class ConstraintViolation:
    """Constraint that does not hold, and by how much (rad for a tilt, m for a box)."""

    constraint: Constraint
    by: float
    is_at: float
    """Actual tilt, rad; for a box the same as `by`."""


class PathConstraints:
    """Constraints of one request, on one robot. An empty set holds everywhere."""

    def __init__(self, model: RobotModel, constraints: Sequence[Constraint]) -> None:
        self.constraints = tuple(constraints)
        self._model = model
        self._arm = model.arm
        self._frame = model.tcp_frame
        self._rows = [_Tilt(c) if isinstance(c, UprightConstraint) else _Box(c) for c in self.constraints]
        self.projections = 0
        """Number of configurations that had to be moved; each costs about as much as an IK descent."""

    @cached_property
    def _data(self) -> pin.Data:
        """Scratch memory; an empty set needs none."""
        return self._arm.createData()

    @property
    def room(self) -> float:
        """Narrowest room that a constraint leaves to either side, rad or m; inf without constraints."""
        return min((row.room for row in self._rows), default=np.inf)

    def hold(self, q: Array) -> bool:
        """Whether all constraints hold at q (n,)."""
        if not self._rows:
            return True
        pin.forwardKinematics(self._arm, self._data, q)
        pose = pin.updateFramePlacement(self._arm, self._data, self._frame)
        return all(float(row.excess(pose, 0.0).max()) <= 0.0 for row in self._rows)

    def broken(self, q: Array) -> tuple[ConstraintViolation, ...]:
        """Return the constraints that do not hold at q (n,)."""
        return self.broken_by(self._model.tcp(q)) if self._rows else ()

    def broken_by(self, tcp_in_world: Pose) -> tuple[ConstraintViolation, ...]:
        """Return the constraints that do not hold with the TCP at a pose, whatever the arm's
        configuration."""
        if not self._rows:
            return ()
        pose = pin.SE3(tcp_in_world.rotation(), np.array(tcp_in_world.position))
        violations: list[ConstraintViolation] = []
        for row, constraint in zip(self._rows, self.constraints, strict=True):
            excess = float(row.excess(pose, 0.0).max())
            # Inverse kinematics ends a little away from its pose.
            if excess > 1e-4:
                violations.append(
                    ConstraintViolation(
                        constraint, excess, excess + row.room * isinstance(constraint, UprightConstraint)
                    )
                )
        return tuple(violations)

    def project(
        self, q: Array, lower: Array, upper: Array, reserve: float = PROJECTION_RESERVE
    ) -> Array | None:
        """Move q (n,) to a near configuration where all constraints hold with some reserve (a share of their
        room).

        None when that fails. The result is within the joints' limits `lower` and `upper` (n,), rad, also
        where q is beyond them. Newton's method on the violated constraints, by the damped pseudoinverse, as
        in Berenson, Srinivasa, Ferguson and Kuffner, "Manipulation planning on constraint manifolds", ICRA
        2009.
        """
        q = np.minimum(np.maximum(q, lower), upper)
        if not self._rows:
            return q
        for step in range(MAX_PROJECTION_STEPS):
            pin.computeJointJacobians(self._arm, self._data, q)
            pose = pin.updateFramePlacement(self._arm, self._data, self._frame)
            excess = np.concatenate([row.excess(pose, reserve) for row in self._rows])
            broken = excess > (0.0 if step == 0 else 1e-7)
            if not broken.any():
                return q
            if step == 0:
                self.projections += 1
            jacobian = pin.getFrameJacobian(self._arm, self._data, self._frame, pin.LOCAL_WORLD_ALIGNED)
            rows = np.concatenate([row.gradient(pose) for row in self._rows])[broken] @ jacobian
            square = rows @ rows.T
            square.ravel()[:: len(square) + 1] += PROJECTION_DAMPING
            change: Array = -rows.T @ np.asarray(np.linalg.solve(square, excess[broken]), np.float64)
            longest = float(np.abs(change).max())
            if longest > MAX_PROJECTION_CHANGE:
                change = change * (MAX_PROJECTION_CHANGE / longest)
            moved = np.minimum(np.maximum(q + change, lower), upper)
            if float(np.abs(moved - q).max()) < 1e-9:
                return None
            q = moved
        return None


class _Tilt:
    """Angle between an axis of the tool and the vertical, rad."""

    def __init__(self, upright: UprightConstraint) -> None:
        axis = np.array(upright.axis, dtype=np.float64)
        self._axis: Array = axis / np.linalg.norm(axis)
        self.room = max(upright.tilt, MIN_TILT)

    def excess(self, pose: pin.SE3, reserve: float) -> Array:
        x, y, z = pose.rotation @ self._axis
        return np.array([np.arctan2(np.hypot(x, y), z) - self.room * (1 - reserve)])

    def gradient(self, pose: pin.SE3) -> Array:
        """Gradient (1, 6) over the TCP's twist in the world's axes: turning about `axis × up` lessens the
        angle."""
        x, y, _ = pose.rotation @ self._axis
        across = max(float(np.hypot(x, y)), 1e-12)
        return np.array([[0.0, 0.0, 0.0, -y / across, x / across, 0.0]])


class _Box:
    """Distance of the TCP from a box, m, along each axis and to either side."""

    def __init__(self, within: BoxConstraint) -> None:
        low, high = np.array(within.box.min, dtype=np.float64), np.array(within.box.max, dtype=np.float64)
        self._middle: Array = (low + high) / 2
        self._half: Array = np.maximum((high - low) / 2, MIN_HALF_EXTENT)
        self.room = float(self._half.min())

    def excess(self, pose: pin.SE3, reserve: float) -> Array:
        off = np.abs(pose.translation - self._middle)
        # A large box keeps a fixed reserve instead of a tenth of its extent.
        return off - self._half + np.minimum(reserve * self._half, 0.005 * (reserve > 0))

    def gradient(self, pose: pin.SE3) -> Array:
        """Gradient (3, 6) over the TCP's twist in the world's axes."""
        signs = np.where(pose.translation >= self._middle, 1.0, -1.0)
        return np.hstack([np.diag(signs), np.zeros((3, 3))])
