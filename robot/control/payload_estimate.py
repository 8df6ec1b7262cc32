"""Payload of the wrist, mass and centre of the held object; and slip detection.

A slip is a load on the wrist below the payload. While the arm moves, the wrist also reads the inertial forces
of hand and object. The mean force over a tick is the change of momentum (impulse theorem), and the encoders
give the velocities at both ends. The rest is the moving mass. The fingers' opening shows no slip: an object
that slides out between them does not move them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from picktree.world import GRAVITY, Array, Vector3, cross

if TYPE_CHECKING:
    from picktree.world.robot_model import RobotModel


@dataclass(frozen=True, slots=True)
class Payload:
    """Rigid body between the fingers. Positions are in the TCP frame."""

    mass: float
    """Mass, kg."""
    mass_sigma: float
    """Standard deviation of the mass, kg."""
    centre: Vector3 = (0.0, 0.0, 0.0)
    """Centre of mass, m."""

    def wrench(self, rotation: Array, sensor_in_tool: Array) -> Array:
        """Return the wrench (6,) of the payload on the wrist at rest: N and Nm, world axes, about the
        sensor's origin.

        `rotation` (3, 3): tool in the world. `sensor_in_tool` (3,): origin of the sensor, m.
        """
        weight = np.array([0.0, 0.0, -self.mass * GRAVITY])
        lever = rotation @ (np.array(self.centre) - sensor_in_tool)
        return np.concatenate([weight, cross(lever, weight)])

    def __str__(self) -> str:
        """`118 ± 4 g`"""
        return f"{self.mass * 1000:.0f} ± {self.mass_sigma * 1000:.0f} g"


MIN_SLIP_TICKS = 2
"""Consecutive ticks that make a slip."""
SLIPPING_MASS_SHARE, LOST_MASS_SHARE = 0.7, 0.3
"""Shares of the payload's mass below which an object slides, and is gone."""
MASS_ERROR, MASS_ERROR_GROWTH = 0.015, 0.008
"""Greatest error of the mass in a tick, kg, and its growth with the acceleration, kg/(m/s²). Measured over
the transfers of 24 items: never more than this was missing."""
MAX_ERROR_SHARE = 0.5
"""Greatest error of a tick that counts, as a share of the payload's mass."""


@dataclass(frozen=True, slots=True)
class WristSample:
    """Wrist force and velocities at the end of a tick, world axes."""

    force: Array
    """Mean external force (3,) over the tick, without the tool's weight and the bias, N."""
    hand: Array
    """Velocity (3,) of the hand's centre of mass, m/s."""
    load: Array
    """Velocity (3,) of the held object's centre, m/s."""


def wrist_sample(model: RobotModel, q: Array, v: Array, force: Array, centre: Array) -> WristSample:
    """Return the sample at q (n,) and v (n,); `centre` (3,): centre of the held object in the TCP frame,
    m."""
    twist = model.jacobian(q) @ v
    tcp = model.tcp(q)
    at = np.array(tcp.position)
    hand = model.flange(q).apply(np.array(model.hand_com)) - at
    held = tcp.rotation() @ centre
    return WristSample(force, point_velocity(twist, hand), point_velocity(twist, held))


@dataclass(frozen=True, slots=True)
class MassEstimate:
    """Mass that moves with the hand, estimated from one tick, and its greatest error, kg."""

    mass: float
    unsure: float


def estimate_moving_mass(
    hand_mass: float, before: WristSample, after: WristSample, tick: float
) -> MassEstimate:
    """Return the mass that moves with the hand: F = −m_h a_h − m (a + g), solved for m along a + g."""
    pull = after.force + hand_mass * (after.hand - before.hand) / tick
    along = (after.load - before.load) / tick
    shaken = float(np.linalg.norm(along))
    along[2] += GRAVITY
    mass = -float(pull @ along) / max(float(along @ along), 1.0)
    return MassEstimate(mass, MASS_ERROR + MASS_ERROR_GROWTH * shaken)


class SlipDetector:
    """Detector of slip from the moving mass of each tick."""

    def __init__(self, payload: Payload) -> None:
        self.payload = payload
        self._estimates: list[MassEstimate] = []

    def feel(self, felt: MassEstimate) -> None:
        """Add a tick. It is left out when its acceleration is too large to distinguish this payload from
        none."""
        if felt.unsure <= MAX_ERROR_SHARE * self.payload.mass:
            self._estimates = [*self._estimates, felt][-MIN_SLIP_TICKS:]

    @property
    def slipping(self) -> bool:
        """Whether each of the last ticks shows clearly less mass than the payload's."""
        return self._below(SLIPPING_MASS_SHARE)

    @property
    def gone(self) -> bool:
        """Whether hardly any of the payload is left."""
        return self._below(LOST_MASS_SHARE)

    def _below(self, share: float) -> bool:
        mass = self.payload.mass
        surely = mass - 3.0 * self.payload.mass_sigma
        return len(self._estimates) == MIN_SLIP_TICKS and all(
            f.mass < min(share * mass, surely - f.unsure) for f in self._estimates
        )

    def forget(self) -> None:
        """Discard the ticks so far, as after a firmer grip."""
        self._estimates = []


def point_velocity(twist: Array, lever: Array) -> Array:
    """Return the velocity (3,) of a point that is `lever` (3,) away from the TCP, m/s."""
    return np.asarray(twist[:3] + cross(twist[3:], lever), np.float64)
