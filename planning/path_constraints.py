"""What must hold on the whole way, as numbers: by how much it is broken, and the nearest place where not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..robots.model import RobotModel
from ..world.values import Array, Pose
from .requests import BoxConstraint, Constraint, UprightConstraint

LEAST_TILT = 0.002
"""A smaller tilt than this is taken as this: joints move on straight segments, poses turn on arcs, rad."""
LEAST_BOX = 0.0005
"""The same for half the extent of a box, m."""
RESERVE = 0.1
"""Share of its room that a projection keeps from a constraint's border, so that edges beside it keep it."""
STEPS = 20
"""Newton steps of a projection at most."""
FARTHEST = 0.3
"""Greatest change of a joint in one of them, rad."""
DAMPING = 1e-6


@dataclass(frozen=True, slots=True)
class ConstraintViolation:
    """A constraint that does not hold: which, and by how much (rad for a tilt, m for a box)."""

    constraint: Constraint
    by: float
    is_at: float
    """The tilt that is, rad; for a box the same as `by`."""


class PathConstraints:
    """The constraints of one request, on one robot. Empty ones hold everywhere."""

    def __init__(self, model: RobotModel, constraints: Sequence[Constraint]) -> None:
        self.constraints = tuple(constraints)
        self._model = model
        self._arm = model.arm
        self._data = model.arm.createData()
        self._frame = model.tcp_frame
        self._rows = [_Tilt(c) if isinstance(c, UprightConstraint) else _Box(c) for c in self.constraints]
        self.projections = 0
        """How many configurations had to be moved; each costs about as much as an IK descent."""

    @property
    def room(self) -> float:
        """The narrowest room that a constraint leaves to either side, rad or m; infinite without any."""
        return min((row.room for row in self._rows), default=np.inf)

    def hold(self, q: Array) -> bool:
        """Whether all hold at q (n,)."""
        if not self._rows:
            return True
        pin.forwardKinematics(self._arm, self._data, q)
        pose = pin.updateFramePlacement(self._arm, self._data, self._frame)
        return all(float(row.excess(pose, 0.0).max()) <= 0.0 for row in self._rows)

    def broken(self, q: Array) -> tuple[ConstraintViolation, ...]:
        """Those that do not hold at q (n,)."""
        return self.broken_by(self._model.tcp(q))

    def broken_by(self, tcp_in_world: Pose) -> tuple[ConstraintViolation, ...]:
        """Those that do not hold with the TCP at a pose: they say nothing of the arm behind it."""
        pose = pin.SE3(tcp_in_world.rotation(), np.array(tcp_in_world.position))
        told: list[ConstraintViolation] = []
        for row, constraint in zip(self._rows, self.constraints, strict=True):
            excess = float(row.excess(pose, 0.0).max())
            # Inverse kinematics ends a little beside its pose.
            if excess > 1e-4:
                told.append(
                    ConstraintViolation(
                        constraint, excess, excess + row.room * isinstance(constraint, UprightConstraint)
                    )
                )
        return tuple(told)

    def project(self, q: Array, lower: Array, upper: Array, reserve: float = RESERVE) -> Array | None:
        """A configuration near q (n,) where all hold with some reserve (a share of their room), or None.

        Within the limits of the joints `lower` and `upper` (n,), rad, also where q lies beyond them.
        Newton's method on the constraints that are broken, by the damped pseudoinverse, as in Berenson,
        Srinivasa, Ferguson and Kuffner, "Manipulation planning on constraint manifolds", ICRA 2009.
        """
        q = np.minimum(np.maximum(q, lower), upper)
        if not self._rows:
            return q
        for step in range(STEPS):
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
            square.ravel()[:: len(square) + 1] += DAMPING
            change: Array = -rows.T @ np.asarray(np.linalg.solve(square, excess[broken]), np.float64)
            longest = float(np.abs(change).max())
            if longest > FARTHEST:
                change = change * (FARTHEST / longest)
            moved = np.minimum(np.maximum(q + change, lower), upper)
            if float(np.abs(moved - q).max()) < 1e-9:
                return None
            q = moved
        return None


class _Tilt:
    """The angle between an axis of the tool and the vertical."""

    def __init__(self, upright: UprightConstraint) -> None:
        axis = np.array(upright.axis, dtype=np.float64)
        self._axis: Array = axis / np.linalg.norm(axis)
        self.room = max(upright.tilt, LEAST_TILT)

    def excess(self, pose: pin.SE3, reserve: float) -> Array:
        x, y, z = pose.rotation @ self._axis
        return np.array([np.arctan2(np.hypot(x, y), z) - self.room * (1 - reserve)])

    def gradient(self, pose: pin.SE3) -> Array:
        """(1, 6), by the TCP's twist in the world's axes: turning about `axis × up` lessens the angle."""
        x, y, _ = pose.rotation @ self._axis
        across = max(float(np.hypot(x, y)), 1e-12)
        return np.array([[0.0, 0.0, 0.0, -y / across, x / across, 0.0]])


class _Box:
    """The TCP's distance from a box, along each axis and to either side."""

    def __init__(self, within: BoxConstraint) -> None:
        low, high = np.array(within.box.min, dtype=np.float64), np.array(within.box.max, dtype=np.float64)
        self._middle: Array = (low + high) / 2
        self._half: Array = np.maximum((high - low) / 2, LEAST_BOX)
        self.room = float(self._half.min())

    def excess(self, pose: pin.SE3, reserve: float) -> Array:
        off = np.abs(pose.translation - self._middle)
        # Of a large box no tenth is given away.
        return off - self._half + np.minimum(reserve * self._half, 0.005 * (reserve > 0))

    def gradient(self, pose: pin.SE3) -> Array:
        """(3, 6), by the twist of the TCP in the world's axes."""
        signs = np.where(pose.translation >= self._middle, 1.0, -1.0)
        return np.hstack([np.diag(signs), np.zeros((3, 3))])
