"""Cartesian velocity command."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from ...world.values import Vector3

Frame: TypeAlias = Literal["world", "tool"]

MAX_TWIST_SPEED, MAX_TWIST_ANGULAR_SPEED = 0.5, 2.0
"""Greatest commanded twist, m/s and rad/s. The look-ahead of a jog covers braking from these speeds."""


@dataclass(frozen=True, slots=True)
class Twist:
    """Velocity of the tool, m/s and rad/s about the TCP, in world axes or the tool's own."""

    linear: Vector3 = (0.0, 0.0, 0.0)
    angular: Vector3 = (0.0, 0.0, 0.0)
    frame: Frame = "world"

    @property
    def speed(self) -> float:
        """Speed of the TCP, m/s."""
        return math.hypot(*self.linear)

    @property
    def size(self) -> float:
        """Size of the twist: m/s, or rad/s when it only turns; 0: no motion."""
        return max(self.speed, math.hypot(*self.angular))

    def scaled(self, share: float) -> Twist:
        x, y, z = self.linear
        a, b, c = self.angular
        return Twist((x * share, y * share, z * share), (a * share, b * share, c * share), self.frame)
