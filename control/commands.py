"""What a controller may command, and what every controller can do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, TypeAlias

from ..world.values import Array, JointState


@dataclass(frozen=True, slots=True, eq=False)
class JointCommand:
    """Where the stiff servo shall be at the end of the period: (n,) rad, (n,) rad/s."""

    position: Array
    velocity: Array


@dataclass(frozen=True, slots=True, eq=False)
class TorqueCommand:
    """Joint torques (n,) Nm, gravity included."""

    torque: Array


Command: TypeAlias = JointCommand | TorqueCommand


class Controller(Protocol):
    """Answers each control period with a command. One instance serves one motion."""

    name: ClassVar[str]
    """Name in `/control` records and messages, each controller's own. A renamed class keeps it: logs and the
    digest contain it."""

    @property
    def done(self) -> bool:
        """Nothing is left to do: from now on its last joint command may simply be held."""
        ...

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        """Called once, before the first update. `setpoint`: what the servo was told last; after a torque
        command, what the encoders say. Starting there starts without a step."""
        ...

    def update(self, now: float, state: JointState) -> Command: ...

    def brake(self) -> Controller:
        """Who brings this motion to rest: this controller itself or another, which is then started."""
        ...
