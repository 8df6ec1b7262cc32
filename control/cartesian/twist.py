"""A Cartesian velocity command, as a value."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from ...world.values import Vector3

Frame: TypeAlias = Literal["world", "tool"]

FASTEST, FASTEST_TURN = 0.5, 2.0
"""Of a commanded twist: the look ahead of a jog sees as far as it brakes from there, m/s and rad/s."""


@dataclass(frozen=True, slots=True)
class Twist:
    """How the tool shall move, m/s and rad/s about the TCP, in the world's axes or the tool's own."""

    linear: Vector3 = (0.0, 0.0, 0.0)
    angular: Vector3 = (0.0, 0.0, 0.0)
    frame: Frame = "world"

    @property
    def speed(self) -> float:
        """Of the TCP, m/s."""
        return math.hypot(*self.linear)

    @property
    def size(self) -> float:
        """0 when nothing is to move: m/s, or rad/s where it only turns."""
        return max(self.speed, math.hypot(*self.angular))

    def scaled(self, share: float) -> Twist:
        x, y, z = self.linear
        a, b, c = self.angular
        return Twist((x * share, y * share, z * share), (a * share, b * share, c * share), self.frame)
