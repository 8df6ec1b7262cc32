"""Joint limits: joints beyond their soft limits, by how much, and values of joints in words."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, tau
from typing import TYPE_CHECKING

from picktree.world import Array

if TYPE_CHECKING:
    import pinocchio as pin

    from .model import RobotModel

DEGREES_HINT = "degrees? Numbers without a unit are in rad"
"""Question about a hinge that is more than a turn beyond its limit."""


def is_hinge(joint: pin.JointModel) -> bool:
    """Whether the joint turns (else it slides): pinocchio has a type for each axis."""
    name = joint.shortname()
    return "Prismatic" not in name and not name.startswith("JointModelP")


def format_joint_value(model: RobotModel, joint: int, value: float) -> str:
    """Format a joint's position or a part of it: in deg, for a slider in mm."""
    return _words(value, hinge=is_hinge(model.arm.joints[joint + 1]))


@dataclass(frozen=True, slots=True)
class JointExcess:
    """Excess of one joint over its soft limit; rad, for a slider m."""

    joint: str
    position: float
    limit: float
    """Limit that the joint is beyond."""
    hinge: bool

    @property
    def size(self) -> float:
        """Distance to the limit, rad; for a slider m."""
        return abs(self.position - self.limit)

    @property
    def more_than_a_turn(self) -> bool:
        """Whether a hinge is beyond its limit by more than 2π: the value was probably meant in degrees."""
        return self.hinge and self.size > tau

    def __str__(self) -> str:
        position, size, limit = (
            _words(value, hinge=self.hinge) for value in (self.position, self.size, self.limit)
        )
        return f"{self.joint} at {position} is {size} beyond its limit of {limit}"


def joint_excesses(model: RobotModel, q: Array, tolerance: float = 0.0) -> tuple[JointExcess, ...]:
    """Return the joints that q (n,) has beyond their soft limits by more than `tolerance` rad, in order."""
    found: list[JointExcess] = []
    for k, (name, at) in enumerate(zip(model.description.joints, q.tolist(), strict=True)):
        low, high = float(model.lower[k]), float(model.upper[k])
        if not low - tolerance <= at <= high + tolerance:
            hinge = is_hinge(model.arm.joints[k + 1])
            found.append(JointExcess(name, at, low if at < low else high, hinge))
    return tuple(found)


def _words(value: float, *, hinge: bool) -> str:
    return f"{degrees(value):.1f} deg" if hinge else f"{value * 1000:.1f} mm"
