"""Planning failures: their sentences and their evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees

import numpy as np

from ...world.causes import Failure, planning
from ...world.robot_model.joint_limits import DEGREES_HINT, format_joint_value, joint_excesses
from ...world.robot_model.model import LIMIT_RESERVE, RobotModel
from ...world.values import Array, Pose, Vector3, WorkspaceExcess
from .cartesian_lines import LineResult, interpolate_pose
from .inverse_kinematics import InverseKinematics
from .obstructions import BlockingBodies, Enclosure, GoalRejection
from .path_constraints import ConstraintViolation
from .requests import (
    BoxConstraint,
    ContactPair,
    JointGoal,
    LineGoal,
    NamedGoal,
    OffsetGoal,
    PoseGoal,
    RegionGoal,
    Request,
    Target,
    UprightConstraint,
)
from .unreachable_poses import NearestReach


def describe_shortfall(model: RobotModel, nearest: NearestReach) -> str:
    """Describe what keeps the arm from a pose, in words that go on after `out of reach:`."""
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
            limit = format_joint_value(model, joint, float(model.lower[joint] if low else model.upper[joint]))
            if over <= 0:
                kept = format_joint_value(model, joint, LIMIT_RESERVE)
                return f"{worst.joint} would come nearer to its limit of {limit} than the {kept} to keep"
            excess = format_joint_value(model, joint, over)
            return f"{worst.joint} would have to go {excess} beyond its limit of {limit}"
        case _:
            return "the search for a configuration found none, though there is one"


@dataclass(frozen=True, slots=True)
class LineStopPoint:
    """Point where a line stopped: TCP in the world, m, contacts, joint at its limit."""

    point: Vector3
    contacts: tuple[ContactPair, ...] = ()
    joint: str = ""
    singular: float | None = None


def describe_goal(target: Target) -> str:
    """Describe the goal in a few words, for the record."""
    match target:
        case NamedGoal(name):
            return f"to {name}"
        case JointGoal():
            return "to a configuration"
        case LineGoal(pose):
            return f"straight to {_point(pose.position)}"
        case OffsetGoal(by):
            return f"straight by {_point(by)}"
        case RegionGoal(pose):
            return f"near {_point(pose.position)}"
        case PoseGoal():
            poses = target.tcp_in_world
            more = f" or {len(poses) - 1} other poses" if len(poses) > 1 else ""
            return f"to {_point(poses[0].position)}{more}" if poses else "to no pose"


def describe_request(request: Request) -> str:
    """Describe the goal with constraints and clearance."""
    words = [describe_goal(request.target)]
    for constraint in request.constraints:
        match constraint:
            case UprightConstraint(tilt):
                words.append(f"upright within {degrees(tilt):.0f} deg")
            case BoxConstraint():
                words.append("within a box")
    if request.clearance > 0:
        words.append(f"{request.clearance * 1000:.0f} mm clear")
    return ", ".join(words)


def contact_lines(contacts: Sequence[ContactPair]) -> list[str]:
    """Format contacts as evidence: one line each, the first ten."""
    return [f"{c.a} {how_near(c)} {c.b}{_kept(c)}" for c in contacts[:10]]


def _kept(contact: ContactPair) -> str:
    """Format the margin, where only the margin is violated."""
    return f" ({contact.margin * 1000:.1f} mm to keep)" if 0 <= contact.distance < contact.margin else ""


def outside_limits(model: RobotModel, q: Array) -> Failure:
    """Build the failure of a requested configuration with joints beyond their limits."""
    excesses = joint_excesses(model, q)
    beyond = [str(one) for one in excesses]
    more = f" (and {len(beyond) - 1} more)" if len(beyond) > 1 else ""
    hint = f"; {DEGREES_HINT}" if any(one.more_than_a_turn for one in excesses) else ""
    return Failure(
        planning.NO_IK,
        f"the configuration lies outside the joint limits: {beyond[0]}{more}{hint}",
        configuration=q.tolist(),
        joints=beyond,
    )


def out_of_reach(model: RobotModel, poses: Sequence[Pose], solves: int, nearest: NearestReach) -> Failure:
    """Build the failure of poses out of reach; `nearest` belongs to the first pose."""
    count = len(poses)
    begun = "the pose is out of reach" if count == 1 else f"all {count} poses are out of reach, the first one"
    return Failure(
        planning.NO_IK,
        f"{begun}: {describe_shortfall(model, nearest)}",
        poses=count,
        descents=solves,
        first=list(poses[0].position),
        obstacle=nearest.obstacle,
        short=nearest.distance,
        turned=nearest.angle,
        joints=[one.joint for one in nearest.beyond],
        at_limit=list(nearest.at_limit),
        configuration=nearest.q.tolist(),
    )


def outside_workspace(where: str, outside: WorkspaceExcess, poses: int = 1) -> Failure:
    """Build the failure of a tool outside the workspace; `where`: as `at the goal`."""
    return Failure(
        planning.WORKSPACE,
        f"{where} the tool is {how_outside(outside)}",
        point=list(outside.at),
        axis=outside.axis,
        by=outside.by,
        poses=poses,
    )


def goal_rejected(each: Sequence[GoalRejection], poses: int) -> Failure:
    """Build the failure of a goal whose configurations were all rejected; `each` has one rejection for each.

    The sentence names the least bad one.
    """
    best = "" if len(each) == 1 else f" (the best of {len(each)} solutions)"
    rejected = [f"{k + 1}: {how_rejected(one)}" for k, one in enumerate(each[:10])]
    touching = [one for one in each if one.contacts]
    least = max(touching, key=lambda one: one.contacts[0].distance, default=each[0])
    if not touching and least.outside is not None:
        return outside_workspace("at the goal", least.outside, poses)
    return Failure(
        planning.GOAL_IN_COLLISION,
        f"at the goal {how_rejected(least)}{best}",
        pairs=contact_lines(least.contacts),
        depth=-least.contacts[0].distance if least.contacts else 0.0,
        solutions=len(each),
        poses=poses,
        rejected=rejected,
        configuration=least.q.tolist(),
    )


def how_rejected(rejection: GoalRejection, verb: str = "is") -> str:
    """Describe a rejection, beginning with what is wrong."""
    if rejection.contacts:
        worst = rejection.contacts[0]
        return f"{worst.a} {verb} {how_near(worst)} {worst.b}{_kept(worst)}"
    if rejection.outside is not None:
        return f"the tool {verb} {how_outside(rejection.outside)}"
    if rejection.broken:
        return how_broken(rejection.broken[0])
    # Two libraries measure a margin: at its very edge one may see a contact that the other does not.
    return "the arm is at the very edge of its margin to something"


def how_outside(outside: WorkspaceExcess) -> str:
    """Describe the excess, with the axis."""
    if outside.by <= 0:
        return f"only {-outside.by * 1000:.1f} mm from the edge of the workspace ({outside.side})"
    return f"{outside.by * 1000:.1f} mm outside of the workspace ({outside.side})"


def constraint_violated(where: str, broken: Sequence[ConstraintViolation]) -> Failure:
    """Build the failure of violated constraints; `where` begins the sentence, as `at the goal`."""
    return Failure(
        planning.CONSTRAINT, f"{where} {how_broken(broken[0])}", constraints=[how_broken(b) for b in broken]
    )


def line_breaks(broken: Sequence[ConstraintViolation], fraction: float) -> Failure:
    """Build the failure of a line that violates a constraint at `fraction` of its time."""
    return Failure(
        planning.CONSTRAINT,
        f"on the line, at {fraction:.0%} of its time, {how_broken(broken[0])}",
        constraints=[how_broken(b) for b in broken],
        fraction=fraction,
    )


def how_broken(broken: ConstraintViolation) -> str:
    """Describe a violation, with the actual and the allowed value."""
    match broken.constraint:
        case UprightConstraint(tilt):
            return f"the tool tilts by {degrees(broken.is_at):.1f} deg, {degrees(tilt):.1f} deg are allowed"
        case BoxConstraint():
            return f"the tool is {broken.by * 1000:.1f} mm outside of the box that it must stay in"


def not_found(
    spent: int,
    budget: int,
    goals: Sequence[Array],
    excused: Sequence[ContactPair],
    between: BlockingBodies,
    enclosed: Enclosure | None,
) -> Failure:
    """Build the failure of a search without a path; `spent` counts its checks and projections.

    The obstructions were searched for afterwards.
    """
    used_up = spent >= budget
    sentence = (
        f"no path within {budget} collision checks"
        if used_up
        else "every path that was found comes too close to something when it is timed"
    )
    if enclosed is not None:
        by = f" by {join_words(enclosed.blocked.pairs[:4])}" if enclosed.blocked.pairs else ""
        sentence += f": the {enclosed.where} seems enclosed{by}, a search from there gets no further than "
        sentence += f"{degrees(enclosed.radius):.0f} deg"
    elif between.pairs:
        are = "is" if len(between.pairs) == 1 else "are"
        sentence += f": in the way of the straight motion {are} {join_words(between.pairs[:3])}"
    return Failure(
        planning.BUDGET if used_up and enclosed is None else planning.NO_PATH,
        sentence,
        checks=spent,
        goals=len(goals),
        configuration=goals[0].tolist(),
        excused=contact_lines(excused),
        in_the_way=list(between.by),
        enclosed="" if enclosed is None else enclosed.where,
        enclosed_by=[] if enclosed is None else list(enclosed.blocked.by),
        gets=None if enclosed is None else enclosed.radius,
    )


def line_ended(found: LineResult, least: float, length: float, why: str, at: LineStopPoint) -> Failure:
    """Build the failure of a line that ended early; `why`: its end in words; `length`: of the whole line,
    m."""
    where = f" (after {found.fraction * length * 1000:.0f} of {length * 1000:.0f} mm)" if length > 0 else ""
    return Failure(
        planning.NO_PATH,
        f"only {found.fraction:.0%} of the line is free{where}, {least:.0%} are asked for: {why}",
        fraction=found.fraction,
        ended_by=found.ended_by,
        at=list(at.point),
        pairs=contact_lines(at.contacts),
        joint=at.joint,
        singular=at.singular,
        configuration=(found.path[-1] if found.blocked is None else found.blocked).tolist(),
    )


def line_grazes(fraction: float, contacts: Sequence[ContactPair] = ()) -> Failure:
    """Build the failure of a free line whose timing is not free, with the contacts of its first sample that
    is not."""
    why = f": {contacts[0].a} would be {how_near(contacts[0])} {contacts[0].b}" if contacts else ""
    return Failure(
        planning.NO_PATH,
        f"the timed line comes too close to something{why}",
        fraction=fraction,
        ended_by="timing",
        pairs=contact_lines(contacts),
    )


def how_near(contact: ContactPair) -> str:
    """Describe the distance, to go between the two names."""
    depth = -contact.distance * 1000
    return f"{depth:.1f} mm deep in" if depth > 0 else f"only {-depth:.1f} mm from"


def join_words(names: Sequence[str]) -> str:
    """Join names as `a, b and c`."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _point(point: Sequence[float]) -> str:
    return "(" + ", ".join(f"{c:.3f}" for c in point) + ")"


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
