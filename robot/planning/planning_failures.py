"""Planning failures: their sentences and their evidence.

Obstructions explain why no path was found, and why a configuration that reaches the goal is invalid.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees

import numpy as np

from picktree.world import Array, Bounds, Failure, Pose, Vector3, WorkspaceExcess, planning, workspace_excess
from picktree.world.robot_model import (
    DEGREES_HINT,
    LIMIT_RESERVE,
    RobotModel,
    format_joint_value,
    joint_excesses,
)

from .cartesian_lines import LineResult, interpolate_pose
from .collision_checker import CollisionChecker
from .inverse_kinematics import InverseKinematics, NearestReach
from .limits import WORKSPACE_MARGIN, StartExcess
from .motion_plans import ContactPair
from .path_constraints import ConstraintViolation, PathConstraints
from .requests import (
    BoxConstraint,
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
from .trajectory_check import EDGE_RESOLUTION, StartTolerance

MAX_EXTENSIONS = 240
"""Number of extensions of a local search."""
MAX_EXTENSION = 0.3
"""Greatest extension of a local search, rad."""
EXTENSION_STEP = 0.06
"""Step between two configurations of an extension, rad."""
ESCAPED_DISTANCE = 1.0
"""Distance from its root at which a local search counts as having left, rad."""
SEARCH_CHECK_BUDGET = 2500
"""Collision checks that a local search may spend."""
CONSTRAINT_NAME = "the constraint"
"""Name among the blocking bodies for configurations that a constraint forbids."""
MAX_EXAMINED = 40
"""Greatest number of blocked configurations that are examined."""


@dataclass(frozen=True, slots=True)
class BlockingBodies:
    """Obstructing bodies by frequency, the most frequent first; links of the robot among them."""

    by: tuple[str, ...] = ()
    pairs: tuple[str, ...] = ()
    """Each of these bodies with the part that touches it most often, as `panda_hand at wall`."""
    share: float = 0.0
    """Share of the examined configurations that the first body blocks, 0 … 1."""


@dataclass(frozen=True, slots=True)
class Enclosure:
    """Local search from `where` (`start` or `goal`) that never came farther than `radius` rad."""

    where: str
    radius: float
    blocked: BlockingBodies


class ObstructionSearch:
    """Obstructions of one request that found no path. Deterministic; its checks count as others do."""

    def __init__(
        self,
        model: RobotModel,
        collision: CollisionChecker,
        way: StartTolerance,
        constraints: PathConstraints,
    ) -> None:
        """Use `way` and `constraints` of the search that failed."""
        self._model = model
        self._collision = collision
        self._way = way
        self._constraints = constraints

    def between(self, start: Array, goals: Sequence[Array]) -> BlockingBodies:
        """Return the bodies that block the straight edges in joint space from start to the goals (the first
        three)."""
        hit: list[Array] = []
        for goal in goals[:3]:
            count = max(2, int(np.ceil(float(np.linalg.norm(goal - start)) / (2 * EDGE_RESOLUTION))))
            way = [start + (goal - start) * (k / count) for k in range(1, count)]
            hit += [q for q in way if not self._free(q)]
        return self._blocked(hit)

    def enclosure(self, where: str, root: Array) -> Enclosure | None:
        """Return the enclosure of a configuration; None when a search from it leads out, or when its checks
        are spent too early for a result.

        The search grows a tree towards random configurations.
        """
        rng = np.random.default_rng(0)
        lower = np.minimum(self._model.planned_lower, root)
        upper = np.maximum(self._model.planned_upper, root)
        tree = [root]
        hit: list[Array] = []
        end = self._collision.checks + SEARCH_CHECK_BUDGET
        for attempt in range(MAX_EXTENSIONS):
            if self._collision.checks >= end:
                return None
            # Paths out of narrow places begin with small moves: every second target is near.
            if attempt % 2:
                target = np.clip(root + rng.normal(0.0, MAX_EXTENSION, len(root)), lower, upper)
            else:
                target = rng.uniform(lower, upper)
            near = tree[int(np.argmin([float(np.linalg.norm(q - target)) for q in tree]))]
            along = target - near
            if not along.any():
                continue
            along = along * min(1.0, MAX_EXTENSION / float(np.linalg.norm(along)))
            steps = max(1, int(np.ceil(float(np.linalg.norm(along)) / EXTENSION_STEP)))
            reached = near
            for k in range(1, steps + 1):
                straight = near + along * (k / steps)
                q = self._constraints.project(straight, lower, upper)
                if q is None or float(np.abs(q - reached).max()) > MAX_EXTENSION or not self._free(q):
                    hit.append(straight if q is None else q)
                    break
                reached = q
            if reached is not near:
                tree.append(reached)
                if float(np.linalg.norm(reached - root)) > ESCAPED_DISTANCE:
                    return None
        radius = max(float(np.linalg.norm(q - root)) for q in tree)
        return Enclosure(where, radius, self._blocked(hit))

    def _free(self, q: Array) -> bool:
        return self._constraints.hold(q) and self._way.free(q)

    def _blocked(self, hit: Sequence[Array]) -> BlockingBodies:
        """Count the deepest contact of each of some of these configurations."""
        if not hit:
            return BlockingBodies()
        picked = np.unique(np.linspace(0, len(hit) - 1, min(len(hit), MAX_EXAMINED)).astype(int))
        names: Counter[str] = Counter()
        touching: dict[str, Counter[str]] = {}
        for k in picked:
            contacts = self._collision.contacts(hit[int(k)])
            if contacts:
                names.update((contacts[0].b,))
                touching.setdefault(contacts[0].b, Counter()).update((contacts[0].a,))
            elif not self._constraints.hold(hit[int(k)]):
                names.update((CONSTRAINT_NAME,))
        if not names:
            return BlockingBodies()
        by = tuple(name for name, _ in names.most_common())
        pairs = tuple(
            f"{touching[name].most_common(1)[0][0]} at {name}" if name in touching else name for name in by
        )
        return BlockingBodies(by, pairs, names.most_common(1)[0][1] / len(picked))


@dataclass(frozen=True, slots=True, eq=False)
class GoalRejection:
    """Reasons against one configuration. All empty: it is at the very edge of a margin, where it may not come
    nearer."""

    q: Array
    """Configuration (n,), rad."""
    contacts: tuple[ContactPair, ...] = ()
    """Pairs that are closer than their margin, the deepest first."""
    outside: WorkspaceExcess | None = None
    broken: tuple[ConstraintViolation, ...] = ()


class GoalInspection:
    """Reasons why configurations are not free. Slow: for explanations."""

    def __init__(
        self,
        model: RobotModel,
        collision: CollisionChecker,
        constraints: PathConstraints,
        workspace: Bounds | None,
    ) -> None:
        self._model = model
        self._collision = collision
        self._constraints = constraints
        self._workspace = workspace

    def rejection(self, q: Array) -> GoalRejection:
        """Return the reasons against q (n,)."""
        tool = self._model.tcp(q).position
        return GoalRejection(q, self._collision.contacts(q), self.outside(tool), self._constraints.broken(q))

    def outside(self, tool: Vector3) -> WorkspaceExcess | None:
        """Return how far a point in the world is outside the planned workspace; None: it is inside."""
        return None if self._workspace is None else workspace_excess(self._workspace, tool, WORKSPACE_MARGIN)


def describe_shortfall(model: RobotModel, nearest: NearestReach) -> str:
    """Describe the obstruction to a pose, in words that follow `out of reach:`."""
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
    return [f"{c.a} {how_near(c)} {c.b}{_format_margin(c)}" for c in contacts[:10]]


def _format_margin(contact: ContactPair) -> str:
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
    """Describe a rejection, beginning with the violation."""
    if rejection.contacts:
        worst = rejection.contacts[0]
        return f"{worst.a} {verb} {how_near(worst)} {worst.b}{_format_margin(worst)}"
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


def constraint_violated(where: str, broken: Sequence[ConstraintViolation], **evidence: float) -> Failure:
    """Build the failure of violated constraints; `where` begins the sentence, as `at the goal`."""
    words = [how_broken(one) for one in broken]
    return Failure(planning.CONSTRAINT, f"{where} {words[0]}", constraints=words, **evidence)


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
    *,
    searched: bool = True,
) -> Failure:
    """Build the failure of a search without a path; `spent` counts its checks and projections.

    The obstructions were searched for afterwards. Without `searched` the search ended early, and the failure
    names none.
    """
    if not searched:
        return Failure(
            planning.NO_PATH,
            "the planner found no path",
            checks=spent,
            goals=len(goals),
            configuration=goals[0].tolist(),
        )
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


MAX_NAMED_JOINTS = 3
"""Greatest number of joints that the sentence names."""


def start_in_collision(q: Array, contacts: Sequence[ContactPair], *, believed: bool = True) -> Failure:
    """Build the failure of a start in collision. `believed`: the start q (n,) is the arm's, not one that the
    request gave."""
    worst = contacts[0]
    return Failure(
        planning.START_IN_COLLISION,
        f"{_start(believed)} {worst.a} is {how_near(worst)} {worst.b}",
        pairs=contact_lines(contacts),
        depth=-worst.distance,
        configuration=q.tolist(),
    )


def start_outside(
    q: Array,
    excess: StartExcess,
    contacts: Sequence[ContactPair] = (),
    *,
    why: str = "",
    believed: bool = True,
) -> Failure:
    """Build the failure of a start q (n,) beyond soft limits or workspace, from which no motion leads back
    in.

    `contacts`: pairs in which the arm is stuck there; `why`: reason in words; `believed`: as in
    `start_in_collision`.
    """
    if excess.more_than_a_turn:
        why = DEGREES_HINT
    elif contacts:
        why = f"{contacts[0].a} is {how_near(contacts[0])} {contacts[0].b}"
    tool = excess.tool
    return Failure(
        planning.START_OUTSIDE,
        f"{_start(believed)} {describe_excess(excess)}{f'; {why}' if why else ''}",
        joints=[one.joint for one in excess.joints],
        beyond=[one.size for one in excess.joints],
        axis="" if tool is None else tool.axis,
        by=0.0 if tool is None else tool.by,
        pairs=contact_lines(contacts),
        depth=-contacts[0].distance if contacts else 0.0,
        configuration=q.tolist(),
    )


def no_way_back(between: BlockingBodies) -> str:
    """Describe that no motion leads back in; `between`: bodies in the way of the straight motions."""
    what = f": {join_words(between.pairs[:3])} in the way" if between.pairs else ""
    return f"no motion leads back in{what}"


def describe_excess(excess: StartExcess) -> str:
    """Describe the joints beyond their limits, and the side of the workspace that the tool is beyond."""
    words = [str(one) for one in excess.joints[:MAX_NAMED_JOINTS]]
    more = len(excess.joints) - MAX_NAMED_JOINTS
    if more > 0:
        words.append("1 more joint is beyond its limit" if more == 1 else f"{more} more are beyond theirs")
    if excess.tool is not None:
        words.append(f"the tool is {how_outside(excess.tool)}")
    return join_words(words)


def _start(believed: bool) -> str:
    return "where the arm is," if believed else "where the motion starts,"
