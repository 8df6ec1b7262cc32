"""Plan quality: lengths, duration, clearance, distance to singularities and joint limits of a plan.

The cost of a plan, and its record in the journal, are here, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from picktree.world import Array, Failure, Plan, Trajectory
from picktree.world.robot_model import RobotModel

from . import planning_failures
from .collision_checker import CollisionChecker
from .motion_plans import ContactPair, MotionPlan
from .path_curves import polyline_length
from .requests import Request

QUALITY_STEP = 0.05
"""Greatest distance in joint space between two measured configurations, rad."""


@dataclass(slots=True)
class MeasuredCost:
    """Cost of a measured block, filled in when it ends: collision checks and simulated s."""

    checks: int = 0
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class NearestBody:
    """Nearest pair of bodies on a trajectory: names, distance in m, and time, s."""

    contact: ContactPair
    at: float


@dataclass(frozen=True, slots=True)
class JointMargin:
    """Joint that comes nearest to one of its limits: its distance (rad, m for a slider), and time, s."""

    joint: str
    room: float
    at: float


@dataclass(frozen=True, slots=True)
class PlanQuality:
    """Quality of a plan, measured along the timed trajectory every QUALITY_STEP."""

    length: float
    """Length in joint space, rad."""
    way: float
    """Travel of the TCP, m."""
    duration: float
    """Duration, s."""
    nearest: NearestBody | None
    """Nearest pair of robot (with the held object) and surroundings that may not touch; None: nothing within
    FAR."""
    itself: NearestBody | None
    """Nearest pair of the robot's own links (with the held object); None: nothing within FAR."""
    singular: float
    """Smallest singular value of the TCP's Jacobian (rows in m/rad and rad/rad). 0 where the arm cannot move
    the tool in some direction."""
    singular_at: float
    """Time of that singular value, s."""
    joint: JointMargin


def measure_quality(model: RobotModel, collision: CollisionChecker, trajectory: Trajectory) -> PlanQuality:
    """Measure a whole trajectory, in the scene of the checker's last update."""
    picked = list(_sampled_indices(trajectory))
    least = smallest_singular_values(model, trajectory.position[picked])
    worst = int(np.argmin(least))
    room = np.minimum(trajectory.position - model.lower, model.upper - trajectory.position)
    moment, joint = (int(k) for k in np.unravel_index(int(np.argmin(room)), room.shape))
    return PlanQuality(
        polyline_length(trajectory.position),
        polyline_length(model.tcp_positions(trajectory.position)),
        trajectory.duration,
        _nearest(collision, trajectory, picked, itself=False),
        _nearest(collision, trajectory, picked, itself=True),
        float(least[worst]),
        float(trajectory.times[picked[worst]]),
        JointMargin(
            model.description.joints[joint], float(room[moment, joint]), float(trajectory.times[moment])
        ),
    )


def _nearest(
    collision: CollisionChecker, trajectory: Trajectory, picked: Sequence[int], *, itself: bool
) -> NearestBody | None:
    nearest: NearestBody | None = None
    for k in picked:
        within = 0.5 if nearest is None else nearest.contact.distance  # m
        contact = collision.nearest(trajectory.position[k], within, itself=itself)
        if contact is not None:
            nearest = NearestBody(contact, float(trajectory.times[k]))
    return nearest


def smallest_singular_values(model: RobotModel, path: Array) -> Array:
    """Return the smallest singular value of the TCP's Jacobian at each configuration of a path (m, n)."""
    jacobians = np.array([model.jacobian(q) for q in path])
    return np.asarray(np.linalg.svd(jacobians, compute_uv=False), np.float64)[:, -1]


def combine_qualities(parts: Sequence[PlanQuality]) -> PlanQuality:
    """Combine the qualities of several motions in a row; times from the beginning of the first."""
    whole = parts[0]
    for part in parts[1:]:
        since = whole.duration
        worse = part.singular < whole.singular
        joint = part.joint if part.joint.room < whole.joint.room else whole.joint
        if joint is part.joint:
            joint = replace(joint, at=since + joint.at)
        whole = PlanQuality(
            whole.length + part.length,
            whole.way + part.way,
            since + part.duration,
            _nearer(whole.nearest, part.nearest, since),
            _nearer(whole.itself, part.itself, since),
            min(whole.singular, part.singular),
            since + part.singular_at if worse else whole.singular_at,
            joint,
        )
    return whole


def _nearer(a: NearestBody | None, b: NearestBody | None, since: float) -> NearestBody | None:
    if b is None or (a is not None and a.contact.distance <= b.contact.distance):
        return a
    return replace(b, at=since + b.at)


def _sampled_indices(trajectory: Trajectory) -> Iterator[int]:
    """Yield samples at most about QUALITY_STEP apart; the first and the last among them."""
    q = trajectory.position
    since = np.inf
    for k in range(len(q)):
        since += 0.0 if k == 0 else float(np.linalg.norm(q[k] - q[k - 1]))
        if since >= QUALITY_STEP or k == len(q) - 1:
            since = 0.0
            yield k


def plan_entry(
    model: RobotModel,
    legs: Sequence[Request],
    start: Array,
    spent: MeasuredCost,
    answer: MotionPlan | Failure,
    version: int,
) -> Plan:
    """Return the record of a plan, or of its failure, of these motions from `start` (n,) rad.

    `version` is that of the belief.
    """
    noted = Plan(
        ", then ".join(planning_failures.describe_request(leg) for leg in legs),
        "",
        spent.checks,
        spent.seconds,
        "found",
        "",
        0.0,
        start=tuple(start.tolist()),
        version=version,
    )
    if isinstance(answer, Failure):
        return replace(noted, outcome=answer.cause.name, message=answer.message)
    q = answer.trajectory.position
    picked = q[np.unique(np.linspace(0, len(q) - 1, min(len(q), 25)).astype(int))]
    tool_path = tuple((x, y, z) for x, y, z in model.tcp_positions(picked).tolist())
    return replace(
        noted,
        planner=answer.planner,
        duration=answer.trajectory.duration,
        path=tuple(tuple(one) for one in answer.path.tolist()),
        tool_path=tool_path,
        length=polyline_length(q),
        way=polyline_length(np.array(tool_path)),
        singular=float(smallest_singular_values(model, picked).min()),
    )
