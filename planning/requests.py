"""What can be asked of the planner and what it answers, as values."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias, get_args

from ..world.trajectory import Trajectory
from ..world.values import Array, Bounds, ObjectId, Pose, Vector3

Direction: TypeAlias = Literal["out", "back", "up", "inwards", "left", "right", "outwards", "down"]
"""`out`: where the depths shrink fastest; `back`: against the tool; `inwards`, `outwards`: towards the axis
of the base and away from it; `left`, `right`: about that axis."""
DIRECTIONS: tuple[Direction, ...] = get_args(Direction)


BUDGET = 20000
"""Collision checks that a request may spend unless it says otherwise."""


@dataclass(frozen=True, slots=True)
class NamedGoal:
    """A named configuration of the robot file."""

    name: str


@dataclass(frozen=True, slots=True, eq=False)
class JointGoal:
    """A configuration (n,), rad."""

    position: Array


@dataclass(frozen=True, slots=True)
class PoseGoal:
    """The TCP at any of these poses in the world; several IK solutions of each are goals at once."""

    tcp_in_world: tuple[Pose, ...]


@dataclass(frozen=True, slots=True)
class RegionGoal:
    """The TCP near a pose in the world: turned, tilted and moved within limits. Near ones are tried first."""

    tcp_in_world: Pose
    yaw: float = 0.0
    """Greatest turn about the pose's own z axis, either way, rad; pi: free."""
    tilt: float = 0.0
    """Half of the opening of a cone about the pose's z axis in which the TCP's z axis lies, rad."""
    reach: Vector3 = (0.0, 0.0, 0.0)
    """Greatest distance of the TCP from the pose along each of the pose's axes, either way, m."""


@dataclass(frozen=True, slots=True)
class LineGoal:
    """The TCP straight to a pose, keeping or interpolating its orientation (slerp)."""

    tcp_in_world: Pose
    least_fraction: float = 1.0
    """A line that is free for less than this share is a failure."""


@dataclass(frozen=True, slots=True)
class OffsetGoal:
    """The TCP straight by `by` (3,) m in the world, orientation kept."""

    by: Vector3
    least_fraction: float = 1.0


Goal: TypeAlias = NamedGoal | JointGoal | PoseGoal | RegionGoal
Target: TypeAlias = Goal | LineGoal | OffsetGoal


@dataclass(frozen=True, slots=True)
class UprightConstraint:
    """On the whole way an axis of the tool points up in the world, within a tilt.

    With the axis (0, 0, -1) the hand looks down: so a full glass is carried that was grasped from above.
    """

    tilt: float
    """Greatest angle between the axis and the vertical, rad."""
    axis: Vector3 = (0.0, 0.0, -1.0)
    """In the TCP's frame; any length."""


@dataclass(frozen=True, slots=True)
class BoxConstraint:
    """On the whole way the TCP stays in a box of the world."""

    box: Bounds


Constraint: TypeAlias = UprightConstraint | BoxConstraint


@dataclass(frozen=True, slots=True)
class HeldObject:
    """Suppose for this request that the gripper holds this object of the scene, at this pose in the TCP's
    frame, wherever it is believed to be now."""

    object: ObjectId
    object_in_tcp: Pose


@dataclass(frozen=True, slots=True)
class Scaling:
    """Shares (0, 1] of the joints' velocity and acceleration limits."""

    velocity: float = 1.0
    acceleration: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """One motion that is wanted, with everything that its answer depends on but the belief."""

    target: Target
    start: Array | None = None
    """Configuration (n,) rad; None: where the arm is."""
    width: float | None = None
    """Opening of the fingers, m; None: as it is."""
    holding: HeldObject | None = None
    """None: what the belief says is in the hand."""
    allowed: tuple[tuple[str, str], ...] = ()
    """Pairs of names that may touch on this motion, beside those that the scene allows now."""
    constraints: tuple[Constraint, ...] = ()
    """What must hold on the whole way, its ends included."""
    clearance: float = 0.0
    """Added to the margins that the motion keeps from what may not be touched, m."""
    scaling: Scaling = Scaling()
    budget: int = BUDGET
    """Collision checks that it may spend."""


@dataclass(frozen=True, slots=True, eq=False)
class MotionPlan:
    """An answer that can be executed. `path` (m, n) rad are the corners before time parameterisation."""

    trajectory: Trajectory
    path: Array
    planner: str
    """`direct`, `RRTConnect`, `line` or `chain`."""
    checks: int
    """Collision checks of configurations that were spent."""
    goal_index: int = 0
    """Which of the goal's poses was reached."""
    fraction: float = 1.0
    """Of a straight line: the share that is free and reachable."""
    passes: tuple[float, ...] = ()
    """Of a chain: when the trajectory passes the end of each leg, s."""
    legs: tuple[MotionPlan, ...] = ()
    """Of a chain: the plan of each leg by itself, from rest to rest."""
    request: Request | None = None
    """What it was planned for, its start filled in; a chain's legs have one each."""
    version: int = 0
    """Of the belief that it was planned in."""


@dataclass(frozen=True, slots=True)
class ContactPair:
    """A pair of bodies that touch or come closer than the margin: names and distance (negative: depth), m."""

    a: str
    b: str
    distance: float
    point: Vector3 = field(default=(0.0, 0.0, 0.0))
    margin: float = 0.0
    """What the two should keep between them, m, where that is known."""
