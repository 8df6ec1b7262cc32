"""Held object: whether it is held, by opening of the fingers, load on the wrist and catalogue; and its
release.

The release is the counterpart of the grip check: the fingers open, and the load shows that the object is
gone. The load of a light object gives no evidence; the opening then decides both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from picktree.world import (
    FALLEN_SIGMA,
    GRAVITY,
    Array,
    BeliefObject,
    Box,
    CompoundMesh,
    ConvexMesh,
    Cylinder,
    Failure,
    ObjectId,
    PlanningScene,
    Pose,
    Sphere,
    bottom,
    convex_hull,
    extents,
    grasp,
    top,
)
from picktree.world.robot_model import GripperDescription
from picktree.world.scene import MIN_DETECTABLE_MASS

from .grasps import contacts_at
from .pick_place_motions import lift_off

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing
    from picktree.world import Cause

PUT_BACK = "it is a part of the heap again"
"""Reason why a thing leaves the belief when it is put back into a heap."""
DROPPED_CONFIDENCE = 0.3
"""Confidence in the estimated pose until the object is seen again."""


def open_gripper(world: World, reason: str, width: float | None = None) -> Doing[None]:
    """Open the fingers, by default fully, and remove the held object from the hand in the belief.

    A halt does the same: the fingers keep opening.
    """
    try:
        yield from world.gripper.open(width)
    except GeneratorExit:
        release_object(world.scene, reason)
        raise
    release_object(world.scene, reason)


def release_object(scene: PlanningScene, reason: str, *, left_at: Pose | None = None) -> None:
    """Detach the held object, and believe it at `left_at` in the world.

    By default it is straight below the hand, on the highest fixture or bin floor there. Over a heap it
    becomes a part of that.
    """
    held = scene.held
    if held is None:
        return
    if left_at is not None:
        held = replace(held, pose=left_at)
    x, y, z = held.pose.position
    support, place = support_height_at(scene, x, y) or 0.0, "table"
    for bin_ in scene.bins.values():
        local = bin_.pose.inverse().apply(np.array([x, y, z]))
        if abs(float(local[0])) <= bin_.size[0] / 2 and abs(float(local[1])) <= bin_.size[1] / 2:
            support, place = bin_.pose.position[2] + bin_.wall, bin_.id
    fallen = held.pose.shifted((0.0, 0.0, support - bottom(held.shape, held.pose)))
    if any(region.covers(np.array([fallen.position]))[0] for region in scene.regions.values()):
        scene.remove(held.id, PUT_BACK)
        return
    scene.put(
        replace(
            held,
            object_in_tcp=None,
            pose=fallen,
            place=place,
            confidence=DROPPED_CONFIDENCE,
            sigma_position=FALLEN_SIGMA,
        ),
        reason,
    )


def support_height_at(scene: PlanningScene, x: float, y: float) -> float | None:
    """Return the height of the highest fixture's top at a point of the world, never below 0. None: no
    fixture."""
    highest: float | None = None
    for fixture in scene.fixtures.values():
        if isinstance(fixture.shape, Box):
            local = fixture.pose.inverse().apply(np.array([x, y, fixture.pose.position[2]]))
            size = fixture.shape.size
            if abs(float(local[0])) <= size[0] / 2 and abs(float(local[1])) <= size[1] / 2:
                highest = max(highest or 0.0, top(fixture.shape, fixture.pose))
    return highest


MAX_EMPTY_WIDTH = 0.002
"""Opening up to which the fingers hold nothing, m."""
MIN_HELD_LOAD = 0.012 * GRAVITY
"""Least load that counts as held, N: the weight of 12 g."""
MAX_OPENING_ERROR = 0.004
"""Greatest difference between the opening around a light object and one of the object's widths, m."""
MAX_UNEXPECTED_MASS = 0.04
"""Greatest mass by which a light object may seem heavier than its kind, kg: sensors err, objects differ."""
MIN_RELEASED_SHARE = 0.5
"""Share of the load that must be gone after a release."""
RELEASED_OPENING_SHARE = 0.33
"""Share of a release's opening from which an object in the air falls."""
MAX_FALL_TICKS = 3
"""Ticks in which the load of a falling object leaves the hand."""


@dataclass(frozen=True, slots=True)
class LightObject:
    """Object between the fingers whose weight the wrist cannot feel, by the catalogue."""

    mass: float
    """Catalogue mass, kg."""
    widths: tuple[float, ...]
    """Openings at which the fingers may hold it, m."""

    def fits(self, width: float, load: float | None) -> bool:
        """Return whether opening, m, and load, N, are those of this object."""
        weight = (self.mass + MAX_UNEXPECTED_MASS) * GRAVITY
        return (load is None or load <= weight) and any(
            abs(width - own) <= MAX_OPENING_ERROR for own in self.widths
        )


@dataclass(frozen=True, slots=True)
class GripCheck:
    """Measurement of the hand: opening, m, and load since the last tare, N. None: load not measured."""

    width: float
    load: float | None
    light: LightObject | None = None
    """Believed object, where its weight cannot be felt. None: the load has to show it."""
    thin: bool = False
    """Whether the object may be too thin to be distinguished from an empty hand by its width."""

    @property
    def empty(self) -> bool:
        """Whether the fingers have met, and no load shows that a thin object is between them."""
        felt = self.thin and self.load is not None and self.load >= MIN_HELD_LOAD
        return self.width <= MAX_EMPTY_WIDTH and not felt

    @property
    def loaded(self) -> bool:
        """Whether the hand carries the object, by its load, or by its width where that is too light. True
        when the load was not measured."""
        if self.light is not None:
            return self.light.fits(self.width, self.load)
        return self.load is None or self.load >= MIN_HELD_LOAD

    @property
    def held(self) -> bool:
        return not self.empty and self.loaded

    @property
    def mass(self) -> float | None:
        """Mass of the held object, kg: the catalogue's where it cannot be felt. None: not measured."""
        if self.light is not None:
            return self.light.mass
        return None if self.load is None else self.load / GRAVITY

    def __str__(self) -> str:
        """Return `opening 40.2 mm, load 1.18 N`, without a minus before a zero."""
        return f"opening {self.width * 1000:.1f} mm, load {round(self.load or 0.0, 2) + 0.0:.2f} N"


def check_grip(world: World, load: float | None) -> GripCheck:
    """Return the grip check of the believed held object for the present opening and a measured load, N."""
    held = world.scene.held
    thin = held is not None and (held.kind == "unknown" or isinstance(held.shape, CompoundMesh))
    return GripCheck(world.gripper.width, load, _light_object(world), thin)


def measure_grip(world: World) -> Doing[GripCheck]:
    """Measure opening and load at rest."""
    yield from world.control.settle()
    return check_grip(world, world.control.load())


def _light_object(world: World) -> LightObject | None:
    """Return the believed held object if its kind is too light to be felt."""
    held = world.scene.held
    entry = None if held is None else world.description.find_entry(held.kind)
    if held is None or entry is None or entry.mass >= MIN_DETECTABLE_MASS:
        return None
    return LightObject(entry.mass, _widths(held, world.robot.description.gripper, world.gripper.width))


def _widths(held: BeliefObject, gripper: GripperDescription, width: float) -> tuple[float, ...]:
    """Return the openings at which fingers may hold an object, m; flat pads turn it until it fits.

    `width`: their opening, m. A body that is not convex may be held by a wall.
    """
    match held.shape:
        case Box(size):
            return size
        case Cylinder(radius, height):
            return (2 * radius, height)
        case Sphere(radius):
            return (2 * radius,)
        case ConvexMesh():
            assert held.object_in_tcp is not None
            if isinstance(held.shape, CompoundMesh):
                around = width + 2 * MAX_OPENING_ERROR
                met = contacts_at(held.shape, held.object_in_tcp, gripper, around)
                return () if met is None else (met.width,)
            low, high = extents(held.shape, held.object_in_tcp.rotation())
            return (float(high[1] - low[1]),)


def inflated_hull(points: Array, margin: float) -> Array:
    """Return the corners (k, 3) of the hull of points (n, 3), inflated by `margin` m along each axis."""
    corners = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]) * margin
    points = (points[:, None, :] + corners[None, :, :]).reshape(-1, 3)
    return points[np.sort(convex_hull(points).vertices)]


def mesh_of(points: Array) -> tuple[ConvexMesh, Pose]:
    """Return the body with these corners (k, 3), and the pose of its middle in their frame."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    vertices = tuple((float(a), float(b), float(c)) for a, b, c in points - middle)
    return ConvexMesh(vertices, "seen"), Pose((float(middle[0]), float(middle[1]), float(middle[2])))


def is_in_hand(world: World, object_id: ObjectId, node: str) -> Doing[bool]:
    """Return whether the hand holds the object already. An object without load is lifted off first.

    Raises grasp.no_candidate when the hand holds another object, and grasp.slipped when the believed object
    is not felt.
    """
    held = world.scene.held
    if held is None:
        return False
    if held.id != object_id:
        raise Failure(
            grasp.NO_CANDIDATE, f"the hand is not free: it holds {held.id}", object=object_id, held=held.id
        )
    hold = yield from measure_grip(world)
    if not hold.empty and not hold.loaded:
        # The object between the fingers may touch or be inside another body.
        yield from lift_off(world, node)
        hold = yield from measure_grip(world)
    if hold.held:
        return True
    release_object(world.scene, "no longer felt in the hand")
    raise Failure(
        grasp.SLIPPED,
        f"{object_id} was in the hand and is gone: opening {hold.width * 1000:.1f} mm",
        object=object_id,
        width=hold.width,
        load=hold.load,
    )


def check_held_object(world: World, object_id: ObjectId) -> Doing[tuple[BeliefObject, GripCheck]]:
    """Measure the grip at rest, and return the held object with it.

    Raises Failure(grasp.slipped) when the hand holds another object, or none.
    """
    held = world.scene.held
    if held is None or held.id != object_id:
        raise Failure(
            grasp.SLIPPED,
            f"{object_id} is not in the hand",
            object=object_id,
            held=held.id if held else None,
        )
    hold = yield from measure_grip(world)
    if not hold.held:
        yield from fail_as_slipped(world, object_id, hold, "was lost on the way")
    return held, hold


def fail_as_slipped(world: World, object_id: ObjectId, hold: GripCheck, what: str) -> Doing[None]:
    """Remove the object from the hand in the belief, open the fingers and raise Failure(grasp.slipped)."""
    release_object(world.scene, "no longer felt in the hand")
    world.control.wrist.carry(None)
    yield from world.gripper.open()
    raise Failure(
        grasp.SLIPPED, f"{object_id} {what} ({hold})", object=object_id, width=hold.width, load=hold.load
    )


def release_held_object(
    world: World, held: BeliefObject, resting: Pose, place: str, reason: str, *, share: float = 1.0
) -> Doing[None]:
    """Open the fingers around the held object, and believe it at `resting` in the world, in `place`.

    It ends when that `share` of the opening is reached. A halt does the same: the fingers keep opening.
    """
    control, loaded = world.control, np.array(world.control.wrist.force)

    def pressed() -> bool:
        # The fingers may push something that leans on them; what they let go of changes the load.
        change = float(np.linalg.norm(control.wrist.force - loaded))
        return change > world.handling.guard + float(np.linalg.norm(loaded))

    try:
        yield from world.gripper.release(world.handling.release, share, pressed)
    except GeneratorExit:
        world.scene.detach(held.id, resting, place, "let go")
        raise
    world.control.wrist.carry(None)
    world.scene.detach(held.id, resting, place, reason)


def drop_held_object(
    world: World, held: BeliefObject, resting: Pose, before: float, place: str
) -> Doing[bool]:
    """Let the held object fall, and return whether its load, `before` N, has left the hand.

    The arm is at rest. The fingers keep opening.
    """
    yield from release_held_object(world, held, resting, place, "placed", share=RELEASED_OPENING_SHARE)
    for _ in range(MAX_FALL_TICKS):
        if is_released(before, world.control.load(world.tick)):
            return True
        yield
    return False


def is_released(before: float, after: float) -> bool:
    """Return whether the change of the load on the wrist, N, shows a release by open fingers.

    A load that is too small to be felt does not contradict them.
    """
    return before < MIN_DETECTABLE_MASS * GRAVITY or before - after >= MIN_RELEASED_SHARE * before


def confirm_release(
    world: World, held: BeliefObject, before: float, missed: Cause, **where: str
) -> Doing[None]:
    """Check at rest that the load of the hanging object, `before` N, is gone from the hand.

    Raises `missed` when it is not, with the evidence `where`; the belief is then as before the release.
    """
    yield from world.control.settle()
    after = world.control.load()
    if not is_released(before, after):
        world.scene.put(held, "still felt in the open hand")
        raise Failure(
            missed,
            f"{held.id} still hangs on the open fingers (load {before:.2f} N, then {after:.2f} N)",
            object=held.id,
            **where,
            load_before=before,
            load_after=after,
        )
