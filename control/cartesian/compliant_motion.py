"""Where the anchor of a compliant tool goes, decided in each control period by what is felt."""

from __future__ import annotations

from collections import deque
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
