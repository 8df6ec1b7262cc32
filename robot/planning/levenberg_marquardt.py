"""IK descent: Levenberg-Marquardt with joint limits as an active set; and seeds for it.

Damping after Sugihara, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE
Transactions on Robotics 27 (2011).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ...files.library_parts import library_part
from ...world.robot_model.model import RobotModel
from ...world.values import Array, Pose

if TYPE_CHECKING:
    from scipy.linalg.lapack import dposv
else:
    dposv = library_part("scipy.linalg._flapack", "scipy.linalg.lapack.dposv")

POSITION_ACCURACY = 1e-5
"""Accuracy of the position, m."""
ANGLE_ACCURACY = 1e-4
"""Accuracy of the orientation, rad."""
MAX_DESCENT_STEPS = 60
MAX_STALLED_STEPS = 4
"""Number of steps without an improvement after which a descent is given up."""
IMPROVEMENT_SHARE = 0.7
"""Share of the least squared error so far that counts as an improvement."""
DAMPING_SHARE = 1e-2
"""Damping as a share of the remaining squared error; fewer steps than with a tenth or ten times as much."""
MAX_STEP_LENGTH = 1.5
"""Greatest length of a step in joint space, rad."""
MAX_POSITION_PULL = 0.1
"""Greatest travel that a step aims at where the target need not be reached, m.

After Buss and Kim, "Selectively damped least squares for inverse kinematics", Journal of Graphics Tools 10
(2005).
"""
FULL_TURN = 2 * math.pi


@dataclass(frozen=True, slots=True, eq=False)
class IkResult:
    """Best configuration (n,) of a descent; `solved`: it reaches the target within the accuracy."""

    q: Array
    solved: bool
    square: float
    """Remaining squared (weighted) distance and angle together, m² + rad²."""


class IkDescent:
    """IK descents for one robot, with scratch memory only. A step costs about ten bare forward kinematics.

    Most of that is the overhead of numpy calls, so calls are few and work on preallocated arrays.
    """

    def __init__(self, model: RobotModel) -> None:
        self._arm = model.arm
        self._frame = model.tcp_frame
        self._data = model.arm.createData()
        self._hessian: Array = np.empty((6, 6))
        self._diagonal: Array = self._hessian.ravel()[::7]

    def place(self, q: Array) -> pin.SE3:
        """Return the TCP in the world at q (n,): a live view, until the next call."""
        pin.forwardKinematics(self._arm, self._data, q)
        return pin.updateFramePlacement(self._arm, self._data, self._frame)

    def run(
        self,
        target: pin.SE3,
        seed: Array,
        lower: Array,
        upper: Array,
        *,
        weights: Array | None = None,
        stall: int = MAX_STALLED_STEPS,
        gain: float = IMPROVEMENT_SHARE,
        steps: int = MAX_DESCENT_STEPS,
    ) -> IkResult:
        """Descend from a seed (n,) within the limits (n,) towards the TCP's target in the world.

        `weights` (6,) scale the error's three linear and three angular parts, in the TCP's axes: 0 leaves one
        free.
        """
        arm, data, frame, hessian, diagonal = (
            self._arm,
            self._data,
            self._frame,
            self._hessian,
            self._diagonal,
        )
        joint_jacobians, frame_jacobian = pin.computeJointJacobians, pin.getFrameJacobian
        lows, highs = lower.tolist(), upper.tolist()
        q = best_q = seed
        angles = q.tolist()
        best, patience = math.inf, stall
        at_limit = True
        for _ in range(steps):
            joint_jacobians(arm, data, q)
            offset = pin.updateFramePlacement(arm, data, frame).actInv(target)
            if weights is None:
                error = pin.log6(offset).vector
            else:
                # Taken apart, because the logarithm's linear part is the travel along a screw.
                error = np.concatenate([offset.translation, pin.log3(offset.rotation)]) * weights
            x, y, z, a, b, c = error.tolist()
            position, angle = x * x + y * y + z * z, a * a + b * b + c * c
            left = position + angle
            if weights is not None and position > MAX_POSITION_PULL**2:
                # A target out of reach would pull the arm to and fro.
                error[:3] *= MAX_POSITION_PULL / math.sqrt(position)
            if position < POSITION_ACCURACY**2 and angle < ANGLE_ACCURACY**2:
                return IkResult(q, True, left)
            if left < gain * best:
                best, best_q, patience = left, q, stall
            else:
                patience -= 1
                if patience == 0:
                    break
            jacobian = frame_jacobian(arm, data, frame, pin.LOCAL)
            if weights is not None:
                jacobian *= weights[:, None]
            if at_limit:
                # Joints at a limit that would go on beyond it leave the set that moves.
                slopes = error.dot(jacobian).tolist()
                for joint, (at, low, high) in enumerate(zip(angles, lows, highs)):  # noqa: B905  it costs
                    if (at <= low and slopes[joint] < 0.0) or (at >= high and slopes[joint] > 0.0):
                        jacobian[:, joint] = 0.0
            # The damped step among the six errors: J^T (J J^T + d)^-1 e equals (J^T J + d)^-1 J^T e.
            np.dot(jacobian, jacobian.T, out=hessian)
            diagonal += DAMPING_SHARE * left + 1e-7
            step = dposv(hessian, error)[1].dot(jacobian)
            length = math.hypot(*step.tolist())
            if length > MAX_STEP_LENGTH:
                step *= MAX_STEP_LENGTH / length
            q = q + step
            angles = q.tolist()
            at_limit = False
            for joint, (at, low, high) in enumerate(zip(angles, lows, highs)):  # noqa: B905  it costs
                if not low < at < high:
                    angles[joint] = low if at <= low else high
                    at_limit = True
            if at_limit:
                q = np.array(angles)
        return IkResult(best_q, False, best)


def target_of(pose: Pose) -> pin.SE3:
    """Return a pose as pinocchio's rigid transform, made in one call."""
    return pin.XYZQUATToSE3(np.array((*pose.position, *pose.orientation)))


SEED_COUNT = 2048
"""Number of configurations. Finding the nearest takes as long as two steps of a descent; twice as many save
no step."""
TURN_LEVER = 0.3
"""Weight of a turn relative to a travel, m/rad."""


class IkSeeds:
    """IK seeds of one robot, computed from it alone in 10 ms; the same in each process."""

    def __init__(self, model: RobotModel, descent: IkDescent) -> None:
        shares = np.random.default_rng(0).uniform(size=(SEED_COUNT, model.n))
        self.configurations: Array = model.planned_lower + shares * (
            model.planned_upper - model.planned_lower
        )
        """Configurations (SIZE, n), rad."""
        self._keys: Array = np.array([pose_key(descent.place(q)) for q in self.configurations])
        self._half_squares: Array = 0.5 * np.einsum("ij,ij->i", self._keys, self._keys)

    def nearest(self, wanted: Array) -> int:
        """Return the index of the configuration whose pose is nearest to the one with that key (12,)."""
        return int(self._nearness(wanted).argmax())

    def around(self, wanted: Array, count: int) -> Array:
        """Return the `count` configurations (count, n) whose poses are nearest to the one with that key
        (12,)."""
        nearness = self._nearness(wanted)
        some = np.argpartition(nearness, -count)[-count:]
        return self.configurations[some[np.argsort(-nearness[some], kind="stable")]]

    def _nearness(self, wanted: Array) -> Array:
        # |k - w|² = |k|² - 2 k·w + |w|², and the last is the same for all.
        return self._keys.dot(wanted) - self._half_squares


def pose_key(place: pin.SE3) -> Array:
    """Return a pose as a point (12,): equal distances (m) for equal travels and, for small turns, equal
    arcs."""
    point: Array = np.empty(12)
    point[:3] = place.translation
    # Two rotations that differ by a small angle a are 2^½ a apart in the Frobenius norm.
    point[3:] = (TURN_LEVER / 2**0.5) * place.rotation.ravel()
    return point
