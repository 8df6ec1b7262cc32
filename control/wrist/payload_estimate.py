"""What the hand carries: its mass and where its centre is, estimated from what the wrist feels at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...world.values import GRAVITY, Array, Vector3

SPREAD = 0.03
"""How far from the grasp the centre of a held object is expected before anything is felt, one sigma, m."""
HEAVIEST = 20.0
"""One sigma of the mass before anything is felt, kg: nothing is known."""
FORCE_SIGMA, TORQUE_SIGMA = 0.05, 0.004
"""Of a mean over some 0.1 s at rest, N and Nm."""
SEEN = 0.02
"""Mass above which the torque tells where the centre is, kg."""


@dataclass(frozen=True, slots=True)
class Payload:
    """A rigid body between the fingers. Positions in the TCP frame."""

    mass: float
    """kg"""
    mass_sigma: float
    """Standard deviation of the mass, kg."""
    centre: Vector3 = (0.0, 0.0, 0.0)
    """Centre of mass, m."""
    centre_sigma: Vector3 = (SPREAD, SPREAD, SPREAD)
    """Standard deviation along each axis, m."""

    def wrench(self, rotation: Array, sensor_in_tool: Array) -> Array:
        """What it does to the wrist at rest: (6,) force N and torque Nm, world axes, about the sensor's
        origin. `rotation` (3, 3) of the tool in the world, `sensor_in_tool` (3,) m."""
        weight = np.array([0.0, 0.0, -self.mass * GRAVITY])
        lever = rotation @ (np.array(self.centre) - sensor_in_tool)
        return np.concatenate([weight, np.cross(lever, weight)])

    def __str__(self) -> str:
        """`118 ± 4 g`"""
        return f"{self.mass * 1000:.0f} ± {self.mass_sigma * 1000:.0f} g"


class PayloadEstimator:
    """Weighted least squares of mass and centre over readings at rest, in any number of orientations.

    With θ = (m, m·c), c in the TCP frame, each reading is linear in θ: f = −m g ẑ, τ = −g (R(m c − m s)) × ẑ,
    where s is the sensor's origin (Atkeson, An & Hollerbach 1986, at rest). One orientation leaves the
    centre's height along the vertical to what was expected; a second one, tilted, tells it.
    """

    def __init__(self, sensor_in_tool: Array) -> None:
        """`sensor_in_tool` (3,): origin of the wrist's sensor in the TCP frame, m."""
        self._sensor = np.asarray(sensor_in_tool, np.float64)
        self._information: Array = np.zeros((4, 4))
        self._information[0, 0] = 1.0 / HEAVIEST**2
        self._vector: Array = np.zeros(4)
        self.readings = 0

    def add(self, wrench: Array, rotation: Array) -> None:
        """A mean (6,) at rest, with nothing in it but the payload: force and torque on the hand in the
        world's axes about the sensor's origin; the tool is turned by `rotation` (3, 3)."""
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
        """The estimate so far."""
        mass = max(float(np.linalg.lstsq(self._information, self._vector, rcond=None)[0][0]), 0.0)
        information = self._information.copy()
        # The centre is expected at the grasp: a prior on m·c that scales with the mass.
        information[1:, 1:] += np.eye(3) / (max(mass, SEEN) * SPREAD) ** 2
        covariance = np.linalg.inv(information)
        moment = covariance @ self._vector
        mass = max(float(moment[0]), 0.0)
        by = max(mass, SEEN)
        x, y, z = (float(c) / by for c in moment[1:])
        sx, sy, sz = (float(np.sqrt(covariance[k, k])) / by for k in (1, 2, 3))
        return Payload(mass, float(np.sqrt(covariance[0, 0])), (x, y, z), (sx, sy, sz))


def _cross(v: Array) -> Array:
    """(3, 3): [v]× , with [v]× w = v × w."""
    x, y, z = v.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
