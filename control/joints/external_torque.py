"""What pushes at the arm, wherever it does: the torques that its own drives and weight do not explain."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ...robots.model import RobotModel
from ...world.values import Array, JointState

GAIN = 40.0
"""Of the observer, 1/s: a contact shows after 25 ms."""


class TorqueObserver:
    """External torques of all joints from encoders and commanded torques, without accelerations.

    The generalised momentum p = M v changes by what drives the joints; what it changes beyond that came from
    outside: r = K (p − p₀ − ∫ (τ + Cᵀ v − g + r) dt). De Luca, Albu-Schäffer, Haddadin and Hirzinger,
    "Collision detection and safe reaction with the DLR-III lightweight manipulator arm", IROS 2006.
    """

    def __init__(self, model: RobotModel, period: float, gain: float = GAIN) -> None:
        self._model = model
        self._arm = model.arm
        self._data = model.arm.createData()
        self._period = period
        self._gain = gain
        self._sum: Array | None = None
        self.torque: Array = np.zeros(model.n)
        """(n,) external torques, Nm; zero where nothing but the arm's own weight and drives act."""

    def watch(self, state: JointState, driven: Array) -> Array:
        """One control period has passed, in which the drives gave `driven` (n,) Nm: the torques now."""
        arm, data, q, v = self._arm, self._data, state.position, state.velocity
        momentum = self._model.mass_matrix(q) @ v
        coriolis = pin.computeCoriolisMatrix(arm, data, q, v)
        known = driven + coriolis.T @ v - pin.computeGeneralizedGravity(arm, data, q)
        if self._sum is None:
            self._sum = momentum - known * self._period
        self._sum = self._sum + (known + self.torque) * self._period
        self.torque = self._gain * (momentum - self._sum)
        return self.torque


def at_rest(model: RobotModel, state: JointState) -> Array:
    """External torques (n,), Nm, on an arm that stands, from what its drives give."""
    return model.gravity(state.position) - state.effort
