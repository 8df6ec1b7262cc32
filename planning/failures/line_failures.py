"""Line failures: the joint, singularity or shortfall that ended a straight line other than by a collision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...robots.model import RobotModel
from ...world.values import Array, Pose
from ..kinematics.cartesian_lines import LineResult, interpolate_pose
from ..kinematics.inverse_kinematics import InverseKinematics
from .planning_failures import describe_shortfall, format_joint_value

LIMIT_TOLERANCE = 0.002
"""Distance to the planned limit within which a joint counts as being at it, rad."""
MIN_SINGULAR_VALUE = 0.03
"""Smallest singular value of the Jacobian below which the arm is in a singularity."""


@dataclass(frozen=True, slots=True)
class LineStop:
    """Reason in words, with the joint at its limit (or empty) and the smallest singular value there."""

    why: str
    joint: str
    singular: float


def explain_line_stop(
    model: RobotModel, ik: InverseKinematics, found: LineResult, tcp_in_world: Pose
) -> LineStop:
    """Explain why a line towards that pose ended, where no collision ended it."""
    last = found.path[-1]
    singular = float(np.linalg.svd(model.jacobian(last), compute_uv=False)[-1])
    stands = _at_limit(model, last)
    if stands is not None:
        joint, limit = stands
        name = model.description.joints[joint]
        return LineStop(
            f"{name} is at its limit of {format_joint_value(model, joint, limit)}", name, singular
        )
    if singular < MIN_SINGULAR_VALUE:
        how = "stretched out or folded, in" if found.ended_by == "reach" else "near"
        why = f"the arm is {how} a singularity (smallest singular value {singular:.3f})"
        return LineStop(why, "", singular)
    if found.ended_by == "jump":
        return LineStop("the arm would have to swing round", "", singular)
    begin = model.tcp(found.path[0])
    nearest = ik.nearest(interpolate_pose(begin, tcp_in_world, min(1.0, found.fraction + 0.02)), last)
    if not nearest.obstacle:
        return LineStop("the arm cannot reach further without another posture", "", singular)
    return LineStop(f"the arm cannot reach further: {describe_shortfall(model, nearest)}", "", singular)


def _at_limit(model: RobotModel, q: Array) -> tuple[int, float] | None:
    """Return the joint at its planned limit, and the limit beyond, rad or m; None: no joint is."""
    low, high = q - model.planned_lower, model.planned_upper - q
    room = np.minimum(low, high)
    joint = int(np.argmin(room))
    if room[joint] > LIMIT_TOLERANCE:
        return None
    return joint, float(model.lower[joint] if low[joint] <= high[joint] else model.upper[joint])
