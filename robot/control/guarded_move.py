"""Guarded move as a compliant motion: a straight line that ends at a given contact force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...world.values import Array, Pose
from .compliant_motion import CompliantMotion, ContactState

GUARDED_MOVE_ACCELERATION = 0.5
"""Acceleration of the anchor along its line, m/s²."""


@dataclass(frozen=True, slots=True)
class GuardedMoveResult:
    """Result of a guarded move."""

    contact: bool
    travelled: float
    """Distance travelled along the direction, by the encoders, m."""
    force: float
    """Contact force against the direction, N: at the contact, else the greatest during the move."""
    pose: Pose
    """TCP pose in the world where the arm came to rest."""


class GuardedMove(CompliantMotion):
    """Straight motion along a unit vector (3,) until `force` N act against it or the distance is done.

    At the contact the anchor moves back to the tool, plus the offset that presses with `press` N. So the
    spring keeps no other tension.
    """

    def __init__(
        self, direction: Array, distance: float, *, force: float, speed: float, press: float, stiffness: float
    ) -> None:
        """`stiffness`: stiffness of the spring along the direction, N/m."""
        super().__init__()
        self._direction = direction
        self._distance = distance
        self._force = force
        self._speed = self._most = speed
        self._lead = press / stiffness
        self._rate = 0.0
        self._way = 0.0
        self.contact = False
        self.pushed = 0.0
        """Contact force against the direction, N: at the contact, else the greatest so far."""

    @property
    def direction(self) -> Array:
        return self._direction

    def limit(self, speed: float) -> None:
        self._most = min(speed, self._speed)

    def step(self, felt: ContactState) -> None:
        pushed = -float(self._direction @ felt.force)
        if pushed > self._force:
            self.contact = self.finished = True
            along = float(self._direction @ (felt.position - self.origin)) + self._lead
            self.position = self.origin + self._direction * along
            self.velocity = self.acceleration = np.zeros(3)
            self.pushed = pushed
            return
        self.pushed = max(self.pushed, pushed)
        left = self._distance - self._way
        step = GUARDED_MOVE_ACCELERATION * felt.period
        before = self._rate
        wanted = min(self._most, max(step, (2 * GUARDED_MOVE_ACCELERATION * left) ** 0.5))
        self._rate = min(max(wanted, self._rate - 2 * step), self._rate + step)
        self._way = min(self._way + self._rate * felt.period, self._distance)
        self.position = self.origin + self._direction * self._way
        if self._way >= self._distance:
            self.finished = True
            self.velocity = self.acceleration = np.zeros(3)
        else:
            self.velocity = self._direction * self._rate
            self.acceleration = self._direction * ((self._rate - before) / felt.period)
