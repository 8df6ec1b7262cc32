"""Payload estimation: mass and centre of the held object from wrist readings at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...world.values import GRAVITY, Array, Vector3

CENTRE_PRIOR_SIGMA = 0.03
"""Prior standard deviation of the object's centre from the grasp, m."""
MASS_PRIOR_SIGMA = 20.0
"""Prior standard deviation of the mass, kg: practically unknown."""
FORCE_SIGMA, TORQUE_SIGMA = 0.05, 0.004
"""Standard deviations of a mean over some 0.1 s at rest, N and Nm."""
MIN_CENTRE_MASS = 0.02
"""Mass above which the torque determines the centre, kg."""


@dataclass(frozen=True, slots=True)
class Payload:
    """Rigid body between the fingers. Positions are in the TCP frame."""

    mass: float
    """Mass, kg."""
    mass_sigma: float
    """Standard deviation of the mass, kg."""
    centre: Vector3 = (0.0, 0.0, 0.0)
    """Centre of mass, m."""
    centre_sigma: Vector3 = (CENTRE_PRIOR_SIGMA, CENTRE_PRIOR_SIGMA, CENTRE_PRIOR_SIGMA)
    """Standard deviation along each axis, m."""

    def wrench(self, rotation: Array, sensor_in_tool: Array) -> Array:
        """Return the wrench (6,) of the payload on the wrist at rest: N and Nm, world axes, about the
        sensor's origin.

        `rotation` (3, 3): tool in the world. `sensor_in_tool` (3,): origin of the sensor, m.
        """
        weight = np.array([0.0, 0.0, -self.mass * GRAVITY])
        lever = rotation @ (np.array(self.centre) - sensor_in_tool)
        return np.concatenate([weight, np.cross(lever, weight)])

    def __str__(self) -> str:
        """`118 ± 4 g`"""
        return f"{self.mass * 1000:.0f} ± {self.mass_sigma * 1000:.0f} g"


class PayloadEstimator:
    """Weighted least squares of mass and centre over readings at rest, in any number of orientations.

    Each reading is linear in θ = (m, m·c), c in the TCP frame: f = −m g ẑ, τ = −g (R(m c − m s)) × ẑ. Here s
    is the sensor's origin (Atkeson, An & Hollerbach 1986, at rest). One orientation leaves the
    centre's height along the vertical to the prior; a second, tilted one determines it.
    """

    def __init__(self, sensor_in_tool: Array) -> None:
        """`sensor_in_tool` (3,): origin of the wrist's sensor in the TCP frame, m."""
        self._sensor = np.asarray(sensor_in_tool, np.float64)
        self._information: Array = np.zeros((4, 4))
        self._information[0, 0] = 1.0 / MASS_PRIOR_SIGMA**2
        self._vector: Array = np.zeros(4)
        self.readings = 0

    def add(self, wrench: Array, rotation: Array) -> None:
        """Add a mean wrench (6,) of the payload alone, at rest.

        Force and torque on the hand, world axes, about the sensor's origin. `rotation` (3, 3): tool in the
        world.
        """
        up = rotation.T @ np.array([0.0, 0.0, 1.0])
        rows: Array = np.zeros((6, 4))
        rows[:3, 0] = -GRAVITY * up
        # (m c) × up and (m s) × up, in the tool's axes.
        rows[3:, 1:] = GRAVITY * _cross(up)
        rows[3:, 0] = GRAVITY * np.cross(self._sensor, up)
        turned = np.concatenate([rotation.T @ wrench[:3], rotation.T @ wrench[3:]])
        weight = np.array([FORCE_SIGMA] * 3 + [TORQUE_SIGMA] * 3) ** -2.0
        self._information += (rows.T * weight) @ rows
        self._vector += rows.T @ (weight * turned)
        self.readings += 1

    @property
    def payload(self) -> Payload:
        """Present estimate of the payload."""
        mass = max(float(np.linalg.lstsq(self._information, self._vector, rcond=None)[0][0]), 0.0)
        information = self._information.copy()
        # The centre is expected at the grasp: a prior on m·c that scales with the mass.
        information[1:, 1:] += np.eye(3) / (max(mass, MIN_CENTRE_MASS) * CENTRE_PRIOR_SIGMA) ** 2
        covariance = np.linalg.inv(information)
        moment = covariance @ self._vector
        mass = max(float(moment[0]), 0.0)
        by = max(mass, MIN_CENTRE_MASS)
        x, y, z = (float(c) / by for c in moment[1:])
        sx, sy, sz = (float(np.sqrt(covariance[k, k])) / by for k in (1, 2, 3))
        return Payload(mass, float(np.sqrt(covariance[0, 0])), (x, y, z), (sx, sy, sz))


def _cross(v: Array) -> Array:
    """Return the matrix [v]× (3, 3), with [v]× w = v × w."""
    x, y, z = v.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
