"""Commands of a controller, and the protocol that every controller implements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, TypeAlias

from ..world.values import Array, JointState


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
