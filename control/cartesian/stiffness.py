"""The spring of a compliant tool: stiffness and damping for each axis of a named frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from ...world.values import Array, Pose, Quaternion, Vector3

Frame: TypeAlias = Literal["world", "tool"] | Quaternion
"""Whose axes are meant: the world's, those of the TCP as it turns, or of a frame turned so in the world."""
LEAST = (200.0, 5.0)
"""Stiffness whose damping an axis has at least, N/m and Nm/rad."""


@dataclass(frozen=True, slots=True)
class CartesianStiffness:
    """Of the spring between the tool and its anchor, N/m and Nm/rad, and share of the critical damping: one
    number each, or one for each axis of `frame`. An axis without stiffness is moved by the course's wrench
    alone; one that is softer than `LEAST` is damped as if it had that."""

    linear: float | Vector3 = 1500.0
    angular: float | Vector3 = 40.0
    damping: float | Vector3 = 0.9
    """Along and about each axis."""
    frame: Frame = "world"

    def along(self, direction: Array, rotation: Array) -> float:
        """Against a shift along a unit vector (3,) of the world, the tool being turned by (3, 3), N/m."""
        in_frame = self._axes(rotation).T @ direction
        return float((np.broadcast_to(self.linear, 3) * in_frame) @ in_frame)

    def matrix(self, rotation: Array) -> Array:
        """(6, 6) in the world's axes, the tool being turned by (3, 3)."""
        return self._blocks(self._six(), rotation)

    def damping_matrix(self, inertia: Array, rotation: Array) -> Array:
        """(6, 6) N·s/m and Nm·s/rad for a tool with `inertia` (6, 6) in the world's axes.

        By double diagonalisation of stiffness and inertia (Albu-Schäffer et al., "Cartesian impedance control
        of redundant robots", ICRA 2003); shares that differ scale its axes.
        """
        stiff = self._blocks(np.maximum(self._six(), np.repeat(LEAST, 3)), rotation)
        lower = np.linalg.cholesky(inertia)
        inverse = np.linalg.inv(lower)
        squares, modes = np.linalg.eigh(inverse @ stiff @ inverse.T)
        shape = lower @ modes
        if isinstance(self.damping, float | int):
            return (shape * (2.0 * self.damping * np.sqrt(squares))) @ shape.T
        critical = (shape * (2.0 * np.sqrt(squares))) @ shape.T
        scale = self._blocks(np.sqrt(np.tile(np.asarray(self.damping, np.float64), 2)), rotation)
        return scale @ critical @ scale

    def _six(self) -> Array:
        return np.concatenate(
            [np.broadcast_to(np.asarray(k, np.float64), 3) for k in (self.linear, self.angular)]
        )

    def _blocks(self, six: Array, rotation: Array) -> Array:
        """A diagonal (6,) in the frame as a matrix in the world's axes."""
        axes, both = self._axes(rotation), np.zeros((6, 6))
        both[:3, :3] = (axes * six[:3]) @ axes.T
        both[3:, 3:] = (axes * six[3:]) @ axes.T
        return both

    def _axes(self, rotation: Array) -> Array:
        if self.frame == "world":
            return np.eye(3)
        if self.frame == "tool":
            return rotation
        return Pose((0.0, 0.0, 0.0), self.frame).rotation()


FIRM = CartesianStiffness()
SOFT = CartesianStiffness(linear=400.0, angular=20.0, damping=1.0)
