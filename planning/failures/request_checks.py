"""Request checks: senseless requests are reported as bad input before planning, not as failures."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np

from ...errors import PicktreeError
from ...robots.model import RobotModel
from ..requests import (
    JointGoal,
    LineGoal,
    OffsetGoal,
    PoseGoal,
    RegionGoal,
    Request,
    Target,
    UprightConstraint,
)


def check_request(model: RobotModel, request: Request) -> None:
    """Raise PicktreeError for a senseless request, with what is wrong and what would be right."""
    _configuration(model, "the start", request.start)
    if isinstance(request.target, JointGoal):
        _configuration(model, "the goal", request.target.position)
    if not all(np.isfinite(_numbers(request.target))):
        raise PicktreeError("the goal has numbers that are not finite")
    for constraint in request.constraints:
        if isinstance(constraint, UprightConstraint):
            if not any(constraint.axis) or not 0 <= constraint.tilt <= np.pi:
                raise PicktreeError("upright: needs an axis that is not zero, and a tilt of 0 to 180 deg")
        elif any(low > high for low, high in zip(constraint.box.min, constraint.box.max, strict=True)):
            raise PicktreeError("within: the box must not have its least corner beyond its greatest one")
    if request.clearance < 0:
        raise PicktreeError(f"a clearance of {request.clearance * 1000:g} mm: it must not be negative")
    if request.budget < 1:
        raise PicktreeError(f"a budget of {request.budget} checks: at least one is needed")
    shares = astuple(request.scaling)
    if not all(0 < share <= 1 for share in shares):
        raise PicktreeError(f"a scaling of {shares[0]:g} and {shares[1]:g}: both must be above 0, at most 1")


def _configuration(model: RobotModel, what: str, q: object) -> None:
    if q is None:
        return
    numbers = np.asarray(q, dtype=np.float64)
    if numbers.shape != (model.n,):
        raise PicktreeError(
            f"{what} has {numbers.size} numbers, {model.description.name} has {model.n} joints"
        )
    if not np.isfinite(numbers).all():
        raise PicktreeError(f"{what} has numbers that are not finite")


def _numbers(target: Target) -> list[float]:
    match target:
        case PoseGoal(poses):
            return [number for pose in poses for number in (*pose.position, *pose.orientation)]
        case RegionGoal(pose, yaw, tilt, reach):
            if min(yaw, tilt, *reach) < 0:
                raise PicktreeError("a region's turn, tilt and reach must not be negative")
            return [*pose.position, *pose.orientation, yaw, tilt, *reach]
        case LineGoal(pose):
            return [*pose.position, *pose.orientation]
        case OffsetGoal(by):
            return list(by)
        case _:
            return []
