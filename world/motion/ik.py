"""Inverse kinematics: Levenberg-Marquardt with joint limits as an active set, and restarts.

Damping after Sugihara, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method",
IEEE Transactions on Robotics 27 (2011).
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..robot.model import RobotModel, se3
from ..values import Array, Pose

POSITION = 1e-5
"""Accuracy, m."""
ANGLE = 1e-4
"""Accuracy, rad."""
STEPS = 60
STALL = 5
"""Steps without an improvement of a tenth after which a descent is given up."""
RESTARTS = 40
APART = 0.1
"""Solutions whose joints all differ by less are the same one, rad."""


class InverseKinematics:
    """Solutions for the TCP of a robot. `solves` counts descents; nothing else is remembered."""

    def __init__(self, model: RobotModel) -> None:
        self.model = model
        self.solves = 0
        self._arm = model.arm
        self._data = model.arm.createData()
        self._frame = model.tcp_frame

    def descend(self, tcp_in_world: Pose, seed: Array) -> Array | None:
        """The solution (n,) that the seed leads to, within the soft limits, or None."""
        self.solves += 1
        target = se3(tcp_in_world)
        lower, upper = self.model.planned_lower, self.model.planned_upper
        q: Array = np.clip(seed, lower, upper)
        best, patience = np.inf, STALL
        diagonal = slice(None, None, self.model.n + 1)
        for _ in range(STEPS):
            pin.computeJointJacobians(self._arm, self._data, q)
            pose = pin.updateFramePlacement(self._arm, self._data, self._frame)
            error: Array = pin.log6(pose.actInv(target)).vector
            position, angle = float(error[:3] @ error[:3]), float(error[3:] @ error[3:])
            if position < POSITION**2 and angle < ANGLE**2:
                return q
            total = position + angle
            if total < 0.9 * best:
                best, patience = total, STALL
            else:
                patience -= 1
                if patience == 0:
                    return None
            jacobian = pin.getFrameJacobian(self._arm, self._data, self._frame, pin.LOCAL)
            gradient: Array = jacobian.T @ error
            hessian: Array = jacobian.T @ jacobian
            hessian.ravel()[diagonal] += 1e-3 * total + 1e-7
            stuck = ((q <= lower) & (gradient < 0)) | ((q >= upper) & (gradient > 0))
            if stuck.any():
                hessian[stuck, :] = 0.0
                hessian[:, stuck] = 0.0
                hessian[stuck, stuck] = 1.0
                gradient[stuck] = 0.0
            step: Array = np.asarray(np.linalg.solve(hessian, gradient), np.float64)
            longest = float(np.abs(step).max())
            if longest > 1.0:
                step = step / longest
            q = np.minimum(np.maximum(q + step, lower), upper)
        return None

    def solutions(
        self, tcp_in_world: Pose, rng: np.random.Generator, near: Array, want: int = 4
    ) -> list[Array]:
        """Up to `want` different solutions, sorted by their distance in joint space to `near` (n,)."""
        found: list[Array] = []
        for attempt in range(RESTARTS):
            seed = near
            if attempt > 0:
                anywhere = rng.uniform(self.model.planned_lower, self.model.planned_upper)
                # Half of the seeds around where the arm is: near solutions make short motions.
                seed = anywhere if attempt % 2 else near + 0.3 * (anywhere - near)
            q = self.descend(tcp_in_world, seed)
            if q is not None and all(float(np.abs(q - other).max()) > APART for other in found):
                found.append(q)
                if len(found) == want:
                    break
            if not found and attempt + 1 >= RESTARTS // 2:
                break
        return sorted(found, key=lambda q: float(np.linalg.norm(q - near)))
