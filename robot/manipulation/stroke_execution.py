"""Execution of a push stroke: checks, planning, motion beside the object and along with it, and away from it.

The motion along with the object is compliant, with contact sensing.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from picktree.robot.control import CartesianStiffness, CompliantMotion, ContactState
from picktree.robot.planning import JointGoal, LineGoal, NamedGoal, OffsetGoal, PoseGoal, Request
from picktree.world import Array, BeliefObject, Box, ObjectId, Pose, bottom, planar_geometry, top
from picktree.world.robot_model import tool_outline
from picktree.world.scene import Fixture

from .replanning import follow_with_replanning
from .stroke_planning import ArcPath, PushStroke, height

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing
    from picktree.robot.planning import RequestSolver

Phase: TypeAlias = Literal["pushing", "settling", "leaving", "left"]
PUSH_ACCELERATION = 0.4
"""Acceleration of the tool along its path, m/s². Friction decelerates an object far more, so that it stays at
the tool."""
CONTACT_BEGIN_FORCE, CONTACT_END_FORCE = 0.12, 0.04
"""Forces on the tool above which a contact begins, and below which it ends, N. 60 g on a table give 0.3 N;
the sensor's noise over `PUSH_FORCE_TIME_CONSTANT` is 0.03 N."""
PUSH_FORCE_TIME_CONSTANT = 0.08
"""Time constant of the force's mean, s."""
MAX_CONTACTLESS_TRAVEL = 0.008
"""Travel without contact after which the contact is lost, m."""
MAX_SLOW_LENGTH, SLOW_PUSH_SPEED = 0.010, 0.025
"""Length below which a path is slow, m, and its speed, m/s: sensing needs time."""
ROLLING_DECELERATION = 0.1
"""Deceleration before the end for an object that rolls, m/s²."""
ANCHOR_CORRECTION_RATE = 5.0
"""Rate at which the anchor corrects the spring's deflection, 1/s."""
MAX_ANCHOR_LEAD = 0.006
"""Greatest lead of the anchor, m."""
MAX_ARRIVAL_ERROR = 1.0e-4
"""Error of the tool at which it has arrived, m; `MAX_SETTLING_TIME` is the longest wait for that, s."""
MAX_SETTLING_TIME = 0.6
BACK_OFF_TRAVEL = 0.006
"""Distance of the final motion back from the object, m."""
VERTICAL_DRAG_STIFFNESS = 300.0
DRAG_STIFFNESS = CartesianStiffness(linear=(1500.0, 1500.0, VERTICAL_DRAG_STIFFNESS), angular=60.0)
"""Stiffness of a tool that drags things, and its vertical part, N/m."""
SINK_SPEED, MAX_SINK, SINK_FORCE = 0.03, 0.025, 2.0
"""Speed, m/s, and distance, m, of the descent onto things, and the force on the tool that ends it, N."""


class PushMotion(CompliantMotion):
    """Motion of the TCP whose carrier (see `PushSide`) follows `way`, beginning `gap` m before its start.

    It ends early when the force against the push exceeds `force` N, or when the contact is lost.
    """

    def __init__(
        self,
        way: ArcPath,
        tool: planar_geometry.PlanarPose,
        gap: float,
        speed: float,
        force: float,
        hand_mass: float,
        *,
        rolls: bool = False,
        through: bool = False,
    ) -> None:
        """`tool`: TCP in the carrier. `hand_mass`: mass whose inertia the wrist measures, kg. `rolls`: see
        `PushSide`. `through`: the stroke continues without contact, through a heap."""
        super().__init__()
        self._path, self._tool, self._gap = way, tool, gap
        if rolls or way.length < MAX_SLOW_LENGTH:
            speed = min(speed, SLOW_PUSH_SPEED)
        self._rolls, self._braking = rolls, ROLLING_DECELERATION if rolls else PUSH_ACCELERATION
        self._speed, self._max_speed, self._through = speed, speed, through
        self._force, self._mass = force, hand_mass
        self._travelled, self._rate = -gap, 0.0
        self._pushed = 0.0
        self._without = 0.0
        self._since = 0.0
        self._back = 0.0
        self._offset = np.zeros(2)
        self.phase: Phase = "pushing"
        self.touched_at: float | None = None
        """Travel of the carrier at the first contact, m; negative: earlier than expected. None: no
        contact."""
        self.blocked = False
        self.lost = False
        self.in_contact = False
        """Whether the contact lasted to the end."""
        self.reached = -gap
        """Travel of the carrier, m."""
        self.carrier: planar_geometry.PlanarPose = way.at(-gap)
        """Carrier by the encoders at the end of the push."""

    def start(self, position: Array, rotation: Array) -> None:
        super().start(position, rotation)
        begin = self._path.at(self._travelled)
        self._yaw = begin.yaw
        tcp = begin @ self._tool
        self._offset: Array = position[:2] - (tcp.x, tcp.y)

    @property
    def longest(self) -> float:
        """Duration of the push at the slowest speed, s."""
        return (self._gap + self._path.length) / min(self._speed, SLOW_PUSH_SPEED)

    @property
    def direction(self) -> Array:
        x, y = self._path.at(self._travelled).direction
        away = -1.0 if self.phase == "leaving" else 1.0
        return np.array([away * x, away * y, 0.0]) if self.phase in ("pushing", "leaving") else np.zeros(3)

    def limit(self, speed: float) -> None:
        self._max_speed = max(1e-3, min(speed, self._speed))

    def step(self, felt: ContactState) -> None:
        period = felt.period
        if self.phase == "pushing":
            self._push(felt, period)
        elif self.phase == "settling":
            self._settle(felt, period)
        elif self.phase == "leaving":
            self._leave(period)

    def _push(self, felt: ContactState, period: float) -> None:
        before = self._rate
        left = self._path.length - self._travelled
        wanted = min(self._max_speed, math.sqrt(max(0.0, 2 * self._braking * left)))
        change = PUSH_ACCELERATION * period
        self._rate = min(max(wanted, before - 2 * change), before + change)
        self._travelled = min(self._travelled + self._rate * period, self._path.length)
        self.reached = self._travelled
        self._feel(felt, (self._rate - before) / period, period)
        done = left <= self._rate * period + 1e-6
        if self.blocked or self.lost or done:
            self._rate = 0.0
            self.in_contact = (
                self.touched_at is not None and self._pushed > CONTACT_END_FORCE and not self.lost
            )
            self.phase, self._since = "settling", felt.elapsed
        self._anchor(felt, period, (self._rate - before) / period)

    def _feel(self, felt: ContactState, acceleration: float, period: float) -> None:
        """Update the force against the push, without the inertia of the hand, and the contact flags."""
        x, y = self._path.at(self._travelled).direction
        against = -float(felt.force[0] * x + felt.force[1] * y) - self._mass * acceleration
        self._pushed += (against - self._pushed) * min(1.0, period / PUSH_FORCE_TIME_CONSTANT)
        if self._pushed > CONTACT_BEGIN_FORCE and self.touched_at is None:
            self.touched_at = self._travelled
        self._without = 0.0 if self._pushed > CONTACT_END_FORCE else self._without + self._rate * period
        without = self.touched_at is not None and self._without > MAX_CONTACTLESS_TRAVEL
        self.lost = without and not (self._rolls or self._through)
        self.blocked = against > self._force

    def _settle(self, felt: ContactState, period: float) -> None:
        """Hold the arm at the end of the path, or where the push stopped, before it withdraws."""
        if self.blocked:
            # A body that resists is not pressed any longer.
            self._offset = felt.position[:2] - self._planned()[:2]
        off = self._anchor(felt, period, 0.0)
        waited = felt.elapsed - self._since
        if (
            (off < MAX_ARRIVAL_ERROR and waited > 0.1)
            or waited > MAX_SETTLING_TIME
            or self.blocked
            or self.lost
        ):
            self.carrier = self._carrier_at(felt)
            self.phase = "leaving"

    def _leave(self, period: float) -> None:
        """Move straight back, off the object."""
        step = min(self._speed, 0.05) * period
        self._back += step
        x, y = self._path.at(self._travelled).direction
        self.position = self.position - np.array([x, y, 0.0]) * step
        self.velocity = np.array([-x, -y, 0.0]) * (step / period)
        self.acceleration = self.spin = np.zeros(3)
        if self._back >= BACK_OFF_TRAVEL:
            self.velocity = np.zeros(3)
            self.phase = "left"
            self.finished = True

    def _planned(self) -> Array:
        tcp = self._path.at(self._travelled) @ self._tool
        return np.array([tcp.x, tcp.y, self.origin[2]])

    def _anchor(self, felt: ContactState, period: float, acceleration: float) -> float:
        """Set the anchor of the spring, and return the error of the tool, m."""
        carrier = self._path.at(self._travelled)
        planned = self._planned()
        error = planned[:2] - felt.position[:2]
        if not self.blocked:
            offset = self._offset + error * (ANCHOR_CORRECTION_RATE * period)
            self._offset = offset * min(1.0, MAX_ANCHOR_LEAD / max(1e-9, float(np.hypot(*offset))))
        self.position = planned + np.append(self._offset, 0.0)
        turn = carrier.yaw - self._yaw
        c, s = math.cos(turn), math.sin(turn)
        self.rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ self.turn
        spin = self._rate * self._path.curvature(self._travelled)
        x, y = carrier.direction
        arm = planned[:2] - (carrier.x, carrier.y)
        self.velocity = np.array([x * self._rate - spin * arm[1], y * self._rate + spin * arm[0], 0.0])
        self.spin = np.array([0.0, 0.0, spin])
        self.acceleration = np.array([x, y, 0.0]) * acceleration
        return float(np.hypot(*error))

    def _carrier_at(self, felt: ContactState) -> planar_geometry.PlanarPose:
        """Return the carrier for the tool's pose by the encoders."""
        turned = felt.rotation @ self.turn.T
        yaw = self._yaw + math.atan2(float(turned[1, 0]), float(turned[0, 0]))
        tcp = planar_geometry.PlanarPose(float(felt.position[0]), float(felt.position[1]), yaw)
        return tcp @ self._tool.inverse()


class DragMotion(PushMotion):
    """Stroke that begins above things: the tool sinks onto them, presses with `press` N, and drags them.

    With `DRAG_STIFFNESS` the force decreases when the tool slips off an edge. It ends above them.
    """

    def __init__(self, way: ArcPath, speed: float, force: float, press: float, hand_mass: float) -> None:
        super().__init__(
            way, planar_geometry.PlanarPose(0.0, 0.0), 0.0, speed, force, hand_mass, through=True
        )
        self._press, self._sinking = press, True

    @property
    def longest(self) -> float:
        return super().longest + MAX_SINK / SINK_SPEED

    def step(self, felt: ContactState) -> None:
        if not self._sinking:
            super().step(felt)
            return
        sunk = min(SINK_SPEED * felt.elapsed, MAX_SINK)
        self.position = self.origin - (0.0, 0.0, sunk)
        self.velocity = np.array([0.0, 0.0, -SINK_SPEED])
        if felt.force[2] > SINK_FORCE:
            low = felt.position[2] - self._press / VERTICAL_DRAG_STIFFNESS
            self.origin, self._sinking = np.array([*self.origin[:2], low]), False
        elif sunk >= MAX_SINK:
            self.origin, self._sinking = self.position.copy(), False

    def _leave(self, period: float) -> None:
        """Move straight up, off the things."""
        self._back += SINK_SPEED * period
        self.position = self.position + np.array([0.0, 0.0, SINK_SPEED * period])
        self.velocity = np.array([0.0, 0.0, SINK_SPEED])
        self.acceleration = self.spin = np.zeros(3)
        if self._back >= MAX_SINK:
            self.velocity = np.zeros(3)
            self.phase = "left"
            self.finished = True


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
    ends: planar_geometry.PlanarPose
    """Pose of the object if it has stayed at the tool."""

    @property
    def summary(self) -> str:
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
    there = planar_geometry.planar(fixture.shape, fixture.pose).inverse().apply(points)
    half = np.array(fixture.shape.size[:2]) / 2 - margin
    return bool((np.abs(there) <= half).all())


def placed(shape: planar_geometry.PlanarOutline, at: planar_geometry.PlanarPose) -> Array:
    """Return points (n, 2) in the world on the border of an outline."""
    if shape.round:
        ring = np.arange(16) * (2 * math.pi / 16)
        return np.stack([np.cos(ring), np.sin(ring)], axis=1) * shape.radius + (at.x, at.y)
    return at.apply(shape.corners)


def pose_refusal(
    world: World,
    belief: BeliefObject,
    places: Sequence[planar_geometry.PlanarPose],
    touching: Collection[str] = (),
) -> str | None:
    """Return why the object must not be at one of these places. None: it may.

    `touching`: objects that may be pushed along.
    """
    support = support_of(world, belief)
    if support is None:
        return f"{belief.id} does not stand on a level fixture"
    shape = planar_geometry.outline(belief.shape, belief.pose)
    margin = PUSH_CLEARANCE + CLEARANCE_SIGMAS * belief.sigma_position
    others = [o for o in world.scene.objects if o.id != belief.id and o.id not in touching and not o.attached]
    around = [
        (o.id, planar_geometry.outline(o.shape, o.pose), planar_geometry.planar(o.shape, o.pose))
        for o in others
    ]
    ignore = (belief.id, support.id, *(o.id for o in world.scene.objects))
    for at in places:
        if not within(support, placed(shape, at), SUPPORT_EDGE_MARGIN):
            return f"it would come to the edge of {support.id}"
        for hole in support.holes:
            middle = (support.pose @ hole.pose).position
            free = at.distance(planar_geometry.PlanarPose(middle[0], middle[1])) - shape.reach
            if free < math.hypot(*hole.size) / 2 + hole.chamfer:
                return f"it would come over {hole.id}"
        hit = next(
            (
                name
                for name, other, there in around
                if planar_geometry.outline_distance(shape, at, other, there) < margin
            ),
            None,
        )
        if hit is None:
            there = planar_geometry.moved(belief.shape, belief.pose, at)
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
    """Return the configuration (n,) above the first TCP pose of a stroke from which the arm can follow all
    poses, or the reason without one.

    `rise`: height above that pose, m; without it that of a pre-grasp. `touching`: names that the gripper may
    touch after the start; `beside`: before it, too, because something finer than the belief's shapes shows
    that it fits there. The search begins at the middle of the path. There the arm has a comfortable
    configuration, and the change along the path is shared between both ends.
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
    along: Mapping[ObjectId, planar_geometry.PlanarPose] | None = None,
) -> Doing[PushResult]:
    """Execute a stroke; the tool ends beside the object, and the belief is updated to the expected pose.

    `along`: expected poses of the objects that are pushed along. Failures: planning.*, control.*, safety.*,
    world.disturbed.
    """
    stroke = one.stroke
    start = stroke.tcp_at(-stroke.gap, one.height, one.flipped)
    with world.step(node, "approach"):
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
    with world.step(node, "stroke"):
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


def _believe(world: World, name: ObjectId, at: planar_geometry.PlanarPose) -> None:
    known = world.scene.find(name)
    if known is not None:
        pose = planar_geometry.moved(known.shape, known.pose, at)
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
