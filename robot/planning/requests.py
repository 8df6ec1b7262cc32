"""Requests to the planner, their checks and overrides, and the planner's answers, as values."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import numpy as np

from picktree.files import PicktreeError
from picktree.world import (
    Array,
    Bounds,
    ObjectId,
    Pose,
    Vector3,
    planner_names,
)

if TYPE_CHECKING:
    from picktree.world.robot_model import RobotModel

Direction: TypeAlias = Literal["out", "back", "up", "inwards", "left", "right", "outwards", "down"]
"""Direction of an escape path.

`out`: where the penetration depths shrink fastest. `back`: against the tool. `inwards`, `outwards`: towards
the axis of the base and away from it. `left`, `right`: about that axis.
"""


DIRECTIONS: tuple[Direction, ...] = get_args(Direction)


DEFAULT_CHECK_BUDGET = 20000
"""Collision checks that a request may spend by default."""


WIDTH_TOLERANCE = 0.002
"""Change of the fingers' opening that makes no difference, m."""


@dataclass(frozen=True, slots=True)
class NamedGoal:
    """Named configuration of the robot file."""

    name: str


@dataclass(frozen=True, slots=True, eq=False)
class JointGoal:
    """Configuration (n,), rad."""

    position: Array


@dataclass(frozen=True, slots=True)
class PoseGoal:
    """TCP at any of these poses in the world; several IK solutions of each pose are goals of one search."""

    tcp_in_world: tuple[Pose, ...]


@dataclass(frozen=True, slots=True)
class RegionGoal:
    """TCP near a pose in the world: turned, tilted and moved within limits. Near ones are tried first."""

    tcp_in_world: Pose
    yaw: float = 0.0
    """Greatest turn about the pose's own z axis, either way, rad; pi: free."""
    tilt: float = 0.0
    """Half opening of the cone about the pose's z axis in which the TCP's z axis lies, rad."""
    reach: Vector3 = (0.0, 0.0, 0.0)
    """Greatest distance of the TCP from the pose along each of the pose's axes, either way, m."""


@dataclass(frozen=True, slots=True)
class LineGoal:
    """Straight motion of the TCP to a pose; its orientation is kept or interpolated (slerp)."""

    tcp_in_world: Pose
    least_fraction: float = 1.0
    """Least share of the line that must be free, 0 … 1. Less is a failure."""


@dataclass(frozen=True, slots=True)
class OffsetGoal:
    """Straight motion of the TCP by `by` (3,) m in the world, orientation kept."""

    by: Vector3
    least_fraction: float = 1.0


Goal: TypeAlias = NamedGoal | JointGoal | PoseGoal | RegionGoal


Target: TypeAlias = Goal | LineGoal | OffsetGoal


@dataclass(frozen=True, slots=True)
class UprightConstraint:
    """Path constraint: an axis of the tool points up in the world, within a tilt.

    With the axis (0, 0, -1) the hand points down: a full glass that was grasped from above is carried level.
    """

    tilt: float
    """Greatest angle between the axis and the vertical, rad."""
    axis: Vector3 = (0.0, 0.0, -1.0)
    """Axis in the TCP's frame; any length."""


@dataclass(frozen=True, slots=True)
class BoxConstraint:
    """Path constraint: the TCP stays in a box of the world."""

    box: Bounds


Constraint: TypeAlias = UprightConstraint | BoxConstraint


@dataclass(frozen=True, slots=True)
class HeldObject:
    """Supposition of a request that the gripper holds an object of the scene, wherever it is believed to be.

    `object_in_tcp` is the object's pose in the TCP's frame.
    """

    object: ObjectId
    object_in_tcp: Pose


CARRYING_ACCELERATION = 9.0
"""Greatest acceleration of the TCP with something in the hand, m/s²: fingers press for no more than that."""


@dataclass(frozen=True, slots=True)
class Scaling:
    """Shares (0, 1] of the joints' velocity and acceleration limits, and the greatest acceleration of the
    tool, m/s²."""

    velocity: float = 1.0
    acceleration: float = 1.0
    tool: float = math.inf
    """Acceleration of the tool; with something in the hand never more than `CARRYING_ACCELERATION`."""


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """Motion request: everything that its answer depends on but the belief."""

    target: Target
    start: Array | None = None
    """Start configuration (n,), rad; None: that of the arm."""
    width: float | None = None
    """Opening of the fingers, m; None: the present one."""
    holding: HeldObject | None = None
    """Supposed held object; None: the held object of the belief."""
    allowed: tuple[tuple[str, str], ...] = ()
    """Pairs of names that may touch on this motion, in addition to those that the scene allows."""
    constraints: tuple[Constraint, ...] = ()
    """Constraints on the whole path, its ends included."""
    clearance: float = 0.0
    """Addition to the margins that the motion keeps from forbidden contacts, m."""
    scaling: Scaling = Scaling()
    budget: int = DEFAULT_CHECK_BUDGET
    """Collision checks that the request may spend."""
    planner: str = ""
    """Name of the planner, see `world/planner_names.py`; empty: that of `PlanWith`, scene or robot."""
    narrowest: float | None = None
    """Narrowest opening during a motion of the fingers on the way, m; `width` is the widest. None: the
    fingers do not move."""


@dataclass(frozen=True, slots=True)
class PlannerOverrides:
    """Overrides of requests to the planner; the defaults change nothing."""

    seed: int = 0
    """Seed of other random numbers; 0: the usual ones."""
    budget: float = 1.0
    """Factor on the collision checks that a request may spend."""
    clearance: float = 0.0
    """Addition to the clearance of free motions, m. A straight line goes close to bodies on purpose."""
    planner: str = ""
    """Name of the planner; empty: the usual one."""

    def __and__(self, inner: PlannerOverrides) -> PlannerOverrides:
        """Combine two overrides, the other within this one."""
        seed = inner.seed or self.seed
        planner = inner.planner or self.planner
        return PlannerOverrides(seed, self.budget * inner.budget, self.clearance + inner.clearance, planner)

    def of(self, request: Request) -> Request:
        """Return the request with the overrides applied."""
        if self.budget == 1.0 and not self.clearance and not self.planner:
            return request
        budget = max(1, round(request.budget * self.budget))
        straight = isinstance(request.target, LineGoal | OffsetGoal)
        clearance = request.clearance + (0.0 if straight else self.clearance)
        planner = request.planner or self.planner
        return replace(request, budget=budget, clearance=clearance, planner=planner)

    def stream(self, name: str) -> str:
        """Return the stream of random numbers that replaces the one of that name."""
        return f"{name} seed {self.seed}" if self.seed else name


def check_request(model: RobotModel, request: Request) -> None:
    """Raise PicktreeError for an invalid request, with problem and remedy."""
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
    if request.planner and not planner_names.is_planner(request.planner):
        raise PicktreeError(
            f"{planner_names.unknown_planner(request.planner)}: "
            f"{planner_names.suggest_planner(request.planner)}"
        )
    shares = (request.scaling.velocity, request.scaling.acceleration)
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
