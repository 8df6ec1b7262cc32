"""Requests to the planner and its answers, as values."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias, get_args

from ..world.causes import Cause, Evidence, Failure
from ..world.trajectory import Trajectory
from ..world.values import Array, Bounds, ObjectId, Pose, Vector3

Direction: TypeAlias = Literal["out", "back", "up", "inwards", "left", "right", "outwards", "down"]
"""Direction of an escape path.

`out`: where the penetration depths shrink fastest. `back`: against the tool. `inwards`, `outwards`: towards
the axis of the base and away from it. `left`, `right`: about that axis.
"""
DIRECTIONS: tuple[Direction, ...] = get_args(Direction)


DEFAULT_CHECK_BUDGET = 20000
"""Collision checks that a request may spend by default."""


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
    """TCP at any of these poses in the world; several IK solutions of each are goals at once."""

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


@dataclass(frozen=True, slots=True)
class Scaling:
    """Shares (0, 1] of the joints' velocity and acceleration limits."""

    velocity: float = 1.0
    acceleration: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """Motion request: everything that its answer depends on but the belief."""

    target: Target
    start: Array | None = None
    """Start configuration (n,), rad; None: that of the arm."""
    width: float | None = None
    """Opening of the fingers, m; None: the present one."""
    holding: HeldObject | None = None
    """Supposed held object; None: the one that the belief has in the hand."""
    allowed: tuple[tuple[str, str], ...] = ()
    """Pairs of names that may touch on this motion, in addition to those that the scene allows."""
    constraints: tuple[Constraint, ...] = ()
    """Constraints on the whole path, its ends included."""
    clearance: float = 0.0
    """Addition to the margins that the motion keeps from forbidden contacts, m."""
    scaling: Scaling = Scaling()
    budget: int = DEFAULT_CHECK_BUDGET
    """Collision checks that the request may spend."""


@dataclass(frozen=True, slots=True, eq=False)
class MotionPlan:
    """Executable motion plan. `path` (m, n) rad has the corners before time parameterisation."""

    trajectory: Trajectory
    path: Array
    planner: str
    """Planner that found it: `direct`, `RRTConnect`, `CBiRRT`, `line` or `chain`."""
    checks: int
    """Number of spent collision checks of configurations."""
    goal_index: int = 0
    """Index of the goal's pose that was reached."""
    fraction: float = 1.0
    """Share of a straight line that is free and reachable, 0 … 1."""
    passes: tuple[float, ...] = ()
    """Times at which a chain's trajectory passes the end of each leg, s; () without a chain."""
    legs: tuple[MotionPlan, ...] = ()
    """Plans of a chain's legs, each from rest to rest; () without a chain."""
    request: Request | None = None
    """Request that was planned for, with its start filled in. The legs of a chain have one each."""
    version: int = 0
    """Belief version that was planned in."""


@dataclass(frozen=True, slots=True)
class ContactPair:
    """Pair of bodies that touch or come closer than the margin: names and distance (negative: depth), m."""

    a: str
    b: str
    distance: float
    point: Vector3 = field(default=(0.0, 0.0, 0.0))
    margin: float = 0.0
    """Margin between the two, m; 0 where it is not known."""


class LegFailure(Failure):
    """Planning failure of one leg of a motion chain."""

    def __init__(self, cause: Cause, message: str, leg: int, evidence: Evidence) -> None:
        """`leg`: index of the leg, from 0. It is part of the evidence, too."""
        super().__init__(cause, message, **{**evidence, "leg": leg})
        self.leg = leg
