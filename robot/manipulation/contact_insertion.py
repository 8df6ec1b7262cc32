"""Insertion by contact: the hole is chosen, the object moved over it, searched for, pressed in and let go."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...world.belief.hole_matching import find_hole, fits_hole, fitting_hole, occupied
from ...world.causes import Failure, grasp, insert, place, planning
from ..control.compliant_motion import CartesianStiffness
from ..control.hole_search import InsertionMotion, InsertionParameters, Search
from ..control.peg_motion import ExtractionMotion
from ..planning.requests import PoseGoal
from .hold_check import fail_as_slipped, measure_grip, release_held_object
from .insertion import SEARCH_HEIGHT, InsertionTask, fit, inserted_pose, mouth, peg, poses_over
from .replanning import follow_with_replanning

if TYPE_CHECKING:
    from ...world.belief.planning_scene import BeliefObject
    from ...world.values import ObjectId
    from ..control.trajectory_motion import Doing
    from ..world import World

LINEAR_STIFFNESS, ANGULAR_STIFFNESS = 600.0, 30.0
"""Stiffness of the Cartesian impedance during the search, N/m and Nm/rad."""
GRIP_SETTLE_TIME = 0.4
"""Time in which the pads settle on the object after the grip was tightened, s."""
SEARCH_TIME_LIMIT = 120.0
"""Time limit of one insertion by contact, s."""
MIN_OPENING_CHANGE = 0.0015
"""Change of the opening that shows that the object has turned in the hand, m."""
SEEN_MOUTH_UNCERTAINTY = 0.002
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
        _, hole = find_hole(scene, into)
        if occupied(scene, hole.id):
            raise Failure(place.OCCUPIED, f"{hole.id} is taken already", object=held.id, hole=hole.id)
        if not fits_hole(hole, held.shape):
            raise Failure(
                insert.MISSED, f"{held.id} does not fit into {hole.id}", object=held.id, hole=hole.id
            )
    chosen = fitting_hole(scene, held.id, into)
    if chosen is None:
        raise Failure(place.FULL, f"{into} has no free hole that {held.id} fits", object=held.id, into=into)
    assert held.object_in_tcp is not None
    fixture, hole = find_hole(scene, chosen.id)
    task = fit(fixture, hole, held.shape, held.object_in_tcp)
    if all(camera.on != "hand" for camera in world.description.cameras):
        return task
    from .hole_servoing import look_at_hole  # needs OpenCV

    seen = yield from look_at_hole(world, hole.id, node)
    return task if seen is None else task.seen_at(seen, SEEN_MOUTH_UNCERTAINTY)


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
        done = yield from world.move.comply(motion, SEARCH_TIME_LIMIT, stiffness=stiffness, node=node)
        if not done.finished:
            out = ExtractionMotion(motion.up, motion.depth)
            yield from world.move.comply(
                out, SEARCH_TIME_LIMIT, stiffness=stiffness, zero=done.zero, node=node
            )
        result = InsertionResult(motion, depth, width, done.force, done.seconds)
        if result.inserted:
            resting = inserted_pose(task, world.control.tcp)
            yield from release_held_object(world, held, resting, task.hole.id, "inserted")
    return result


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
