"""Compliant motion: reference pose (anchor) of a compliant tool, set in each control period, and its
stiffness.

A guarded move is one: a straight line that ends at a given contact force.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from picktree.world import Array, Pose, Quaternion, Vector3

Frame: TypeAlias = Literal["world", "tool"] | Quaternion
"""Axes of a stiffness: the world's, those of the turning TCP, or of a frame with this orientation in the
world."""
MIN_DAMPED_STIFFNESS = (200.0, 5.0)
"""Least stiffness for which an axis is damped, N/m and Nm/rad."""
MAX_DAMPING_SHARE = 0.6
"""Greatest damping of a mode in one control period, as a share of the mode's inertia.

Damping d, 1/s, sampled with the period h and one period of delay is stable for h·d < 1. A light wrist has
modes of little inertia: a spring that is right for a heavy one would shake it.
"""


@dataclass(frozen=True, slots=True)
class CartesianStiffness:
    """Stiffness of the spring between tool and anchor, N/m and Nm/rad, and its damping ratio.

    Each is one number, or one for each axis of `frame`. An axis without stiffness follows the motion's wrench
    alone. An axis softer than `MIN_DAMPED_STIFFNESS` is damped as if it had that stiffness.
    """

    linear: float | Vector3 = 1500.0
    angular: float | Vector3 = 40.0
    damping: float | Vector3 = 0.9
    """Damping ratio along and about each axis."""
    frame: Frame = "world"

    def along(self, direction: Array, rotation: Array) -> float:
        """Return the stiffness against a shift along a unit vector (3,) of the world, N/m.

        `rotation` (3, 3): tool in the world.
        """
        in_frame = self._axes(rotation).T @ direction
        return float((np.broadcast_to(self.linear, 3) * in_frame) @ in_frame)

    def matrix(self, rotation: Array) -> Array:
        """Return the stiffness (6, 6) in world axes; `rotation` (3, 3): tool in the world."""
        return self._blocks(self._six(), rotation)

    def sampled(self, inertia: Array, rotation: Array, period: float) -> tuple[Array, Array]:
        """Return stiffness and damping (6, 6) for a tool with `inertia` (6, 6), all in world axes.

        N/m, Nm/rad, N·s/m and Nm·s/rad. Modes of the tool on its spring that would be too fast for the
        control `period`, s, are softer. Double diagonalisation of stiffness and inertia (Albu-Schäffer et
        al., "Cartesian impedance control of redundant robots", ICRA 2003). Damping ratios that differ scale
        its axes.
        """
        spring = self.matrix(rotation)
        damped = self._blocks(np.maximum(self._six(), np.repeat(MIN_DAMPED_STIFFNESS, 3)), rotation)
        lower = np.linalg.cholesky(inertia)
        inverse = np.linalg.inv(lower)
        fastest = MAX_DAMPING_SHARE / (2.0 * float(np.max(self.damping)) * period)
        squares, modes = np.linalg.eigh(inverse @ damped @ inverse.T)
        if squares[-1] > fastest**2:
            squares = np.minimum(squares, fastest**2)
            soft, turned = np.linalg.eigh(inverse @ spring @ inverse.T)
            shape = lower @ turned
            spring = (shape * np.clip(soft, 0.0, fastest**2)) @ shape.T
        shape = lower @ modes
        if isinstance(self.damping, float | int):
            return spring, (shape * (2.0 * self.damping * np.sqrt(squares))) @ shape.T
        critical = (shape * (2.0 * np.sqrt(squares))) @ shape.T
        scale = self._blocks(np.sqrt(np.tile(np.asarray(self.damping, np.float64), 2)), rotation)
        return spring, scale @ critical @ scale

    def _six(self) -> Array:
        return np.concatenate(
            [np.broadcast_to(np.asarray(k, np.float64), 3) for k in (self.linear, self.angular)]
        )

    def _blocks(self, six: Array, rotation: Array) -> Array:
        """Return a diagonal (6,) of the frame as a matrix (6, 6) in world axes."""
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


FIRM_STIFFNESS = CartesianStiffness()
REST_TIME = 0.05
REST_TRAVEL = 1.2e-4
"""Time, s, and travel of the tool in it, m, below which the tool is at rest; the travel exceeds the encoders'
noise."""


@dataclass(frozen=True, slots=True, eq=False)
class ContactState:
    """State of the tool in one control period: time, external wrench, pose."""

    elapsed: float
    """Time since the motion began, s."""
    period: float
    """Time since the last step, s."""
    force: Array
    """External force (3,) on the hand beyond its reading without contact, N in the world; mean of the last
    readings."""
    torque: Array
    """External torque (3,) about the TCP, likewise, Nm."""
    position: Array
    """Position (3,) of the TCP in the world by the encoders, m."""
    rotation: Array
    """Rotation (3, 3) of the tool in the world."""


class CompliantMotion:
    """Motion for `ArmMotion.comply`. Subclasses override `step`, which sets the anchor in each period.

    `step` may move the anchor's `position` (3,) and `rotation` (3, 3) in the world. It may set their rates:
    `velocity` and `acceleration` (3,), `spin` (3,) rad/s, all zero by default. The tool exerts `wrench`
    (6,) in addition to the spring, N and Nm, world axes, about the TCP. Along an axis without stiffness that
    is force control. `finished` ends the motion.

    `origin` (3,) and `turn` (3, 3) are the tool's pose where the motion began.
    """

    damping = 1.0
    """Damping with which an arm that takes positions meets contacts, as a multiple of its usual one."""

    def __init__(self) -> None:
        self.finished = False
        """Whether the motion has ended; the anchor then stays."""
        self.peak = 0.0
        """Greatest contact force so far, N."""
        self._recent: deque[tuple[float, float, float, float]] = deque()

    def start(self, position: Array, rotation: Array) -> None:
        """Take the tool's initial pose, so that the motion begins with zero error. Called once."""
        self.origin, self.turn = position, rotation
        self.position: Array = position.copy()
        self.rotation: Array = rotation.copy()
        self.velocity: Array = np.zeros(3)
        self.acceleration: Array = np.zeros(3)
        self.spin: Array = np.zeros(3)
        self.wrench: Array = np.zeros(6)

    def step(self, felt: ContactState) -> None:
        """Set the anchor for one control period."""

    def advance(self, felt: ContactState) -> None:
        """Advance by one control period; called by the controller."""
        self.peak = max(self.peak, float(np.sqrt(felt.force @ felt.force)))
        if self.finished:
            x, y, z = felt.position.tolist()
            self._recent.append((felt.elapsed, x, y, z))
            while felt.elapsed - self._recent[0][0] > REST_TIME:
                self._recent.popleft()
        else:
            self.step(felt)

    @property
    def standing(self) -> bool:
        """Whether the motion is finished and the tool has stopped."""
        recent = self._recent
        if not recent or recent[-1][0] - recent[0][0] < 0.8 * REST_TIME:
            return False
        return all(max(way) - min(way) < REST_TRAVEL for way in list(zip(*recent, strict=True))[1:])

    @property
    def direction(self) -> Array:
        """Unit vector (3,) along which the anchor moves, or zero. Along it, joints near their limits slow the
        anchor down."""
        return np.zeros(3)

    def limit(self, speed: float) -> None:
        """Limit the speed along `direction` to `speed` m/s: the joints cannot follow a faster anchor."""


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
    zero: Array
    """Wrist wrench (6,) without a contact, N and Nm."""


class GuardedMove(CompliantMotion):
    """Straight motion along a unit vector (3,) until `force` N act against it or the distance is done.

    At the contact the anchor moves back to the tool, plus the offset that presses with `press` N. So the
    spring keeps no other tension.
    """

    damping = 4.0  # closed fingers meet metal: 3·10⁴ N/m with the arm's servo, and the force is late

    def __init__(
        self, direction: Array, distance: float, *, force: float, speed: float, press: float, stiffness: float
    ) -> None:
        """`stiffness`: stiffness of the spring along the direction, N/m."""
        super().__init__()
        self._direction = direction
        self._distance = distance
        self._force = force
        self._speed = self._max_speed = speed
        self._lead = press / stiffness
        self._rate = 0.0
        self._travelled = 0.0
        self.contact = False
        self.pushed = 0.0
        """Contact force against the direction, N: at the contact, else the greatest so far."""

    @property
    def direction(self) -> Array:
        return self._direction

    def limit(self, speed: float) -> None:
        self._max_speed = min(speed, self._speed)

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
        left = self._distance - self._travelled
        step = GUARDED_MOVE_ACCELERATION * felt.period
        before = self._rate
        wanted = min(self._max_speed, max(step, (2 * GUARDED_MOVE_ACCELERATION * left) ** 0.5))
        self._rate = min(max(wanted, self._rate - 2 * step), self._rate + step)
        self._travelled = min(self._travelled + self._rate * felt.period, self._distance)
        self.position = self.origin + self._direction * self._travelled
        if self._travelled >= self._distance:
            self.finished = True
            self.velocity = self.acceleration = np.zeros(3)
        else:
            self.velocity = self._direction * self._rate
            self.acceleration = self._direction * ((self._rate - before) / felt.period)
