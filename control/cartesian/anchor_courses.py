"""Where the anchor of a compliant tool goes, decided in each control period by what is felt."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from ...world.values import Array

STANDING_TIME = 0.05
STANDING = 1.2e-4
"""Way of the tool in that time, s, below which it stands, m: more than the encoders' noise."""


@dataclass(frozen=True, slots=True, eq=False)
class ContactState:
    """What is known of the tool in one control period."""

    elapsed: float
    """Since the course began, s."""
    period: float
    """Since it was asked last, s."""
    force: Array
    """(3,) external force on the hand beyond what it felt before it touched anything, mean of the last
    readings, in the world, N."""
    torque: Array
    """(3,) likewise, about the TCP, Nm."""
    position: Array
    """(3,) of the TCP in the world by the encoders, m."""
    rotation: Array
    """(3, 3) of the tool in the world."""


class CompliantMotion:
    """A course for `ArmMotion.comply`. Write `step`: it may move `position` (3,) and `rotation` (3, 3), where
    the spring is anchored in the world, say how they move (`velocity` and `acceleration` (3,), `spin` (3,)
    rad/s, all zero unless said), set `wrench` (6,), which the tool exerts beyond its spring (N and Nm, world
    axes, about the TCP; with no stiffness along an axis that is force control), and end by `finished`.

    `origin` (3,) and `turn` (3, 3) are the tool's pose where the course began.
    """

    def __init__(self) -> None:
        self.finished = False
        """The anchor stays where it is."""
        self.peak = 0.0
        """Greatest contact force that was met, N."""
        self._recent: deque[tuple[float, float, float, float]] = deque()

    def start(self, position: Array, rotation: Array) -> None:
        """Called once with the tool's pose, so that the motion begins with zero error."""
        self.origin, self.turn = position, rotation
        self.position: Array = position.copy()
        self.rotation: Array = rotation.copy()
        self.velocity: Array = np.zeros(3)
        self.acceleration: Array = np.zeros(3)
        self.spin: Array = np.zeros(3)
        self.wrench: Array = np.zeros(6)

    def step(self, felt: ContactState) -> None:
        """One control period passes."""

    def advance(self, felt: ContactState) -> None:
        """For the controller: one control period passes."""
        self.peak = max(self.peak, float(np.sqrt(felt.force @ felt.force)))
        if self.finished:
            x, y, z = felt.position.tolist()
            self._recent.append((felt.elapsed, x, y, z))
            while felt.elapsed - self._recent[0][0] > STANDING_TIME:
                self._recent.popleft()
        else:
            self.step(felt)

    @property
    def standing(self) -> bool:
        """The course is finished, and the tool has stopped, too."""
        recent = self._recent
        if not recent or recent[-1][0] - recent[0][0] < 0.8 * STANDING_TIME:
            return False
        return all(max(way) - min(way) < STANDING for way in list(zip(*recent, strict=True))[1:])

    @property
    def direction(self) -> Array:
        """Unit vector (3,) along which the anchor moves, or zero: there joints that come to their limits
        slow it down."""
        return np.zeros(3)

    def limit(self, speed: float) -> None:
        """From now on no faster than `speed` m/s along `direction`: the joints could not follow."""


class HoldPose(CompliantMotion):
    """The pose at which it began."""
