"""Numbers in sentences: what a joint is at, by how much it is beyond a limit."""

from __future__ import annotations

from math import degrees

from ...robots.model import LIMIT_RESERVE, RobotModel
from ...world.values import Array
from ..kinematics.levenberg_marquardt import is_hinge
from ..kinematics.unreachable_poses import Nearest


def amount(model: RobotModel, joint: int, value: float) -> str:
    """A joint's position or a part of it: in deg, of one that slides in mm."""
    if is_hinge(model.arm.joints[joint + 1]):
        return f"{degrees(value):.1f} deg"
    return f"{value * 1000:.1f} mm"


def beyond_limits(model: RobotModel, q: Array) -> list[str]:
    """Of each joint that is beyond its limit at q (n,): where it is, by how much, and the limit."""
    told: list[str] = []
    for joint, (name, at) in enumerate(zip(model.description.joints, q.tolist(), strict=True)):
        low, high = float(model.lower[joint]), float(model.upper[joint])
        if not low <= at <= high:
            limit = low if at < low else high
            told.append(
                f"{name} at {amount(model, joint, at)} is {amount(model, joint, abs(at - limit))} beyond its "
                f"limit of {amount(model, joint, limit)}"
            )
    return told


def missing(model: RobotModel, nearest: Nearest) -> str:
    """What keeps the arm from a pose, in words that go on after `out of reach:`."""
    match nearest.obstacle:
        case "position":
            return f"the tool ends {nearest.distance * 1000:.0f} mm short of it"
        case "orientation":
            return f"the tool gets there, but not turned so: {degrees(nearest.angle):.1f} deg are missing"
        case "limits":
            worst = max(nearest.beyond, key=lambda one: abs(one.wanted - one.limit))
            joint = model.description.joints.index(worst.joint)
            over = abs(worst.wanted - worst.limit) - LIMIT_RESERVE
            low = worst.wanted < worst.limit
            limit = amount(model, joint, float(model.lower[joint] if low else model.upper[joint]))
            if over <= 0:
                kept = amount(model, joint, LIMIT_RESERVE)
                return f"{worst.joint} would come nearer to its limit of {limit} than the {kept} to keep"
            return f"{worst.joint} would have to go {amount(model, joint, over)} beyond its limit of {limit}"
        case _:
            return "the search for a configuration found none, though there is one"
