"""Feeling that something slips out of the hand: less hangs on the wrist than the hand carries.

While the arm moves, the wrist feels hand and object accelerate, too. Over a tick the mean force is the change
of momentum (the impulse theorem), and the velocities at both ends are known from the encoders: what is left
is the mass that takes part. Fingers that keep their opening do not tell: what slides out between them does
not move them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...world.values import GRAVITY, Array
from .payload_estimate import Payload

if TYPE_CHECKING:
    from ...robots.model import RobotModel

FEWEST = 2
"""Ticks in a row that tell of a slip."""
SLIPPING, GONE = 0.7, 0.3
"""Share of the mass that is felt, below which an object slides, or is gone."""
UNSURE, UNSURE_MOVING = 0.015, 0.008
"""Greatest error of the mass in a tick, kg, and how it grows with the acceleration, kg/(m/s²). Measured over
the transfers of 24 items: never more than this was missing."""
CLEAR = 0.5
"""A tick whose error may be more than this share of the mass tells nothing."""


@dataclass(frozen=True, slots=True)
class WristSample:
    """Force and velocities at the end of a tick, world axes."""

    force: Array
    """(3,) mean external force over the tick, without tool's weight and bias, N."""
    hand: Array
    """(3,) velocity of the hand's centre of mass, m/s."""
    load: Array
    """(3,) velocity of the centre of what is held, m/s."""


def wrist_sample(model: RobotModel, q: Array, v: Array, force: Array, centre: Array) -> WristSample:
    """At q (n,) and v (n,), with what is held centred at `centre` (3,) in the TCP frame, m."""
    twist = model.jacobian(q) @ v
    tcp = model.tcp(q)
    at = np.array(tcp.position)
    hand = model.flange(q).apply(np.array(model.hand_com)) - at
    held = tcp.rotation() @ centre
    return WristSample(force, _at(twist, hand), _at(twist, held))


@dataclass(frozen=True, slots=True)
class MassEstimate:
    """Mass that moves with the hand, as far as one tick tells, and its greatest error, kg."""

    mass: float
    unsure: float


def estimate_moving_mass(
    hand_mass: float, before: WristSample, after: WristSample, tick: float
) -> MassEstimate:
    """What moves with the hand: F = −m_h a_h − m (a + g), solved for m along a + g."""
    pull = after.force + hand_mass * (after.hand - before.hand) / tick
    along = (after.load - before.load) / tick
    shaken = float(np.linalg.norm(along))
    along[2] += GRAVITY
    mass = -float(pull @ along) / max(float(along @ along), 1.0)
    return MassEstimate(mass, UNSURE + UNSURE_MOVING * shaken)


class SlipDetector:
    """Fed with the mass that is felt each tick; says what becomes of what the hand took up."""

    def __init__(self, payload: Payload) -> None:
        self.payload = payload
        self._felt: list[MassEstimate] = []

    def feel(self, felt: MassEstimate) -> None:
        """One tick more. What is shaken so hard that an object of this mass could not be told from none is
        left out."""
        if felt.unsure <= CLEAR * self.payload.mass:
            self._felt = [*self._felt, felt][-FEWEST:]

    @property
    def slipping(self) -> bool:
        """Each of the last ticks felt clearly less than the object weighs."""
        return self._below(SLIPPING)

    @property
    def gone(self) -> bool:
        """Hardly anything is left."""
        return self._below(GONE)

    def _below(self, share: float) -> bool:
        mass = self.payload.mass
        surely = mass - 3.0 * self.payload.mass_sigma
        return len(self._felt) == FEWEST and all(
            f.mass < min(share * mass, surely - f.unsure) for f in self._felt
        )

    def forget(self) -> None:
        """Begin anew, as after a firmer grip."""
        self._felt = []


def _at(twist: Array, lever: Array) -> Array:
    """Velocity (3,) of a point that is `lever` (3,) away from the TCP."""
    return np.asarray(twist[:3] + np.cross(twist[3:], lever), np.float64)
