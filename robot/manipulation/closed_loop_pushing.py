"""Closed-loop pushing: stroke by stroke, with images in between, to a goal or until the hand fits
around an object.

The pose of the pushed object comes from contact and vision: a Kalman filter of place and heading in the
plane. A stroke that ended in contact measures the object across the touched side, and its heading, far better
than a camera. Along the side some precision is lost. An observation that contradicts the contact counts
alone: then something else has happened.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from picktree.world import (
    Array,
    BeliefObject,
    Failure,
    ObjectId,
    event_types,
    perception,
    planar_geometry,
    push,
    world_facts,
)

from .singulation import SingulationPush, has_room, most_crowded_object, singulation_pushes
from .stroke_execution import (
    FeasibleStroke,
    PushResult,
    execute_stroke,
    go_looking,
    plan_stroke,
    pose_refusal,
    step_back,
    stroke_refusal,
)
from .stroke_planning import PushGoal, PushStroke, push_strokes, turning_room_strokes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from picktree.robot import World
    from picktree.robot.control import Doing

SHARED_PICTURE_ERROR = 3e-4
"""Systematic error that pictures of the same object share, m."""


def observe_closely(world: World, camera: str, name: ObjectId, pictures: int) -> Doing[BeliefObject | None]:
    """Return the belief of an object from several pictures: its place is their mean. None: most of them do
    not show it."""
    yield from world.control.settle()
    found: list[BeliefObject] = []
    for _ in range(pictures):
        summary = yield from world.vision.observe(camera, fresh=True)
        belief = world.scene.find(name)
        if name in summary.seen and belief is not None:
            found.append(belief)
    if 2 * len(found) <= pictures:
        return None
    last = found[-1]
    here = [b for b in found if b.kind == last.kind]
    places = [planar_geometry.planar(b.shape, b.pose) for b in here]
    turn = planar_geometry.outline(last.shape, last.pose).turn
    first = places[0]
    yaw = first.yaw + float(np.median([planar_geometry.wrap_angle(p.yaw - first.yaw, turn) for p in places]))
    mean = planar_geometry.PlanarPose(
        float(np.mean([p.x for p in places])),
        float(np.mean([p.y for p in places])),
        planar_geometry.wrap_angle(yaw),
    )
    height = float(np.mean([b.pose.position[2] for b in here]))
    pose = planar_geometry.moved(last.shape, last.pose, mean)
    pose = replace(pose, position=(mean.x, mean.y, height))
    sigma = math.hypot(last.sigma_position / math.sqrt(len(here)), SHARED_PICTURE_ERROR)
    mean_belief = replace(
        last, pose=pose, sigma_position=sigma, sigma_angle=last.sigma_angle / math.sqrt(len(here))
    )
    world.scene.put(mean_belief, f"the mean of {len(here)} pictures")
    return mean_belief


SIGHT_SIGMA = 5e-4
"""Standard deviation of a mean of several pictures along an axis, m: noise, and the grid of pixels."""
SIGHT_ANGLE_SIGMA = math.radians(0.8)
"""Standard deviation of the heading from pictures, rad."""
CONTACT_SIGMA, CONTACT_ANGLE_SIGMA = 2e-4, math.radians(0.25)
"""Standard deviations after a contact to the end: across the touched side, m, and of the heading, rad."""
SLIP_SIGMA = 2e-4
"""Standard deviation along the side, m; `SLIP_SIGMA_SHARE` is added for each metre of travel:"""
SLIP_SIGMA_SHARE = 0.03
ROTATION_SHARE = 0.5
"""Share of the expected rotation during a push that counts: friction at the corner holds some back."""
WIDE_CONTACT_HALF_LENGTH = 0.016
"""Half contact length from which the heading has that precision, m."""
MAX_AGREEING_SIGMAS = 4.0
"""Difference between vision and contact that is a contradiction, in standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanarEstimate:
    """Estimate of place and heading: covariance (2, 2) m², and standard deviation of the heading, rad."""

    at: planar_geometry.PlanarPose
    covariance: Array
    turned: float

    @property
    def sigma(self) -> float:
        """Standard deviation of the place along the worse axis, m."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance)[-1]))


def estimate_from_camera(at: planar_geometry.PlanarPose) -> PlanarEstimate:
    """Return the estimate from a camera alone."""
    return PlanarEstimate(at, np.eye(2) * SIGHT_SIGMA**2, SIGHT_ANGLE_SIGMA)


def estimate_from_contact(
    before: PlanarEstimate,
    stroke: PushStroke,
    ends: planar_geometry.PlanarPose,
    shape: planar_geometry.PlanarOutline,
) -> PlanarEstimate:
    """Return the estimate after a stroke that ended in contact, with the object at `ends` by the tool's
    pose."""
    side, way = stroke.side, stroke.way.length
    if shape.round:
        return PlanarEstimate(ends, np.eye(2) * CONTACT_SIGMA**2 * 2, math.pi)
    nx, ny = side.carrier(ends).direction
    normal, along = np.array([nx, ny]), np.array([-ny, nx])
    lateral = float(along @ before.covariance @ along) + SLIP_SIGMA**2 + (SLIP_SIGMA_SHARE * way) ** 2
    covariance = np.outer(normal, normal) * CONTACT_SIGMA**2 + np.outer(along, along) * lateral
    # Pushed at one corner, the object turns until its side is flat against the fingers.
    askew = (
        abs(planar_geometry.wrap_angle(stroke.way.start.yaw - side.carrier(before.at).yaw))
        + 2.0 * before.turned
    )
    turning = side.half / (shape.inertia() + side.half**2)
    squared = ROTATION_SHARE * turning * max(0.0, way - 2.0 * SIGHT_SIGMA) > askew
    narrow = max(1.0, WIDE_CONTACT_HALF_LENGTH / side.half) ** 2
    return PlanarEstimate(ends, covariance, CONTACT_ANGLE_SIGMA * narrow if squared else askew)


def fuse_estimates(touch: PlanarEstimate, sight: PlanarEstimate, turn: float) -> PlanarEstimate:
    """Return the fused estimate, or the visual one alone where both contradict each other.

    `turn`: angle of the object's rotational symmetry, rad; 0: the heading does not count.
    """
    off = np.array([sight.at.x - touch.at.x, sight.at.y - touch.at.y])
    yaw = planar_geometry.wrap_angle(sight.at.yaw - touch.at.yaw, turn)
    both = touch.covariance + sight.covariance
    spread = touch.turned**2 + sight.turned**2
    apart = float(off @ np.linalg.solve(both, off)) + (yaw**2 / spread if turn else 0.0)
    if apart > MAX_AGREEING_SIGMAS**2:
        return sight
    gain = touch.covariance @ np.linalg.inv(both)
    x, y = np.array([touch.at.x, touch.at.y]) + gain @ off
    share = touch.turned**2 / spread if turn else 1.0
    covariance = (np.eye(2) - gain) @ touch.covariance
    return PlanarEstimate(
        planar_geometry.PlanarPose(float(x), float(y), touch.at.yaw + share * yaw),
        (covariance + covariance.T) / 2,
        math.sqrt(1.0 / (1.0 / touch.turned**2 + 1.0 / sight.turned**2)),
    )


def estimate_after_stroke(
    before: PlanarEstimate, after: BeliefObject, stroke: PushStroke, pushed: PushResult
) -> PlanarEstimate:
    """Return the estimate from what was felt during a stroke and what is seen after it."""
    shape, sight = (
        planar_geometry.outline(after.shape, after.pose),
        estimate_from_camera(planar_geometry.planar(after.shape, after.pose)),
    )
    if pushed.blocked or pushed.lost or not pushed.in_contact or stroke.side.rolls:
        return sight
    return fuse_estimates(estimate_from_contact(before, stroke, pushed.ends, shape), sight, shape.turn)


IMAGES_BETWEEN_STROKES = 5
"""Number of images of an object between two strokes."""
MAX_STROKE_LENGTH = 0.06
"""Maximum length of one stroke, m; longer only when few strokes are allowed."""
MIN_BLOCKED_MOTION = 0.004
"""Least motion of a blocked object that counts as motion, m."""
MAX_TESTED_PUSHES = 12
"""Maximum number of singulation pushes that are tested for reachability."""
MAX_FAILED_STROKES = 2
"""Number of consecutive strokes without success (object lost or unmoved) after which the skill fails."""
HEADING_ERROR_WEIGHT = 0.02
"""Weight of the heading error in the remaining error of an object, m for each radian."""


@dataclass(frozen=True, slots=True)
class PushTask:
    """Pushes of one object for one node, with the bounds that its author sets."""

    object: ObjectId
    """Object to push, or to make room around; empty: the one that needs room most."""
    node: str
    camera: str
    strokes: int
    """Greatest number of strokes."""
    speed: float
    """Speed of the tool while it pushes, m/s."""
    force: float
    """Force of the object on the tool that stops a stroke, N."""


@dataclass(frozen=True, slots=True)
class PushTolerance:
    """Greatest remaining errors of a pushed object: distance, m, and heading, rad."""

    distance: float
    turn: float


@dataclass(slots=True)
class _Progress:
    """Strokes that were made, and those of them without success."""

    strokes: list[str] = field(default_factory=list[str])
    stalled: int = 0
    """Number of consecutive strokes that were blocked at once."""
    lost: int = 0
    """Number of consecutive strokes that lost the object."""
    blocked_sides: set[str] = field(default_factory=set[str])

    def add(self, stroke: PushStroke, pushed: PushResult, travel: float) -> None:
        """Add a stroke that has moved the object by `travel` m."""
        self.stalled = self.stalled + 1 if pushed.blocked and travel < MIN_BLOCKED_MOTION else 0
        self.lost = self.lost + 1 if pushed.lost else 0
        if self.stalled:
            self.blocked_sides.add(stroke.side.name)

    def check(self, object_id: ObjectId) -> None:
        """Raise push.stalled or push.lost_contact after too many strokes without success."""
        for count, cause, what in (
            (self.stalled, push.STALLED, "does not move"),
            (self.lost, push.LOST_CONTACT, "does not stay at the fingers"),
        ):
            if count >= MAX_FAILED_STROKES:
                message = f"{object_id} {what}: {self.strokes[-1]}"
                raise Failure(cause, message, object=object_id, strokes=self.strokes)


def check_hand_is_free(world: World, object_id: ObjectId) -> None:
    """Raise push.no_stroke when the hand holds an object."""
    held = world.scene.held
    if held is not None:
        raise Failure(
            push.NO_STROKE, f"the hand is not free: it holds {held.id}", object=object_id, held=held.id
        )


def push_goal(
    belief: BeliefObject, to: Sequence[float], yaw: float | None, direction: Sequence[float], distance: float
) -> PushGoal:
    """Return the goal of an object: a place `to` (x, y) m, `distance` m along a direction, or a heading.

    `yaw`: wanted heading, rad. None: any. A round object has no heading; along a line it is kept.
    """
    at = planar_geometry.planar(belief.shape, belief.pose)
    round_ = planar_geometry.outline(belief.shape, belief.pose).round
    if to:
        return PushGoal(to[0], to[1], None if round_ else yaw)
    if direction:
        way = np.array(direction) * (distance / max(1e-9, math.hypot(*direction)))
        return PushGoal(at.x + float(way[0]), at.y + float(way[1]), None if round_ else at.yaw)
    return PushGoal(at.x, at.y, None if round_ else yaw)


def check_goal(world: World, belief: BeliefObject, goal: PushGoal) -> None:
    """Raise push.no_stroke when the goal is no possible place for the object."""
    yaw = planar_geometry.planar(belief.shape, belief.pose).yaw if goal.yaw is None else goal.yaw
    why = pose_refusal(world, belief, [planar_geometry.PlanarPose(goal.x, goal.y, yaw)])
    if why is not None:
        raise Failure(
            push.NO_STROKE,
            f"{belief.id} cannot be pushed to ({goal.x:.3f}, {goal.y:.3f}): {why}",
            object=belief.id,
            x=goal.x,
            y=goal.y,
        )


def observe_pushed_object(
    world: World, task: PushTask, after: PushResult | None = None
) -> Doing[BeliefObject]:
    """Return the object as several images show it; the arm moves out of the view if it hides it.

    Raises perception.not_found before the first stroke, and push.lost_contact `after` one.
    """
    belief = yield from observe_closely(world, task.camera, task.object, IMAGES_BETWEEN_STROKES)
    if belief is None:
        yield from go_looking(world, task.node)
        belief = yield from observe_closely(world, task.camera, task.object, IMAGES_BETWEEN_STROKES)
    if belief is not None:
        return belief
    if after is None:
        raise Failure(
            perception.NOT_FOUND, f"{task.object} is not in the view of {task.camera}", object=task.object
        )
    raise Failure(
        push.LOST_CONTACT,
        f"{task.object} is not seen where it was pushed ({after.summary})",
        object=task.object,
        touched=after.touched,
        reached=after.reached,
    )


def push_to_goal(
    world: World, task: PushTask, belief: BeliefObject, goal: PushGoal, tolerance: PushTolerance
) -> Doing[None]:
    """Push the object until it is at the goal within the tolerance, stroke by stroke.

    Raises push.missed, push.stalled, push.lost_contact, push.no_stroke, and the failures of motions.
    """
    progress = _Progress()
    off = turned = math.inf
    known = estimate_from_camera(planar_geometry.planar(belief.shape, belief.pose))
    for left in range(task.strokes, -1, -1):
        off, turned = _remaining_error(belief, goal)
        if off <= tolerance.distance and turned <= tolerance.turn:
            _note_goal_reached(world, task, belief, off, turned, progress.strokes)
            return
        if not left:
            break
        one = yield from _choose_stroke(world, belief, goal, left, progress.blocked_sides)
        pushed = yield from execute_stroke(world, belief, one, task.speed, task.force, task.node)
        progress.strokes.append(f"{one.stroke.name}: {pushed.summary}")
        yield from step_back(world, (task.object,), task.node)
        after = yield from observe_pushed_object(world, task, pushed)
        travel = known.at.distance(planar_geometry.planar(after.shape, after.pose))
        known = estimate_after_stroke(known, after, one.stroke, pushed)
        belief = replace(
            after, pose=planar_geometry.moved(after.shape, after.pose, known.at), sigma_position=known.sigma
        )
        world.scene.put(belief, "by touch and sight")
        progress.add(one.stroke, pushed, travel)
        progress.check(task.object)
    raise Failure(
        push.MISSED,
        f"{task.object} is {_error_words(off, turned)} off after {len(progress.strokes)} strokes",
        object=task.object,
        off=off,
        turned=turned,
        strokes=progress.strokes,
    )


def _remaining_error(belief: BeliefObject, goal: PushGoal) -> tuple[float, float]:
    """Return distance, m, and heading error, rad, of an object from its goal."""
    shape = planar_geometry.outline(belief.shape, belief.pose)
    return goal.deviation(planar_geometry.planar(belief.shape, belief.pose), shape.turn)


def _choose_stroke(
    world: World, belief: BeliefObject, goal: PushGoal, left: int, blocked_sides: set[str]
) -> Doing[FeasibleStroke]:
    """Return the best stroke that is free and feasible; owed thinking passes between the tests. `left`:
    number of strokes left. Raises push.no_stroke."""
    at = planar_geometry.planar(belief.shape, belief.pose)
    longest = max(MAX_STROKE_LENGTH, 2.0 * at.distance(planar_geometry.PlanarPose(goal.x, goal.y)) / left)
    why: list[str] = []
    gripper = world.robot.description.gripper
    helping = [s for s in push_strokes(belief, goal, gripper, longest) if _helps(s, belief, goal)]
    if not helping and goal.yaw is not None:
        helping = list(turning_room_strokes(belief, gripper))
    for stroke in helping:
        if stroke.side.name in blocked_sides:
            continue
        with world.plan.checking():
            refusal = stroke_refusal(world, belief, stroke)
        if refusal is None:
            answer = plan_stroke(world, belief, stroke)
            if isinstance(answer, FeasibleStroke):
                return answer
            refusal = answer
        why.append(f"{stroke.name}: {refusal}")
        yield from world.plan.charge()
    reasons = "; ".join(why[:4]) or "no side can be pushed that way"
    raise Failure(
        push.NO_STROKE,
        f"no stroke brings {belief.id} nearer to where it is to be: {reasons}",
        object=belief.id,
        refused=why,
    )


def _helps(stroke: PushStroke, belief: BeliefObject, goal: PushGoal) -> bool:
    """Return whether the stroke reduces the remaining error."""
    shape = planar_geometry.outline(belief.shape, belief.pose)
    off, turned = goal.deviation(stroke.ends, shape.turn)
    before_off, before_turned = _remaining_error(belief, goal)
    before = before_off + HEADING_ERROR_WEIGHT * before_turned
    return off + HEADING_ERROR_WEIGHT * turned < before - 1e-5


def _note_goal_reached(
    world: World, task: PushTask, belief: BeliefObject, off: float, turned: float, strokes: list[str]
) -> None:
    world.journal.note(
        event_types.PushEvent(
            f"{task.object}: {len(strokes)} strokes, {_error_words(off, turned)} off",
            task.node,
            object=task.object,
            form=belief.form,
            off=off,
            turned=turned,
            strokes=tuple(strokes),
        )
    )


def _error_words(off: float, turned: float) -> str:
    """Return the errors in words, as `1.2 mm and 0.5 deg`."""
    return f"{off * 1000:.1f} mm and {math.degrees(turned):.1f} deg"


def make_room(world: World, task: PushTask) -> Doing[None]:
    """Push the object, or those around it, until it can be grasped; an unknown one until it is recognised or
    isolated.

    Raises push.missed, push.no_stroke, world.unknown_object, and the failures of cameras and motions.
    """
    yield from _look(world, task)
    name = task.object or most_crowded_object(world)
    if not name:
        return
    world.scene.get(name)
    strokes: list[str] = []
    for left in range(task.strokes, -1, -1):
        target = world.scene.find(name)
        if target is None or has_room(world, target):
            world.attempts.clear(task.node, name)
            if strokes:
                _note_room(world, task, name, strokes)
            return
        if not left:
            break
        one, feasible = yield from _choose_singulation(world, task, target)
        world.attempts.failed(task.node, name, one.name)
        pushed = yield from execute_stroke(
            world, one.pushed, feasible, task.speed, task.force, task.node, one.there
        )
        strokes.append(f"{one.name}: {pushed.summary}")
        yield from step_back(world, one.there, task.node)
        yield from _look(world, task)
    raise Failure(
        push.MISSED,
        f"there is still no room for the hand around {name} after {len(strokes)} strokes",
        object=name,
        strokes=strokes,
    )


def _look(world: World, task: PushTask) -> Doing[None]:
    yield from world.control.settle()
    yield from world.vision.observe(task.camera)


def _choose_singulation(
    world: World, task: PushTask, target: BeliefObject
) -> Doing[tuple[SingulationPush, FeasibleStroke]]:
    """Return the best feasible push; pushes that were made before come last. Owed thinking passes between
    the tests. Raises push.no_stroke."""
    refused = world.attempts.refusal(world_facts.PUSH, target, world.scene)
    if refused is not None:
        message = f"{refused}; nothing has changed around it since"
        raise Failure(push.NO_STROKE, message, object=target.id, unchanged=True)
    offered = world.attempts.remaining(task.node, target.id, singulation_pushes(world, target))
    why: list[str] = []
    for one in offered[:MAX_TESTED_PUSHES]:
        answer = plan_stroke(world, one.pushed, one.stroke, [n for n in one.there if n != one.pushed.id])
        if isinstance(answer, FeasibleStroke):
            return one, answer
        why.append(f"{one.name}: {answer}")
        yield from world.plan.charge()
    reasons = "; ".join(why[:4]) or "no push that is free would do"
    message = f"no stroke makes room for the hand around {target.id}: {reasons}"
    if not offered:
        world.attempts.refuse(world_facts.PUSH, target, world.scene, message)
    raise Failure(push.NO_STROKE, message, object=target.id, refused=why)


def _note_room(world: World, task: PushTask, name: ObjectId, strokes: list[str]) -> None:
    text = f"{name}: the hand fits around it after {len(strokes)} strokes"
    world.journal.note(event_types.PushEvent(text, task.node, object=name, strokes=tuple(strokes)))
