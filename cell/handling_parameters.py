"""How carefully objects are handled: distances, forces and speeds that all skills share."""

from __future__ import annotations

from dataclasses import dataclass

from ..planning.requests import Scaling


@dataclass(frozen=True, slots=True)
class Handling:
    """Defaults for a table-top arm with a parallel gripper. m, N, m/s."""

    approach: float = 0.08
    """From the pre-grasp pose straight down to the grasp, and up again."""
    guard: float = 25.0
    """Contact force that stops a free motion."""
    touch: float = 4.0
    """Contact force that a guarded descent feels for."""
    touch_speed: float = 0.05
    felt_way: float = 0.010
    """Last bit of the way down that is felt for flat objects."""
    back_off: float = 0.001
    """Raised again by this much after having touched."""
    free: float = 0.9
    """Share of the joints' speed limits on free motions: the servo overshoots a little."""
    line: float = 0.5
    """Share of the joints' speed limits on straight lines next to objects."""
    lower_speed: float = 0.12
    """Of a guarded lowering with an object in the hand."""
    rim_clearance: float = 0.005
    """Of the finger tips above the rim of a bin, when an object is lowered into it."""
    release: float = 0.03
    """How much wider than the object the fingers open to release it."""

    def scaling(self, speed: float) -> Scaling:
        """For free motions at `speed`, a share (0, 1]."""
        return Scaling(velocity=self.free * speed, acceleration=speed)

    @property
    def slowly(self) -> Scaling:
        """For straight lines next to objects."""
        return Scaling(velocity=self.line, acceleration=self.line)
