"""Commands of a controller, the protocol that every controller implements, and results of motions under
joint impedance.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol, TypeAlias, TypeVar

from picktree.world import Array, Failure, JointState, Vector3

T = TypeVar("T")
Doing: TypeAlias = Generator[None, None, T]
"""Motion as a generator: each yield is one tick, the return is its result."""


@dataclass(frozen=True, slots=True, eq=False)
class JointCommand:
    """Set-point of the stiff servo for the end of the period: position (n,) rad and velocity (n,) rad/s."""

    position: Array
    velocity: Array


@dataclass(frozen=True, slots=True, eq=False)
class TorqueCommand:
    """Joint torques (n,) Nm, gravity included."""

    torque: Array


Command: TypeAlias = JointCommand | TorqueCommand


class Controller(Protocol):
    """Source of commands for one motion: one command for each control period."""

    name: ClassVar[str]
    """Name in `/control` records and messages, each controller's own. A renamed class keeps it: logs and the
    digest contain it."""

    @property
    def done(self) -> bool:
        """Whether the motion has ended. The loop may simply hold the last joint command from then on."""
        ...

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        """Prepare the first update; called once. `setpoint`: last command of the servo, or after a torque
        command the encoder reading. A motion that starts there starts without a step."""
        ...

    def update(self, now: float, state: JointState) -> Command: ...

    def brake(self) -> Controller:
        """Return the controller that brings this motion to rest: this one, or another that is then
        started."""
        ...


@dataclass(frozen=True, slots=True)
class ContactThresholds:
    """Thresholds of a contact, beyond the readings without one."""

    torque: float
    """External torque of all joints, Euclidean norm, Nm. It shows contacts at any part of the arm."""
    force: float
    """Force at the wrist, N."""


@dataclass(frozen=True, slots=True)
class JointImpedanceResult:
    """Result of a joint-impedance motion, at rest."""

    completed: bool
    progress: float
    """Followed part of the trajectory, s."""
    touched: bool
    """Whether the arm touched something, gave way to it and came to rest."""
    torque: float
    """Greatest external torque, Nm."""
    force: float
    """Greatest force at the wrist, N."""
    push: Vector3 = (0.0, 0.0, 0.0)
    """Contact force on the hand, N in the world; zero for a contact at another part."""
    noticed: Failure | None = None
    """Failure from `watch` that stopped the motion; None without one."""


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
