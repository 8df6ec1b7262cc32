"""The course of a guarded move: straight on until something pushes back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...world.values import Array, Pose
from ..cartesian.compliant_motion import CompliantMotion, ContactState

ACCELERATION = 0.5
"""Of the anchor along its line, m/s²."""


@dataclass(frozen=True, slots=True)
class GuardedMoveResult:
    """How a guarded move ended."""

    contact: bool
    travelled: float
    """Along the direction, by the encoders, m."""
    force: float
    """Contact force against the direction: at the contact, else the greatest that was met, N."""
    pose: Pose
    """TCP in the world where the arm came to rest."""


class GuardedMove(CompliantMotion):
    """Moves along a unit vector (3,) until `force` N act against it or the distance is done.

    At the contact the anchor goes back to where the tool is (plus what makes it press with `press` N), so
    that nothing remains of the spring's tension.
    """

    def __init__(
        self, direction: Array, distance: float, *, force: float, speed: float, press: float, stiffness: float
    ) -> None:
        """`stiffness`: of the spring along the direction, N/m."""
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
        """Against the direction: at the contact, else the greatest that was met, N."""

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
        step = ACCELERATION * felt.period
        before = self._rate
        wanted = min(self._most, max(step, (2 * ACCELERATION * left) ** 0.5))
        self._rate = min(max(wanted, self._rate - 2 * step), self._rate + step)
        self._way = min(self._way + self._rate * felt.period, self._distance)
        self.position = self.origin + self._direction * self._way
        if self._way >= self._distance:
            self.finished = True
            self.velocity = self.acceleration = np.zeros(3)
        else:
            self.velocity = self._direction * self._rate
            self.acceleration = self._direction * ((self._rate - before) / felt.period)
