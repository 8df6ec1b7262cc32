"""What can be asked of the planner and what it answers, as values."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

from ..trajectory import Trajectory
from ..values import Array, Pose, Vector3


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


Goal: TypeAlias = NamedGoal | JointGoal | PoseGoal


@dataclass(frozen=True, slots=True)
class Scaling:
    """Shares (0, 1] of the joints' velocity and acceleration limits."""

    velocity: float = 1.0
    acceleration: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """An answer that can be executed. `path` (m, n) rad are the corners before time parameterisation."""

    trajectory: Trajectory
    path: Array
    planner: str
    """`direct`, `RRTConnect` or `line`."""
    checks: int
    """Collision checks of configurations that were spent."""
    goal_index: int = 0
    """Which of the goal's poses was reached."""
    fraction: float = 1.0
    """Of a straight line: the share that is free and reachable."""


@dataclass(frozen=True, slots=True)
class Line:
    """The TCP straight to a pose, keeping or interpolating its orientation (slerp)."""

    tcp_in_world: Pose
    least_fraction: float = 1.0
    """A line that is free for less than this share is a failure."""


@dataclass(frozen=True, slots=True)
class Offset:
    """The TCP straight by `by` (3,) m in the world, orientation kept."""

    by: Vector3
    least_fraction: float = 1.0


@dataclass(frozen=True, slots=True)
class Contact:
    """A pair of bodies that touch or come closer than the margin: names and distance (negative: depth), m."""

    a: str
    b: str
    distance: float
    point: Vector3 = field(default=(0.0, 0.0, 0.0))
