"""Insertion of the held object: choice of the hole, motion over it, search, press and release.

Geometry: poses over the hole, the peg in its present hold, its lean, and its place afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from picktree.robot.control import (
    BelievedHole,
    CartesianStiffness,
    ExtractionMotion,
    HeldPeg,
    InsertionMotion,
    InsertionParameters,
    Search,
)
from picktree.robot.planning import PoseGoal
from picktree.world import (
    Array,
    Box,
    Cylinder,
    Failure,
    Pose,
    Shape,
    bottom,
    extents,
    grasp,
    hole_geometry,
    insert,
    place,
    planning,
)
from picktree.world.scene import Fixture, Hole

from .held_object import fail_as_slipped, measure_grip, release_held_object
from .replanning import follow_with_replanning

T = TypeVar("T")

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing
    from picktree.world import BeliefObject, ObjectId
    from picktree.world.robot_model import GripperDescription

    from .grasps import GraspCandidate

SEARCH_HEIGHT = 0.012
"""Height of the object's underside over the believed mouth where the search begins, m."""
ROUND_PEG_TURNS = 8
"""Rotations about its axis at which a round object is tried."""
MIN_DOWNWARD_COSINE = math.cos(math.radians(30.0))
"""Least downward part of the tool's axis, 1. With less, the fixture is in the way of the hand."""
FINE_CLEARANCE = 0.001
"""Clearance below which contacts need the finer step, m."""
MAX_HELD_OFFSET = 0.0015
"""Greatest error of an object's believed place in the hand, m."""
MIN_TIP_HEIGHT = 0.0015
"""Height of the finger tips over the surface at the end, m."""
MIN_INSERTION_DEPTH = 0.005
"""Least insertion depth, m."""
FINE_CONTACT_RATE, COARSE_CONTACT_RATE = 1000, 500
"""Control periods a second in contact, for holes with less and with more clearance than `FINE_CLEARANCE`."""
LEAN_TOLERANCE = 1e-3
"""Difference of lean along the fingers below which two corners are equal, 1."""


@dataclass(frozen=True, slots=True)
class InsertionTask:
    """Insertion task: a held object and its hole, as believed."""

    hole: Hole
    hole_in_world: Pose
    shape: Shape
    object_in_tcp: Pose
    slack: float
    """Least difference between hole and object, both sides together, m."""
    uncertainty: float
    """Greatest distance of the mouth from its believed place, m."""

    @property
    def rate(self) -> int:
        """Rate of physics and control in contact, Hz."""
        return FINE_CONTACT_RATE if self.slack < FINE_CLEARANCE - 1e-9 else COARSE_CONTACT_RATE

    @property
    def height(self) -> float:
        """Height of the object along its axis, m."""
        low, high = extents(self.shape, np.eye(3))
        return float(high[2] - low[2])


def fit(fixture: Fixture, hole: Hole, shape: Shape, object_in_tcp: Pose) -> InsertionTask:
    """Return the insertion task. The uncertainty covers the fixture's position, its rotation and the object
    in the hand."""
    left = hole_geometry.hole_clearance(hole, shape)
    assert left is not None, "it was chosen because it fits"
    doubt = fixture.uncertainty
    arm = math.hypot(*hole.pose.position[:2])
    off = math.sqrt(2.0) * doubt.position + arm * doubt.angle + MAX_HELD_OFFSET
    return InsertionTask(hole, fixture.pose @ hole.pose, shape, object_in_tcp, min(left), off)


def poses_over(fit: InsertionTask, above: float) -> tuple[Pose, ...]:
    """Return TCP poses in the world, pointing down, with the upright object over the hole at each angle at
    which it fits.

    `above`: height of its underside over the mouth, m. Empty: no such pose exists for this grasp.
    """
    poses: list[Pose] = []
    for yaw in _turns(fit):
        for roll in (0.0, math.pi):
            upright = Pose.from_rpy((0.0, 0.0, fit.height / 2 + above), (roll, 0.0, yaw))
            tcp = fit.hole_in_world @ upright @ fit.object_in_tcp.inverse()
            if -float(tcp.rotation()[2, 2]) >= MIN_DOWNWARD_COSINE:
                poses.append(tcp)
    return tuple(poses)


def hover_poses(world: World, hole_id: str, shape: Shape, object_in_tcp: Pose) -> tuple[Pose, ...]:
    """Return `poses_over` for an object in this grasp, at the height where the search begins."""
    fixture, hole = hole_geometry.find_hole(world.scene, hole_id)
    return poses_over(fit(fixture, hole, shape, object_in_tcp), SEARCH_HEIGHT)


def fingertips_too_low(
    hole: Hole, belief: BeliefObject, grasp: GraspCandidate, gripper: GripperDescription
) -> bool:
    """Return whether the finger tips of a grasp would meet the fixture before the object is down in the
    hole."""
    tips = grasp.tcp_in_world.position[2] - gripper.tip
    return tips - bottom(belief.shape, belief.pose) < hole.depth + MIN_TIP_HEIGHT


def _turns(fit: InsertionTask) -> Sequence[float]:
    match fit.shape:
        case Box((x, y, _)):
            square = fit.hole.form == "square" and abs(x - y) < 1e-6
            along = 0.0 if (x >= y) == (fit.hole.size[0] >= fit.hole.size[1]) else math.pi / 2
            step = math.pi / 2 if square else math.pi
            return [along + k * step for k in range(4 if square else 2)]
        case _:
            return [2 * math.pi * k / ROUND_PEG_TURNS for k in range(ROUND_PEG_TURNS)]


def peg(fit: InsertionTask, tcp_in_world: Pose) -> HeldPeg:
    """Return the held object as a peg, with the TCP at that pose over the hole.

    It leans, as nearly as possible, along the closing direction of the fingers, y of the TCP. There the
    fingers' faces hold it, not friction. A box leans over one of its corners, so that a point leads.
    """
    up = fit.hole_in_world.rotation()[:, 2]
    down: Array = fit.object_in_tcp.rotation().T @ tcp_in_world.rotation().T @ -up
    end = np.array([0.0, 0.0, math.copysign(fit.height / 2, float(down[2]))])
    foot = fit.object_in_tcp.apply(end)
    turn = fit.object_in_tcp.rotation()
    match fit.shape:
        case Box((x, y, _)):
            corners = [np.array([a * x / 2, b * y / 2, 0.0]) for a in (1, -1) for b in (1, -1)]
            # Over a corner the sides have equal slopes, independent of their length.
            slopes = [turn @ (np.sign(c) / math.sqrt(2.0)) for c in corners]
            best = max(range(4), key=lambda k: (round(float(slopes[k][1]) / LEAN_TOLERANCE), k))
            return HeldPeg(foot, slopes[best], turn @ corners[best], False)
        case Cylinder(radius, _):
            lean = np.array([0.0, 1.0, 0.0])
            return HeldPeg(foot, lean, radius * lean, True)
        case _:
            lean = np.array([0.0, 1.0, 0.0])
            return HeldPeg(foot, lean, lean * float(extents(fit.shape, np.eye(3))[1][0]), True)


def mouth(fit: InsertionTask, depth: float, tip: float) -> BelievedHole:
    """Return the believed hole.

    `depth`: wanted depth, m. It is limited to the hole's bottom, and to where the finger tips, `tip` m beyond
    the TCP, are over the surface. The object falls the rest of the way.
    """
    low = fit.object_in_tcp.position[2] + fit.height / 2
    return BelievedHole(
        np.array(fit.hole_in_world.position),
        fit.hole_in_world.rotation()[:, 2],
        min(fit.hole.size),
        min(depth, fit.hole.depth, max(MIN_INSERTION_DEPTH, low - tip - MIN_TIP_HEIGHT)),
        fit.uncertainty,
    )


def inserted_pose(fit: InsertionTask, tcp_in_world: Pose) -> Pose:
    """Return the believed pose of the object after its release at that TCP pose: upright, on the bottom."""
    held = tcp_in_world @ fit.object_in_tcp
    local = fit.hole_in_world.inverse() @ held
    upright = np.array([0.0, 0.0, math.copysign(1.0, float(local.rotation()[2, 2]))])
    yaw = math.atan2(float(local.rotation()[1, 0]), float(local.rotation()[0, 0]))
    roll = 0.0 if upright[2] > 0 else math.pi
    x, y, _ = held.position
    floor = fit.hole_in_world.position[2] - fit.hole.depth
    placed = fit.hole_in_world @ Pose.from_rpy((0.0, 0.0, 0.0), (roll, 0.0, yaw))
    return Pose((x, y, floor + fit.height / 2), placed.orientation)


LINEAR_STIFFNESS, ANGULAR_STIFFNESS = 600.0, 30.0
"""Stiffness of the Cartesian impedance during the search, N/m and Nm/rad."""
GRIP_SETTLE_TIME = 0.4
"""Time in which the pads settle on the object after the grip was tightened, s."""
SEARCH_TIME_LIMIT = 120.0
"""Time limit of one insertion by contact, s."""
MIN_OPENING_CHANGE = 0.0015
"""Change of the opening that shows that the object has turned in the hand, m."""
DETECTED_MOUTH_UNCERTAINTY = 0.002
"""Uncertainty of a mouth's position seen by the hand camera, m."""


@dataclass(frozen=True, slots=True, eq=False)
class InsertionResult:
    """Result of an insertion by contact; the hand still holds an object that is not in."""

    motion: InsertionMotion
    depth: float
    """Wanted depth, m."""
    width: float
    """Opening of the fingers before the search, m."""
    force: float
    """Greatest contact force, N."""
    seconds: float

    @property
    def inserted(self) -> bool:
        return self.motion.outcome == "in"


def choose_hole(world: World, held: BeliefObject, into: ObjectId, node: str) -> Doing[InsertionTask]:
    """Return the insertion of the held object into a hole, or into the closest fit of a fixture's free holes.

    `into`: hole or fixture; empty: where the object belongs. A camera on the hand looks at the mouth first,
    for which the arm moves. Raises insert.missed, place.occupied, place.full, world.unknown_object, and the
    failures of motions.
    """
    scene = world.scene
    into = into or scene.destination(held.id) or into
    if not into:
        raise Failure(insert.MISSED, f"no rule says into which hole {held.id} belongs", object=held.id)
    fixture = scene.fixtures.get(into)
    if fixture is None or not fixture.holes:
        _, hole = hole_geometry.find_hole(scene, into)
        if hole_geometry.occupied(scene, hole.id):
            raise Failure(place.OCCUPIED, f"{hole.id} is taken already", object=held.id, hole=hole.id)
        if not hole_geometry.fits_hole(hole, held.shape):
            raise Failure(
                insert.MISSED, f"{held.id} does not fit into {hole.id}", object=held.id, hole=hole.id
            )
    chosen = hole_geometry.fitting_hole(scene, held.id, into)
    if chosen is None:
        raise Failure(place.FULL, f"{into} has no free hole that {held.id} fits", object=held.id, into=into)
    assert held.object_in_tcp is not None
    fixture, hole = hole_geometry.find_hole(scene, chosen.id)
    task = fit(fixture, hole, held.shape, held.object_in_tcp)
    if all(camera.on != "hand" for camera in world.description.cameras):
        return task
    from .hole_servoing import look_at_hole  # needs OpenCV

    seen = yield from look_at_hole(world, hole.id, node)
    return (
        task
        if seen is None
        else replace(task, hole_in_world=seen, uncertainty=DETECTED_MOUTH_UNCERTAINTY + MAX_HELD_OFFSET)
    )


def move_over_hole(
    world: World, object_id: ObjectId, task: InsertionTask, speed: float, node: str
) -> Doing[None]:
    """Move the object upright above the mouth. Raises planning.no_ik when its grasp does not allow that, and
    the failures of motions."""
    poses = poses_over(task, SEARCH_HEIGHT)
    if not poses:
        raise Failure(
            planning.NO_IK,
            f"{object_id} is not held upright: however the hand turns above {task.hole.id}, it does "
            "not stand over it",
            object=object_id,
            hole=task.hole.id,
        )
    scaling = world.handling.scaling(speed)
    yield from follow_with_replanning(
        world,
        lambda: world.plan.to(PoseGoal(poses), scaling=scaling, node=node),
        guard=world.handling.guard,
        node=node,
    )


def insert_by_contact(
    world: World,
    held: BeliefObject,
    task: InsertionTask,
    search: Search,
    touch: InsertionParameters,
    grip: float,
    depth: float,
    node: str,
) -> Doing[InsertionResult]:
    """Touch the surface, search the mouth and press; let the object go once it is in.

    `grip`: force of each finger, N. `depth`: wanted depth, m. An object that does not go in is above the hole
    again at the end. Raises the failures of motions.
    """
    with world.control.contact(rate=task.rate):
        world.gripper.press(grip)
        for _ in range(math.ceil(GRIP_SETTLE_TIME / world.tick)):
            yield
        width = world.gripper.width
        motion = InsertionMotion(
            peg(task, world.control.tcp),
            mouth(task, depth, world.robot.description.gripper.tip),
            touch,
            search,
            LINEAR_STIFFNESS,
        )
        stiffness = CartesianStiffness(linear=LINEAR_STIFFNESS, angular=ANGULAR_STIFFNESS)
        done = yield from _in_stages(
            world, node, motion, world.move.comply(motion, SEARCH_TIME_LIMIT, stiffness=stiffness, node=node)
        )
        if not done.finished:
            out = ExtractionMotion(motion.up, motion.depth)
            with world.step(node, "withdraw"):
                yield from world.move.comply(
                    out, SEARCH_TIME_LIMIT, stiffness=stiffness, zero=done.zero, node=node
                )
        result = InsertionResult(motion, depth, width, done.force, done.seconds)
        if result.inserted:
            resting = inserted_pose(task, world.control.tcp)
            with world.step(node, "release"):
                yield from release_held_object(world, held, resting, task.hole.id, "inserted")
    return result


def _in_stages(world: World, node: str, motion: InsertionMotion, doing: Doing[T]) -> Doing[T]:
    """Run the motion; each of its stages is a step."""
    step = partial(next, doing)
    while True:
        stage = motion.stage
        with world.step(node, stage):
            while motion.stage == stage:
                try:
                    step()
                except StopIteration as end:
                    return end.value
                try:
                    yield
                    step = partial(next, doing)
                except GeneratorExit:
                    doing.close()
                    raise
                except Failure as failure:
                    step = partial(doing.throw, failure)


def explain_missed_insertion(
    world: World, object_id: ObjectId, task: InsertionTask, result: InsertionResult
) -> Doing[Failure]:
    """Check the grip above the hole after a failed insertion, and return its failure.

    insert.not_found, insert.jammed or insert.missed; grasp.slipped when the object has turned in the hand.
    Raises grasp.slipped when it is lost.
    """
    motion, hole = result.motion, task.hole
    hold = yield from measure_grip(world)
    if not hold.held:
        yield from fail_as_slipped(world, object_id, hold, f"slipped out of the fingers at {hole.id}")
    if abs(hold.width - result.width) > MIN_OPENING_CHANGE:
        return Failure(
            grasp.SLIPPED,
            f"{object_id} has turned in the hand at {hole.id}: the fingers stood "
            f"{result.width * 1000:.1f} mm apart, now {hold.width * 1000:.1f} mm",
            object=object_id,
            width=hold.width,
            load=hold.load,
            before=result.width,
        )
    mm = 1000.0
    match motion.outcome:
        case "no bottom":
            cause, what = insert.MISSED, f"it went {motion.deepest * mm:.0f} mm deep and met no bottom"
        case "not found":
            cause = insert.NOT_FOUND
            what = f"the surface was felt, but no mouth within {motion.searched * mm:.1f} mm"
        case "jammed":
            cause, what = insert.JAMMED, f"it got stuck {motion.deepest * mm:.1f} mm deep"
        case _:
            cause, what = insert.JAMMED, f"it was not in after {result.seconds:.0f} s of trying"
    return Failure(
        cause,
        f"{object_id} is not in {hole.id}: {what}",
        object=object_id,
        hole=hole.id,
        depth=round(motion.deepest, 5),
        wanted=min(result.depth, hole.depth),
        force=round(result.force, 2),
        searched=round(motion.searched, 5),
        surface=round(motion.surface, 5),
        tried=list(motion.tried),
        pulled_back=motion.pulled,
        clearance=round(task.slack, 5),
    )
