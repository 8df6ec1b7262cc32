"""Execution of a push stroke: checks, planning, motion beside the object and along with it, and away from
it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...world.belief.planning_scene import BeliefObject
from ...world.planar_geometry import PlanarOutline, PlanarPose, moved, outline, outline_distance, planar
from ...world.robot_model.description import tool_outline
from ...world.scene.description import Fixture
from ...world.shapes import Box, bottom, top
from ...world.values import Array, ObjectId, Pose
from ..control.compliant_motion import CartesianStiffness
from ..planning.requests import JointGoal, LineGoal, NamedGoal, OffsetGoal, PoseGoal, Request
from .push_arcs import height
from .replanning import follow_with_replanning
from .stroke_course import PushMotion
from .stroke_planning import PushStroke

if TYPE_CHECKING:
    from ..control.trajectory_motion import Doing
    from ..planning.solver import RequestSolver
    from ..world import World

PUSH_STIFFNESS = CartesianStiffness(linear=1500.0, angular=60.0)
SUPPORT_EDGE_MARGIN = 0.015
"""Distance of the pushed object from the edge of its support, m. The tool stays above the support."""
PUSH_CLEARANCE = 0.004
"""Clearance of the pushed object, m, to which `CLEARANCE_SIGMAS` standard deviations of its place are
added."""
CLEARANCE_SIGMAS = 2.0
POSE_CHECK_STEP = 0.02
"""Distance between two checked poses of a stroke, m."""
MAX_JOINT_STEP = 0.5
"""Greatest change of a joint between two of them, rad."""
JOINT_LIMIT_MARGIN = 0.1
"""Distance of the joints from their limits, rad. A compliant arm deviates from its plan."""
LOOKING_POSE = "home"
"""Named pose from which cameras see the table."""
STEP_BACK_HEIGHT = 0.10
"""Height of the lift beside the object after a stroke, m."""
STROKE_SPARE_TIME = 6.0
"""Time that a stroke may take beyond its nominal duration, s."""


@dataclass(frozen=True, slots=True, eq=False)
class FeasibleStroke:
    """Stroke that is free of collisions: rotation and height of the tool, and configuration (n,) above its
    start, rad."""

    stroke: PushStroke
    flipped: bool
    height: float
    over: Array
    opening: float


@dataclass(frozen=True, slots=True)
class PushResult:
    """Measured result of a stroke."""

    touched: bool
    in_contact: bool
    """Whether the contact lasted to the end."""
    blocked: bool
    lost: bool
    reached: float
    """Travel of the carrier, m."""
    force: float
    """Greatest force on the tool, N."""
    ends: PlanarPose
    """Pose of the object if it has stayed at the tool."""

    @property
    def told(self) -> str:
        way = f"{self.reached * 1000:.0f} mm"
        if self.blocked:
            return f"blocked at {self.force:.1f} N after {way}"
        if self.lost:
            return f"contact lost after {way}"
        if not self.touched:
            return f"nothing was felt on {way}"
        return f"pushed for {way}"


def support_of(world: World, belief: BeliefObject) -> Fixture | None:
    """Return the level fixture that supports an object. None: the object is in a bin, or on no fixture."""
    low = bottom(belief.shape, belief.pose)
    x, y, _ = belief.pose.position
    found = [
        f
        for f in world.scene.fixtures.values()
        if isinstance(f.shape, Box)
        and abs(float(f.pose.rotation()[2, 2])) > 0.999
        and abs(top(f.shape, f.pose) - low) < 0.03
        and within(f, np.array([[x, y]]), 0.0)
    ]
    in_bin = belief.place in world.scene.bins
    return None if in_bin else max(found, key=lambda f: top(f.shape, f.pose), default=None)


def within(fixture: Fixture, points: Array, margin: float) -> bool:
    """Return whether points (n, 2) of the world are over a level box, at least `margin` m from its edges."""
    assert isinstance(fixture.shape, Box)
    there = planar(fixture.shape, fixture.pose).inverse().apply(points)
    half = np.array(fixture.shape.size[:2]) / 2 - margin
    return bool((np.abs(there) <= half).all())


def placed(shape: PlanarOutline, at: PlanarPose) -> Array:
    """Return points (n, 2) in the world on the border of an outline."""
    if shape.round:
        ring = np.arange(16) * (2 * math.pi / 16)
        return np.stack([np.cos(ring), np.sin(ring)], axis=1) * shape.radius + (at.x, at.y)
    return at.apply(shape.corners)


def pose_refusal(
    world: World, belief: BeliefObject, places: Sequence[PlanarPose], touching: Collection[str] = ()
) -> str | None:
    """Return why the object must not be at one of these places. None: it may.

    `touching`: objects that may be pushed along.
    """
    support = support_of(world, belief)
    if support is None:
        return f"{belief.id} does not stand on a level fixture"
    shape = outline(belief.shape, belief.pose)
    margin = PUSH_CLEARANCE + CLEARANCE_SIGMAS * belief.sigma_position
    others = [o for o in world.scene.objects if o.id != belief.id and o.id not in touching and not o.attached]
    around = [(o.id, outline(o.shape, o.pose), planar(o.shape, o.pose)) for o in others]
    ignore = (belief.id, support.id, *(o.id for o in world.scene.objects))
    for at in places:
        if not within(support, placed(shape, at), SUPPORT_EDGE_MARGIN):
            return f"it would come to the edge of {support.id}"
        for hole in support.holes:
            middle = (support.pose @ hole.pose).position
            free = at.distance(PlanarPose(middle[0], middle[1])) - shape.reach
            if free < math.hypot(*hole.size) / 2 + hole.chamfer:
                return f"it would come over {hole.id}"
        hit = next(
            (name for name, other, there in around if outline_distance(shape, at, other, there) < margin),
            None,
        )
        if hit is None:
            there = moved(belief.shape, belief.pose, at)
            hit = next((c.b for c in world.queries.free(belief.shape, there, ignore, margin)), None)
        if hit is not None:
            return f"it would touch {hit}"
    return None


def stroke_refusal(world: World, belief: BeliefObject, stroke: PushStroke) -> str | None:
    """Return why the object, or the tool, must not follow the stroke. None: they may."""
    why = pose_refusal(world, belief, [stroke.object_at(way) for way in samples(0.0, stroke.way.length)])
    support = support_of(world, belief)
    if why is not None or support is None:
        return why
    fingers = tool_outline(world.robot.description.gripper, stroke.side.opening)
    for way in samples(-stroke.gap, stroke.way.length):
        at = stroke.way.at(way) @ stroke.side.tool
        if not all(within(support, at.apply(finger.corners), 0.0) for finger in fingers):
            return f"the tool would leave {support.id}"
    return None


def plan_stroke(
    world: World, belief: BeliefObject, stroke: PushStroke, touching: Collection[str] = ()
) -> FeasibleStroke | str:
    """Return the stroke as the arm can execute it, or why it cannot. Costs are added to the thinking
    account."""
    opening = stroke.side.opening
    tip = world.robot.fingers.reach(opening)
    level = height(belief, world.robot.description.gripper, tip)
    why = "the arm does not reach it"
    answers: list[tuple[float, FeasibleStroke]] = []
    ways = samples(-stroke.gap, stroke.way.length)
    for flipped in (False, True):
        poses = [stroke.tcp_at(way, level, flipped) for way in ways]
        found = configuration_above_start(world, poses, opening, (belief.id, *touching))
        if isinstance(found, str):
            why = found
        else:
            travel = float(np.abs(found - world.control.held_position).max())
            answers.append((travel, FeasibleStroke(stroke, flipped, level, found, opening)))
    return min(answers, key=lambda a: a[0])[1] if answers else why


def configuration_above_start(
    world: World,
    poses: Sequence[Pose],
    opening: float,
    touching: Collection[str],
    *,
    rise: float | None = None,
    beside: Collection[str] = (),
) -> Array | str:
    """Return the configuration (n,) above the first of a stroke's TCP poses from which the arm can follow
    them, or why there is none.

    `rise`: height above that pose, m; without it that of a pre-grasp.
    `touching`: names that the gripper may touch after the start; `beside`: before it, too, because something
    finer than the belief's shapes shows that it fits there. The search begins at the middle of the path.
    There the arm has a comfortable configuration, and the change along the path is shared between both ends.
    """
    start, middle = poses[0], len(poses) // 2
    pairs = tuple(("gripper", name) for name in touching)
    pushing = Request(PoseGoal((poses[middle],)), None, opening, allowed=pairs)
    found = world.plan.reached(pushing)
    if found.q is None:
        return f"on the way {found.why_not}"
    with world.plan.checking():
        solver = world.plan.solver
        solver.look(pushing)
        first = _chain(solver, found.q, poses[middle + 1 :])
        back = first if isinstance(first, str) else _chain(solver, found.q, poses[middle - 1 : 0 : -1])
        if isinstance(back, str):
            return f"on the way {back}"
        pairs = tuple(("gripper", name) for name in beside)
        solver.look(Request(PoseGoal((start,)), None, opening, allowed=pairs))
        there = _chain(solver, back, [start])
        if isinstance(there, str):
            return f"beside it {there}"
        solver.look(Request(PoseGoal((start,)), None, opening))
        over = start.shifted((0.0, 0.0, world.handling.approach if rise is None else rise))
        above = _chain(solver, there, [over])
    return f"above it {above}" if isinstance(above, str) else above


def _chain(solver: RequestSolver, q: Array, poses: Sequence[Pose]) -> Array | str:
    """Return the last configuration (n,) of a continuous, free chain through all poses, or the obstacle.

    All joints stay away from their limits.
    """
    model = solver.model
    for pose in poses:
        near, q_next = q, solver.ik.descend(pose, q)
        if q_next is None:
            return "the arm does not reach"
        q = q_next
        if float(np.abs(q - near).max()) > MAX_JOINT_STEP:
            return "the arm would have to swing round"
        if float(np.minimum(q - model.lower, model.upper - q).min()) < JOINT_LIMIT_MARGIN:
            return "a joint would come to its limit"
        if not solver.collision.free(q):
            touched = next(iter(solver.collision.contacts(q)), None)
            if touched is None:
                return "the tool leaves the workspace"
            return f"{touched.a} would touch {touched.b}"
    return q


def samples(start: float, end: float) -> Sequence[float]:
    """Return the places along a stroke at which its poses are checked, ends included, m."""
    count = max(2, math.ceil((end - start) / POSE_CHECK_STEP) + 1)
    return [start + (end - start) * k / (count - 1) for k in range(count)]


def execute_stroke(
    world: World,
    belief: BeliefObject,
    one: FeasibleStroke,
    speed: float,
    force: float,
    node: str,
    along: Mapping[ObjectId, PlanarPose] | None = None,
) -> Doing[PushResult]:
    """Execute a stroke; the tool ends beside the object, and the belief is updated to the expected pose.

    `along`: expected poses of the objects that are pushed along. Failures: planning.*, control.*, safety.*,
    world.disturbed.
    """
    stroke = one.stroke
    start = stroke.tcp_at(-stroke.gap, one.height, one.flipped)
    yield from move_to_start(world, one.over, start, one.opening, node)
    course = PushMotion(
        stroke.way,
        stroke.side.tool,
        stroke.gap,
        speed,
        force,
        world.robot.hand_mass,
        rolls=stroke.side.rolls,
    )
    along = {} if along is None else along
    force = yield from follow_course(world, course, (belief.id, *along), node)
    touched = course.touched_at is not None
    ends = stroke.side.object(course.carrier)
    pushed = PushResult(touched, course.in_contact, course.blocked, course.lost, course.reached, force, ends)
    if stroke.side.rolls or (touched and not course.lost):
        for name, at in {**along, belief.id: ends}.items():
            _believe(world, name, at)
    return pushed


def move_to_start(
    world: World, over: Array, start: Pose, opening: float, node: str, beside: Collection[str] = ()
) -> Doing[None]:
    """Move the tool with its fingers at `opening` m to a configuration `over` (n,) the start, and down to it.

    `beside`: as for `configuration_above_start`.
    """
    handling = world.handling
    pairs = tuple(("gripper", name) for name in beside)
    world.gripper.start(opening)
    widest, narrowest = world.gripper.span(opening)
    legs = (
        Request(JointGoal(over), width=widest, narrowest=narrowest, scaling=handling.scaling(1.0)),
        Request(LineGoal(start), width=opening, allowed=pairs, scaling=handling.slowly),
    )
    yield from follow_with_replanning(
        world, lambda: world.plan.through(legs, node=node), guard=handling.guard, node=node
    )
    if abs(world.gripper.width - opening) > 0.002:
        yield from world.gripper.move(opening, world.robot.description.gripper.max_force)


def follow_course(
    world: World,
    course: PushMotion,
    touching: Collection[str],
    node: str,
    stiffness: CartesianStiffness = PUSH_STIFFNESS,
) -> Doing[float]:
    """Move the tool along a stroke's course, and return the greatest force on it, N. `touching`: names that
    it may touch."""
    limit = course.longest + STROKE_SPARE_TIME
    with world.scene.allow(*(("gripper", str(name)) for name in touching)):
        result = yield from world.move.comply(course, limit, stiffness=stiffness, node=node)
    return result.force


def _believe(world: World, name: ObjectId, at: PlanarPose) -> None:
    known = world.scene.find(name)
    if known is not None:
        pose = moved(known.shape, known.pose, at)
        sigma = max(known.sigma_position, 0.002)
        world.scene.put(replace(known, pose=pose, sigma_position=sigma), "pushed there")


def step_back(world: World, names: Collection[str], node: str, rise: float = STEP_BACK_HEIGHT) -> Doing[None]:
    """Move up by `rise` m beside the object and to where the cameras see the table."""
    handling = world.handling
    near = world.queries.hand_contacts(world.control.tcp, world.gripper.width, margin=0.02)
    fixed = {*world.scene.fixtures, *world.scene.bins}
    touched = {*names, *(c.b for c in near if c.b not in fixed)}
    pairs = tuple(("gripper", name) for name in sorted(touched))
    walls = tuple(("gripper", c.b) for c in near if c.b in world.scene.bins)
    legs = (
        Request(
            OffsetGoal((0.0, 0.0, rise), least_fraction=0.3),
            allowed=(*pairs, *walls),
            scaling=handling.slowly,
        ),
        Request(NamedGoal(LOOKING_POSE), allowed=pairs, scaling=handling.scaling(1.0)),
    )
    yield from follow_with_replanning(
        world, lambda: world.plan.through(legs, node=node), guard=handling.guard, node=node
    )


def go_looking(world: World, node: str) -> Doing[None]:
    """Move to where the arm does not hide the table from the cameras."""
    goal, scaling = NamedGoal(LOOKING_POSE), world.handling.scaling(1.0)
    ask = lambda: world.plan.to(goal, scaling=scaling, node=node)  # noqa: E731
    yield from follow_with_replanning(world, ask, guard=world.handling.guard, node=node)
