"""Position-based visual servoing: the camera on the hand corrects the grasp from the pre-grasp pose.

A distant camera has the error of its mounting; the camera on the hand sees the object next to its own
fingers. So only the pose relative to the tool counts. The belief is corrected to agree with it, for the
target and for the objects around it in the picture. Objects seen in the same earlier picture get the same
shift. It is the look-then-move form of visual servoing (Chaumette & Hutchinson, "Visual servo control, part
I", 2006).

Association of patches: objects seen through one camera with a mounting error are shifted alike. So every
shift that brings some object onto some patch is tested on all of them. The one that explains most with the
least shift counts. The picture is ambiguous
when another shift takes a different patch as the target and explains nearly as much.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from picktree.robot.planning import LineGoal, Request
from picktree.world import BeliefObject, Failure, ObjectId, Pose, event_types, perception

from .grasps import GraspCandidate
from .pick_candidates import PickPlaceCandidate
from .pick_place_motions import descend_request

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing, Watch
    from picktree.robot.perception import TrackedSighting


UNEXPLAINED_COST = 0.010
"""Cost of an object that a shift brings onto no patch, m."""
SHIFT_COST_SHARE = 0.5
"""Cost of a shift, as a share of its length. Camera mountings are nearly correct."""
MIN_COST_DIFFERENCE = 0.006
"""Least difference in cost to a shift that takes another patch for the target, m."""


@dataclass(frozen=True, slots=True)
class PatchMatch:
    """Association of one picture's patches with objects."""

    target: TrackedSighting | None
    """Sighting of the target. None: not recognised, or ambiguous."""
    others: tuple[TrackedSighting, ...]
    """Sightings of other objects: at most one for each, from its own patch."""
    ambiguous: bool
    """Whether two patches may be the target, and nothing distinguishes them."""
    seen: int
    """Number of patches that may be the target, whether it fits them or not."""


@dataclass(frozen=True, slots=True)
class _Reading:
    cost: float
    taken: dict[ObjectId, TrackedSighting]


def match_patches(
    target: BeliefObject, objects: Sequence[BeliefObject], found: Sequence[TrackedSighting]
) -> PatchMatch:
    """Return the best association of the sightings; `objects`: all objects in the search, including the
    target."""
    fitting = [s for s in found if math.isfinite(s.misfit)]
    seen = len({s.patch for s in found if s.object == target.id})
    believed = {o.id: o for o in objects}
    shifts = sorted({_shift(believed[s.object], s) for s in fitting})
    readings = [_read_shift(shift, believed, fitting) for shift in shifts]
    mine = [r for r in readings if target.id in r.taken]
    best = min(mine or readings, key=lambda r: r.cost, default=_Reading(0.0, {}))
    own = best.taken.get(target.id)
    if own is not None:
        rivals = [r for r in readings if _contradicts(r, target.id, own.patch)]
        rival = min(rivals, key=lambda r: r.cost, default=None)
        if rival is not None and rival.cost < best.cost - MIN_COST_DIFFERENCE:
            best, own = rival, rival.taken.get(target.id)
        elif rival is not None and rival.cost < best.cost + MIN_COST_DIFFERENCE:
            return PatchMatch(None, (), True, seen)
    return PatchMatch(own, tuple(s for name, s in best.taken.items() if name != target.id), False, seen)


def _contradicts(reading: _Reading, target: ObjectId, patch: int) -> bool:
    """Return whether the reading gives the target another patch, or the patch to another object."""
    return any((name == target) != (s.patch == patch) for name, s in reading.taken.items())


def _shift(one: BeliefObject, sighting: TrackedSighting) -> tuple[float, float]:
    x, y, _ = sighting.pose.position
    return x - one.pose.position[0], y - one.pose.position[1]


def _read_shift(
    shift: tuple[float, float], believed: dict[ObjectId, BeliefObject], fitting: Sequence[TrackedSighting]
) -> _Reading:
    """Return the reading of a shift: each object takes the nearest patch, nearest pairs first, each patch
    once."""
    pairs = sorted(
        (math.dist(_shift(believed[s.object], s), shift), str(s.object), s.patch, n)
        for n, s in enumerate(fitting)
    )
    taken: dict[ObjectId, TrackedSighting] = {}
    patches: set[int] = set()
    cost = SHIFT_COST_SHARE * math.hypot(*shift) + UNEXPLAINED_COST * len({s.object for s in fitting})
    for off, _, patch, n in pairs:
        sighting = fitting[n]
        if off < UNEXPLAINED_COST and sighting.object not in taken and patch not in patches:
            taken[sighting.object] = sighting
            patches.add(patch)
            cost += off - UNEXPLAINED_COST
    return _Reading(cost, taken)


MAX_LOOKS = 3
"""Maximum number of looks for one grasp."""
LARGE_CORRECTION, LARGE_CORRECTION_TURN = 0.003, math.radians(2.5)
"""Correction above which another look checks it, m and rad."""
LAST_LOOK_HEIGHT = 0.05
"""Height over the grasp for the next look, m. Lower, the fingers hide too much."""
NEARBY_DISTANCE = 0.25
"""Distance from the target within which other objects are looked for in the same picture, m."""
MIN_SHIFT = 0.0005
"""Displacement up to which nothing has shifted, m."""
MIN_CAMERA_TURN, MAX_CAMERA_TURN = math.radians(1.0), math.radians(6.0)
"""Rotations of the target between which the error is the earlier camera's. Below the first it may be noise;
above the second the target has been moved."""


@dataclass(frozen=True, slots=True)
class ServoCorrection:
    """Correction of the target from one look."""

    moved: Pose
    """Motion in the world from the believed pose of the target to the observed one."""
    distance: float
    """Displacement of the target, m."""
    turn: float
    """Rotation of the target, rad."""

    @property
    def large(self) -> bool:
        return self.distance > LARGE_CORRECTION or self.turn > LARGE_CORRECTION_TURN


def servo_to_grasp(
    world: World,
    pick: PickPlaceCandidate,
    node: str,
    speed: float,
    *,
    first: bool = True,
    watch: Watch | None = None,
) -> Doing[PickPlaceCandidate]:
    """Move the hand over a grasp, look, and correct the grasp; the arm ends over it.

    Returns the pick with the rest of the approach. Without a camera on the hand it is unchanged. An object
    that is not recognised is grasped as believed. Fails with perception.ambiguous where two patches may be
    the target, if this is the `first` time; otherwise the grasp stays as believed. `watch` is called during
    the motion there.
    """
    camera = world.vision.hand
    if camera is None:
        return pick
    yield from world.control.settle()
    world.gripper.start(pick.grasp.opening)
    there = pick.approach.legs[0].request
    assert there is not None
    over = yield from world.plan.solve(there, node=node)
    yield from world.move.along(over.trajectory, guard=world.handling.guard, watch=watch, node=node)
    grasp = yield from _corrected(world, pick, camera, node, first=first)
    down = descend_request(world, pick.object, grasp, speed)
    plan = yield from world.plan.through((down,), node=node)
    return replace(pick, grasp=grasp, at=plan.trajectory.end, approach=plan)


def _corrected(
    world: World, pick: PickPlaceCandidate, camera: str, node: str, *, first: bool
) -> Doing[GraspCandidate]:
    """Return the grasp after looks until the last one hardly corrects it."""
    grasp = pick.grasp
    for n in range(MAX_LOOKS):
        try:
            correction = yield from look_through_hand_camera(world, pick.object, camera, node)
        except Failure as failure:
            if failure.cause is perception.AMBIGUOUS and (n > 0 or not first):
                break
            raise
        if correction is None:
            break
        grasp = replace(grasp, tcp_in_world=correction.moved @ grasp.tcp_in_world)
        if not correction.large or n == MAX_LOOKS - 1:
            break
        yield from _lower(world, pick.object, grasp, node)
    return grasp


def _lower(world: World, object_id: ObjectId, grasp: GraspCandidate, node: str) -> Doing[None]:
    """Lower the hand over the corrected grasp, for another look."""
    line = LineGoal(grasp.tcp_in_world.shifted((0.0, 0.0, LAST_LOOK_HEIGHT)))
    allowed = (("gripper", object_id),)
    request = Request(line, width=grasp.opening, allowed=allowed, scaling=world.handling.slowly)
    plan = yield from world.plan.solve(request, node=node)
    yield from world.move.along(plan.trajectory, guard=world.handling.guard, node=node)


def look_through_hand_camera(
    world: World, target: ObjectId, camera: str, node: str
) -> Doing[ServoCorrection | None]:
    """Look at an object with the camera on the hand, and correct the belief of it and of the objects around
    it.

    None: not recognised, and nothing changes. Fails with perception.ambiguous where two patches may be the
    target, and with world.unknown_object.
    """
    yield from world.control.settle()
    believed = world.scene.get(target)
    objects = [o for o in world.scene.objects if _is_around(o, believed)]
    found = yield from world.vision.track(camera, objects)
    reading = match_patches(believed, objects, found)
    if reading.target is None:
        what = "ambiguous" if reading.ambiguous else "not recognised"
        world.journal.note(event_types.ServoEvent(f"{target}: {what} from the hand", node, object=target))
    if reading.ambiguous:
        raise Failure(
            perception.AMBIGUOUS,
            f"{target} may be either of {reading.seen} things of its colour that {camera} sees",
            object=target,
            seen=reading.seen,
        )
    if reading.target is None:
        return None
    seen = reading.target.pose
    correction = ServoCorrection(
        seen @ believed.pose.inverse(), believed.pose.distance(seen), believed.pose.angle(seen)
    )
    world.journal.note(
        event_types.ServoEvent(
            f"{target}: {1000 * correction.distance:.1f} mm, {math.degrees(correction.turn):.1f}° off",
            node,
            object=target,
            distance=correction.distance,
            turn=correction.turn,
            others=len(reading.others),
            misfit=reading.target.misfit,
        )
    )
    _correct(world, believed, reading, seen)
    return correction


def _is_around(one: BeliefObject, target: BeliefObject) -> bool:
    return one.role == "item" and not one.attached and one.pose.distance(target.pose) < NEARBY_DISTANCE


def _correct(world: World, believed: BeliefObject, reading: PatchMatch, at: Pose) -> None:
    """Correct the belief by the sightings; the target was seen at `at`."""
    for sighting in (*reading.others, *((reading.target,) if reading.target else ())):
        one = world.scene.get(sighting.object)
        seen = replace(
            one,
            pose=sighting.pose,
            sigma_position=sighting.sigma_position,
            sigma_angle=sighting.sigma_angle if one.sigma_angle < math.pi else one.sigma_angle,
            last_seen=world.clock.now,
        )
        world.scene.put(seen, "seen from the hand")
    moved = _camera_correction(believed, at)
    if moved is None:
        return
    for one in world.scene.objects:
        # The same picture has shifted these objects alike.
        same_picture = one.last_seen == believed.last_seen and one.place == believed.place
        if one.role == "item" and not one.attached and same_picture:
            world.scene.put(replace(one, pose=moved @ one.pose), "moved with what was seen")


def _camera_correction(believed: BeliefObject, at: Pose) -> Pose | None:
    """Return the horizontal motion in the world that corrects the error of the earlier camera. None: there is
    no error."""
    turn = at.angle(believed.pose)
    if max(believed.pose.distance(at), turn * NEARBY_DISTANCE) < MIN_SHIFT:
        return None
    if MIN_CAMERA_TURN < turn < MAX_CAMERA_TURN and believed.sigma_angle < MIN_CAMERA_TURN:
        return at @ believed.pose.inverse()
    x, y = (a - b for a, b in zip(at.position[:2], believed.pose.position[:2], strict=True))
    return Pose((x, y, 0.0))
