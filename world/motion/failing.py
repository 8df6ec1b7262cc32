"""Planning failures: their sentences and their evidence."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees

from ..causes import Failure, planning
from ..values import Array, Pose
from .constraints import Broken
from .lines import LineFound
from .requests import (
    Contact,
    JointGoal,
    Line,
    NamedGoal,
    Offset,
    PoseGoal,
    RegionGoal,
    Target,
    Upright,
    Within,
)

_WHY = {"reach": "the arm cannot reach further", "jump": "the arm would have to swing round"}


def described(target: Target) -> str:
    """What is asked for in a few words, for the record."""
    match target:
        case NamedGoal(name):
            return f"to {name}"
        case JointGoal():
            return "to a configuration"
        case Line(pose):
            return f"straight to {_point(pose.position)}"
        case Offset(by):
            return f"straight by {_point(by)}"
        case RegionGoal(pose):
            return f"near {_point(pose.position)}"
        case PoseGoal():
            poses = target.tcp_in_world
            more = f" or {len(poses) - 1} other poses" if len(poses) > 1 else ""
            return f"to {_point(poses[0].position)}{more}" if poses else "to no pose"


def listed(contacts: Sequence[Contact]) -> list[str]:
    """Contacts as evidence: one line each, the first ten."""
    return [f"{c.a} {_how_near(c)} {c.b}" for c in contacts[:10]]


def stuck(contacts: Sequence[Contact]) -> Failure:
    worst = contacts[0]
    return Failure(
        planning.START_IN_COLLISION,
        f"where the arm is, {worst.a} is {_how_near(worst)} {worst.b}",
        pairs=listed(contacts),
        depth=-worst.distance,
    )


def outside_limits(q: Array) -> Failure:
    return Failure(
        planning.NO_IK,
        "the configuration lies outside the joint limits",
        position=[float(x) for x in q],
    )


def out_of_reach(poses: Sequence[Pose], solves: int) -> Failure:
    count = len(poses)
    return Failure(
        planning.NO_IK,
        "the pose is out of reach" if count == 1 else f"all {count} poses are out of reach",
        poses=count,
        descents=solves,
        first=list(poses[0].position) if poses else None,
    )


def goal_in_collision(each: Sequence[Sequence[Contact]], poses: int) -> Failure:
    """`each`: the contacts of every solution that was found; the least bad one is told."""
    # Two libraries measure a margin: at its very edge one may see a contact that the other does not.
    unseen = (Contact("arm", "its surroundings", 0.0),)
    least = max((c for c in each if c), key=lambda c: c[0].distance, default=unseen)
    best = "" if len(each) == 1 else f" (the best of {len(each)} solutions)"
    return Failure(
        planning.GOAL_IN_COLLISION,
        f"at the goal {least[0].a} is {_how_near(least[0])} {least[0].b}{best}",
        pairs=listed(least),
        depth=-least[0].distance,
        solutions=len(each),
        poses=poses,
    )


def breaks(where: str, broken: Sequence[Broken]) -> Failure:
    """`where`: the beginning of the sentence, as `at the goal`."""
    return Failure(
        planning.CONSTRAINT, f"{where} {how_broken(broken[0])}", constraints=[how_broken(b) for b in broken]
    )


def line_breaks(broken: Sequence[Broken], fraction: float) -> Failure:
    """`fraction`: of the line's time, when it breaks a constraint."""
    return Failure(
        planning.CONSTRAINT,
        f"on the line, at {fraction:.0%} of its time, {how_broken(broken[0])}",
        constraints=[how_broken(b) for b in broken],
        fraction=fraction,
    )


def how_broken(broken: Broken) -> str:
    """In words, with what is and what may be."""
    match broken.constraint:
        case Upright(tilt):
            return f"the tool tilts by {degrees(broken.is_at):.1f} deg of {degrees(tilt):.1f} deg allowed"
        case Within():
            return f"the tool is {broken.by * 1000:.1f} mm outside of the box that it must stay in"


def not_found(checks: int, budget: int, goals: int, excused: Sequence[Contact]) -> Failure:
    spent = checks >= budget
    return Failure(
        planning.BUDGET if spent else planning.NO_PATH,
        f"no path within {budget} collision checks"
        if spent
        else "every path that was found comes too close to something when it is timed",
        checks=checks,
        goals=goals,
        excused=listed(excused),
    )


def line_ended(found: LineFound, least: float, contacts: Sequence[Contact]) -> Failure:
    why = _WHY.get(found.ended_by, "something is in the way")
    if contacts:
        why = f"{contacts[0].a} would be {_how_near(contacts[0])} {contacts[0].b}"
    return Failure(
        planning.NO_PATH,
        f"only {found.fraction:.0%} of the line is free, {least:.0%} are asked for: {why}",
        fraction=found.fraction,
        ended_by=found.ended_by,
        pairs=listed(contacts),
    )


def line_grazes(fraction: float) -> Failure:
    return Failure(
        planning.NO_PATH, "the timed line comes too close to something", fraction=fraction, ended_by="timing"
    )


def _how_near(contact: Contact) -> str:
    depth = -contact.distance * 1000
    return f"{depth:.1f} mm deep in" if depth > 0 else f"only {-depth:.1f} mm from"


def _point(point: Sequence[float]) -> str:
    return "(" + ", ".join(f"{c:.3f}" for c in point) + ")"
