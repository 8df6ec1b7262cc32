"""The target of a guarded move: straight on until something pushes back."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..values import Array, Pose, Vector3

ACCELERATION = 0.5
"""Of the target along its line, m/s²."""
AVERAGED = 4
"""Readings of the wrist that decide about a contact together."""

STANDING_PERIODS = 12
STANDING = 1.2e-4
"""Way of the tool in so many control periods below which it stands, m: more than the encoders' noise."""


@dataclass(frozen=True, slots=True)
class GuardedResult:
    """How a guarded move ended."""

    contact: bool
    travelled: float
    """Along the direction, by the encoders, m."""
    force: float
    """Contact force against the direction: at the contact, else the greatest that was met, N."""
    pose: Pose
    """TCP in the world where the arm came to rest."""


class GuardedTarget:
    """Moves along a line until `force` N act against it or the distance is done.

    At the contact the anchor goes back to where the tool is (plus what makes it press with `press` N), so
    that nothing remains of the spring's tension.
    """

    def __init__(
        self,
        direction: Array,
        distance: float,
        *,
        force: float,
        speed: float,
        press: float,
        stiffness: float,
        period: float,
        felt: Callable[[], Vector3],
        baseline: Array,
    ) -> None:
        """`felt`: the latest external force (3,) on the hand; `baseline`: the same, (3,), before touching."""
        self._direction = direction
        self._distance = distance
        self._force = force
        self._speed = speed
        self._lead = press / stiffness
        self._period = period
        self._felt = felt
        self._against = (-float(direction[0]), -float(direction[1]), -float(direction[2]))
        self._zero = -float(direction @ baseline)
        self._recent: deque[float] = deque(maxlen=AVERAGED)
        self._ways: deque[float] = deque(maxlen=STANDING_PERIODS)
        self._rate = 0.0
        self._most = speed
        self._way = 0.0
        self.contact = False
        self.finished = False
        """The target stands still."""
        self.peak = 0.0

    def start(self, position: Array, rotation: Array) -> None:
        self._origin = position
        self.position: Array = position.copy()
        self.rotation: Array = rotation
        self.velocity: Array = np.zeros(3)
        self.acceleration: Array = np.zeros(3)

    @property
    def standing(self) -> bool:
        """The tool has stopped, too."""
        ways = self._ways
        return self.finished and len(ways) == STANDING_PERIODS and max(ways) - min(ways) < STANDING

    @property
    def direction(self) -> Array:
        return self._direction

    def limit(self, speed: float) -> None:
        self._most = min(speed, self._speed)

    def advance(self, position: Array) -> None:
        if self.finished:
            self._ways.append(float(self._direction @ (position - self._origin)))
            return
        fx, fy, fz = self._felt()
        ax, ay, az = self._against
        self._recent.append(fx * ax + fy * ay + fz * az - self._zero)
        pushed = sum(self._recent) / len(self._recent)
        self.peak = max(self.peak, pushed)
        if pushed > self._force:
            self.contact = self.finished = True
            along = float(self._direction @ (position - self._origin)) + self._lead
            self.position = self._origin + self._direction * along
            self.velocity = self.acceleration = np.zeros(3)
            self.peak = pushed
            return
        left = self._distance - self._way
        step = ACCELERATION * self._period
        before = self._rate
        wanted = min(self._most, max(step, (2 * ACCELERATION * left) ** 0.5))
        self._rate = min(max(wanted, self._rate - 2 * step), self._rate + step)
        self._way = min(self._way + self._rate * self._period, self._distance)
        self.position = self._origin + self._direction * self._way
        if self._way >= self._distance:
            self.finished = True
            self.velocity = self.acceleration = np.zeros(3)
        else:
            self.velocity = self._direction * self._rate
            self.acceleration = self._direction * ((self._rate - before) / self._period)
