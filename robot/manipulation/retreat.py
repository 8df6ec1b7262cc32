"""Retreat: release of pressure, escape paths out of contacts, put-down of the held object, and the way
home.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from picktree.robot.control import ContactThresholds, JointImpedanceResult
from picktree.robot.planning import (
    DIRECTIONS,
    ContactPair,
    Direction,
    NamedGoal,
    OffsetGoal,
    PoseGoal,
    Request,
    Scaling,
)
from picktree.world import GRAVITY, Array, BeliefObject, Failure, Vector3, event_types, place, planning, top

from .held_object import release_held_object, support_height_at
from .pick_place_motions import DOWNWARDS
from .release_poses import blocked, put_down_poses

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing
    from picktree.robot.planning import EscapePath
    from picktree.world import Pose, Trajectory

T = TypeVar("T")
ESCAPE_SPEED = 0.05
"""Speed limit of the fastest point of arm and tool on an escape path, m/s."""
REDUCED_SPEED = 0.25
"""Speed limit on free paths, m/s: the reduced speed of ISO 10218-1."""
WARY_SPEED = 0.10
"""Speed limit on free paths after a contact with an unknown obstacle, m/s."""
ESCAPE_THRESHOLDS = ContactThresholds(torque=1.2, force=3.0)
"""Contact thresholds on an escape path."""
FIRM_ESCAPE_THRESHOLDS = ContactThresholds(torque=3.0, force=8.0)
"""Contact thresholds once every direction has met a contact: a jammed arm rubs on its way out."""
FREE_PATH_THRESHOLDS = ContactThresholds(torque=2.5, force=6.0)
"""Contact thresholds on free paths, which are faster."""
MIN_PRESSING_TORQUE = 1.5
"""External torque at rest above which something presses on the arm, Nm."""
MAX_ESCAPE_LENGTH = 0.40
"""Greatest length of an escape path, m of TCP travel."""
MAX_WAY_BACK = 0.08
"""Length of the way back along the last trajectory, m of TCP travel."""
CLEAR_DISTANCE = 0.03
"""Distance to the arm below which an obstacle is left before any other motion, m."""
CLEARING_TRAVEL = 0.10
"""Length of the motion away from it, m of TCP travel."""
MIN_ESCAPE_LENGTH = 0.01
"""Shortest useful escape path, m of TCP travel."""
MAX_ACKNOWLEDGED_STOPS = 3
"""Maximum number of safety stops that one retreat acknowledges."""
MIN_ESCAPE_COSINE = -0.3
"""Least cosine between an escape direction and the contact force; below it the direction leads into the
obstacle."""
ESCAPE_SCALING = Scaling(0.3, 0.3)


class RetreatMotion:
    """Escape motions of one retreat, with a memory of failed directions and contacts.

    All motions are under joint impedance: the arm detects contacts at any part of it and gives way. A
    direction that met a contact is not tried again.
    """

    def __init__(self, world: World, node: str, deadline: float = float("inf")) -> None:
        """`deadline`: simulated time after which no other escape path begins, s."""
        self._world = world
        self._node = node
        self._deadline = deadline
        self._spent: set[str] = set()
        self._feeling = ESCAPE_THRESHOLDS
        self._stops = 0
        self.tried: list[str] = []
        """Descriptions of the attempts that failed."""
        self.felt: Vector3 | None = None
        """Last contact force on the hand, N in the world; None without one."""
        self.pressed = False
        """Whether something pressed on the arm at rest."""
        self.touched = False
        """Whether an unexpected contact occurred during a motion."""

    @property
    def carried(self) -> Vector3:
        """Known weight of the load on the tool, N in the world."""
        return (0.0, 0.0, -GRAVITY * held_mass(self._world))

    @property
    def is_overdue(self) -> bool:
        return self._world.clock.now >= self._deadline

    def relax(self) -> Doing[float]:
        """Release the pressure of a contact at rest by giving way a little, and return the remaining external
        torque, Nm."""
        world = self._world
        pressed = world.move.pressed(self.carried)
        if pressed <= MIN_PRESSING_TORQUE:
            return pressed
        contact = np.array(world.control.wrist.force) - np.array(self.carried)
        if float(np.linalg.norm(contact)) > ESCAPE_THRESHOLDS.force:
            x, y, z = contact.tolist()
            self.felt = (x, y, z)
        self.pressed = True
        left = pressed
        for _ in range(MAX_ACKNOWLEDGED_STOPS):
            left = yield from self._stopping(world.move.give_way(self.carried, node=self._node), pressed)
            if left < pressed:
                break
        from picktree.robot.control import above_limit  # slow to import, with pinocchio

        felt = float(np.linalg.norm(contact))
        above = above_limit(felt, world.control.monitor.limits.force)
        wrist = f" and {felt:.0f} N at the wrist{above}" if above else ""
        self._note(
            f"something pressed at the arm with {pressed:.1f} Nm at its joints{wrist}; "
            f"{left:.1f} Nm are left",
            left,
        )
        return left

    def reset_directions(self) -> None:
        """Allow all directions again after a change of the belief; after a contact with higher thresholds."""
        self._spent.clear()
        if self.touched:
            self._feeling = FIRM_ESCAPE_THRESHOLDS

    def out(self) -> Doing[bool]:
        """Move out of believed contacts, and away from a contact that was measured.

        False: no direction leads out, or none is safe.
        """
        world = self._world
        if self.pressed or self.touched:
            # The path that the arm came along was free a moment ago, independent of the belief.
            yield from self._back()
        while (contacts := world.plan.contacts()) and not self.is_overdue:
            way = self._best(contacts)
            if way is None:
                return False
            if (yield from self._go(way)):
                # The arm should be free there. Otherwise another direction must do better.
                self._spent.add(way.direction)
        yield from world.plan.charge()
        return not contacts

    def up(self, way: float = CLEARING_TRAVEL, *, always: bool = False) -> Doing[None]:
        """Move away from nearby obstacles: upwards, or another direction with room.

        Without a nearby obstacle the arm stays, unless `always`. `way`: length, m of TCP travel.
        """
        world = self._world
        with world.plan.checking():
            outward = world.plan.outward()
            nearest = world.plan.solver.collision.nearest(world.control.held_position, CLEAR_DISTANCE)
        if nearest is None and not always:
            return
        directions: tuple[Direction, ...] = ("up", "back", "inwards")
        for direction in directions:
            if direction in self._spent or self.is_overdue:
                continue
            with world.plan.checking():
                found = outward.way(direction, way, until_free=False)
            yield from world.plan.charge()
            if found.length < MIN_ESCAPE_LENGTH:
                self.tried.append(f"{direction}: {found.ended_by}")
                continue
            if (yield from self._go(found)):
                return
            with world.plan.checking():
                outward = world.plan.outward()  # a contact has ended the motion on its way

    def handle_contact(self, result: JointImpedanceResult, where: str) -> Doing[None]:
        """Record a contact on a free path, and move back a little along the last trajectory."""
        self._record_contact(result)
        self.tried.append(f"{where}: touched something ({_sizes(result)})")
        yield from self._back()

    def _back(self) -> Doing[None]:
        """Move back a little along the last trajectory, as far as no distance to a believed obstacle
        decreases."""
        world = self._world
        back = world.move.way_back()
        if back is None or "the way it came" in self._spent:
            return
        path = [back.position[0]]
        length = 0.0
        for q in back.position[1:]:
            length += world.robot.tcp(path[-1]).distance(world.robot.tcp(q))
            path.append(q)
            if length >= MAX_WAY_BACK:
                break
        with world.plan.checking():
            way = world.plan.outward().along("the way it came", np.array(path))
        yield from world.plan.charge()
        if len(way.path) > 1:
            yield from self._go(way)

    def _best(self, contacts: tuple[ContactPair, ...]) -> EscapePath | None:
        """Return the first escape path that leads out, in the order of directions that have not failed. None:
        no such path."""
        world = self._world
        names = ", ".join(dict.fromkeys(f"{c.a} at {c.b}" for c in contacts[:3]))
        with world.plan.checking():
            outward = world.plan.outward()
            for direction in self._in_order(outward.heading):
                found = outward.way(direction, MAX_ESCAPE_LENGTH)
                if found.free and len(found.path) > 1:
                    return found
                self._spent.add(direction)
                self.tried.append(f"{direction} from {names}: {found.ended_by or 'no way'}")
        return None

    def _in_order(self, heading: Callable[[Direction], Array]) -> list[Direction]:
        """Return the directions that have not failed, without those against the last contact force on the
        hand."""
        left: list[Direction] = [d for d in DIRECTIONS if d not in self._spent]
        if self.felt is None:
            return left
        push = np.array(self.felt)
        push = push / max(float(np.linalg.norm(push)), 1e-9)
        along = {d: float(heading(d) @ push) for d in left}
        return [d for d in left if along[d] >= MIN_ESCAPE_COSINE]

    def _go(self, way: EscapePath) -> Doing[bool]:
        """Move slowly along an escape path; False: a contact ended it."""
        # The module loads slowly, and few retreats need it.
        from picktree.robot.planning import time_corners, time_smooth

        world = self._world
        timed = time_smooth(world.robot, way.path, ESCAPE_SCALING) or time_corners(
            world.robot, way.path, ESCAPE_SCALING, 0.005
        )
        if timed is None:
            self._spent.add(way.direction)
            self.tried.append(f"{way.direction}: the joints cannot follow it")
            return False
        result = yield from self.follow(world.move.slowed(timed, ESCAPE_SPEED), self._feeling, leaving=True)
        if result.completed:
            return True
        self._record_contact(result)
        self._spent.add(way.direction)
        self.tried.append(f"{way.direction}: touched something ({_sizes(result)})")
        return False

    def follow(
        self, trajectory: Trajectory, least: ContactThresholds, *, leaving: bool = False
    ) -> Doing[JointImpedanceResult]:
        """Follow a trajectory under joint impedance. A safety stop counts as a contact, and is acknowledged a
        few times."""
        moving = self._world.move.softly(
            trajectory, least, carried=self.carried, node=self._node, leaving=leaving
        )
        stopped = JointImpedanceResult(False, 0.0, True, 0.0, 0.0)
        return (yield from self._stopping(moving, stopped))

    def _stopping(self, doing: Doing[T], otherwise: T) -> Doing[T]:
        """Return the result of `doing`, or `otherwise` when a safety stop ends it."""
        world = self._world
        try:
            return (yield from doing)
        except Failure:
            stop = world.control.monitor.stopped
            if stop is None:
                raise
            self._stops += 1
            if self._stops > MAX_ACKNOWLEDGED_STOPS:
                raise
        yield from world.move.rest()
        if not world.control.monitor.acknowledge(self._node):
            raise Failure(stop.cause, stop.message, **stop.evidence)
        message = f"{stop.cause}: {stop.message}, on the way out"
        world.journal.note(event_types.SafetyAcknowledgedEvent(message, self._node))
        return otherwise

    def _record_contact(self, result: JointImpedanceResult) -> None:
        self.touched = True
        if float(np.linalg.norm(result.push)) > ESCAPE_THRESHOLDS.force / 2:
            self.felt = result.push

    def _note(self, message: str, left: float) -> None:
        self._world.journal.note(event_types.GaveWayEvent(message, self._node, left=round(left, 2)))


def held_mass(world: World) -> float:
    """Return the mass of the held object, kg: weighed, else by the catalogue."""
    held = world.scene.held
    if held is None:
        return 0.0
    payload = world.control.wrist.payload
    if payload is not None:
        return payload.mass
    entry = world.description.find_entry(held.kind)
    return 0.0 if entry is None else entry.mass


def _sizes(result: JointImpedanceResult) -> str:
    return f"{result.torque:.1f} Nm at the joints, {result.force:.0f} N at the wrist"


def escape_contact(world: World, node: str) -> Doing[None]:
    """Move the arm out of believed contacts, slowly and with decreasing depths, and up from nearby obstacles.

    Without an escape path nothing happens; the next plan then fails with the reason.
    """
    leaving = RetreatMotion(world, node)
    yield from leaving.relax()
    if (yield from leaving.out()):
        yield from leaving.up()


MAX_HOMING_ATTEMPTS = 4
"""Maximum number of attempts to plan and follow a path home."""
DETOUR_LENGTH = 0.15
"""Length of the motion away from an obstacle before the next attempt, m of TCP travel."""
AT_POSE_TOLERANCE = 2e-3
"""Greatest joint distance to the named pose at which the arm is there, rad."""


def go_home(world: World, leaving: RetreatMotion, pose: str, scaling: Scaling, node: str) -> Doing[bool]:
    """Move the arm to a named pose. False: there is no safe path; `leaving.tried` has the attempts."""
    looked = yield from observe_with_fixed_cameras(world)
    for attempt in range(MAX_HOMING_ATTEMPTS):
        if leaving.is_overdue:
            return False
        if attempt:
            looked = yield from observe_with_fixed_cameras(world)
        try:
            key = node if attempt == 0 else f"{node} again {attempt}"
            plan = yield from world.plan.to(NamedGoal(pose), scaling=scaling, node=key)
            wary = leaving.touched or not looked
            trajectory = world.move.slowed(plan.trajectory, WARY_SPEED if wary else REDUCED_SPEED)
            result = yield from leaving.follow(trajectory, FREE_PATH_THRESHOLDS)
        except Failure as failure:
            if not failure.cause.name.startswith("planning."):
                raise
            leaving.tried.append(f"to {pose}: {failure.message}")
            if failure.cause is planning.GOAL_IN_COLLISION:
                return False
            yield from leaving.out()
            yield from leaving.up(DETOUR_LENGTH, always=True)
            continue
        if result.completed:
            yield from _move_to_exact_pose(world, pose, scaling, node)
            return True
        if result.noticed is not None:
            leaving.tried.append(f"to {pose}: {result.noticed.message}")
            continue
        yield from leaving.handle_contact(result, f"to {pose}")
        yield from leaving.out()
        yield from leaving.up(DETOUR_LENGTH, always=True)
    return False


def observe_with_fixed_cameras(world: World) -> Doing[bool]:
    """Take an image with every camera that is not on the hand, and return whether one was obtained.

    A camera without an image is skipped.
    """
    seen = False
    for camera in world.description.cameras:
        if camera.on == "hand":
            continue
        try:
            yield from world.vision.observe(camera.name)
            seen = True
        except Failure as failure:
            if not failure.cause.name.startswith("perception."):
                raise
    return seen


def _move_to_exact_pose(world: World, pose: str, scaling: Scaling, node: str) -> Doing[None]:
    """Move the rest of the way with the stiff servo: the soft spring leaves an error."""
    off = float(np.abs(world.control.state.position - world.robot.named(pose)).max())
    if off < AT_POSE_TOLERANCE:
        return
    plan = yield from world.plan.to(NamedGoal(pose), scaling=scaling, node=node)
    yield from world.move.along(plan.trajectory, guard=world.handling.guard, node=node)


SPOT_RING_RADII = (0.0, 0.05, 0.10, 0.16, 0.24)
"""Distances from the object at which spots are tried, m."""
SPOTS_PER_RING = 8
"""Spots on each ring."""
MAX_SPOT_ATTEMPTS = 4
"""Maximum number of free spots to which a path is planned."""
LEVEL_RADIUS = 0.05
"""Distance from the middle of a spot within which the fixture must be level, m."""
LEVEL_TOLERANCE = 0.001
"""Height by which a fixture may exceed the support and still count as level with it, m."""
HAND_SPOT_CLEARANCE = 0.01
"""Clearance of the hand at a spot, m."""
LOWERING_SPARE = 0.02
"""Travel of the lowering beyond the believed distance to the support, m."""


def put_down(world: World, leaving: RetreatMotion, scaling: Scaling, node: str) -> Doing[None]:
    """Lower the held object onto a free spot of a fixture near it, until contact, and release it.

    Fails with place.occupied where there is no such spot; the object is then still in the hand.
    """
    held = world.scene.held
    if held is None:
        return
    seen = yield from observe_with_fixed_cameras(world)
    why = "no spot near it is free"
    tries = 0
    for spot in _free_spots(world, held):
        if tries == MAX_SPOT_ATTEMPTS or leaving.is_overdue:
            break
        tries += 1
        assert held.object_in_tcp is not None
        over = tuple(
            pose.shifted((0.0, 0.0, world.handling.approach))
            for pose in put_down_poses(spot, held.shape, held.object_in_tcp)
            if _hand_has_room(world, held, pose, spot[2])
        )
        try:
            plan = yield from world.plan.to(PoseGoal(over), scaling=scaling, node=node)
            lowering = _lowering(world, held, spot[2], plan.trajectory.end)
            yield from world.plan.solve(lowering, node=node)
            wary = leaving.touched or not seen
            way = world.move.slowed(plan.trajectory, WARY_SPEED if wary else REDUCED_SPEED)
            result = yield from leaving.follow(way, FREE_PATH_THRESHOLDS)
        except Failure as failure:
            if not failure.cause.name.startswith("planning."):
                raise
            why = failure.message
            continue
        if not result.completed:
            yield from leaving.handle_contact(result, f"to a spot for {held.id}")
            why = "something is in the way to it"
            continue
        yield from _lower(world, held, node)
        yield from leaving.up()
        return
    raise Failure(
        place.OCCUPIED,
        f"{held.id} cannot be put down: {why}; it is still in the hand",
        object=held.id,
        spots=tries,
    )


def _lowering(world: World, held: BeliefObject, height: float, start: Array) -> Request:
    """Return the request straight down from `start` (n,), rad, to a support at `height` m.

    The wrist does not feel contacts of the arm itself. So the whole arm must have room on the line before a
    guarded move follows it. Its end, where the object touches, is left out.
    """
    handling = world.handling
    down = OffsetGoal((0.0, 0.0, handling.felt_way - handling.approach))
    pairs = tuple((part, board) for board in _boards(world, height) for part in ("gripper", str(held.id)))
    return Request(down, start, allowed=pairs, scaling=handling.slowly)


def _lower(world: World, held: BeliefObject, node: str) -> Doing[None]:
    """Lower the object until contact, and release it."""
    handling = world.handling
    yield from world.move.guarded(
        DOWNWARDS,
        handling.approach + LOWERING_SPARE,
        force=handling.touch,
        speed=handling.touch_speed,
        node=node,
    )
    resting = world.scene.get(held.id).pose
    yield from release_held_object(world, held, resting, "table", "put down by a retreat")
    world.journal.note(event_types.PutDownEvent(f"{held.id} is put down", node, object=held.id))


def _free_spots(world: World, held: BeliefObject) -> Iterator[Vector3]:
    """Yield free points on fixtures for the object's underside, nearest first."""
    assert held.object_in_tcp is not None
    x, y, _ = held.pose.position
    for ring in SPOT_RING_RADII:
        for k in range(SPOTS_PER_RING if ring else 1):
            angle = 2 * math.pi * k / SPOTS_PER_RING
            at = (x + ring * math.cos(angle), y + ring * math.sin(angle))
            height = _level_height(world, at)
            if height is None:
                continue
            spot = (*at, height)
            poses = put_down_poses(spot, held.shape, held.object_in_tcp)
            if blocked(world.queries, held, poses[0]) is None and any(
                _hand_has_room(world, held, p, height) for p in poses
            ):
                yield spot


def _hand_has_room(world: World, held: BeliefObject, tcp_in_world: Pose, height: float) -> bool:
    """Return whether the hand has room there with the fingers opened for the release; `height` of the
    support, m."""
    opened = min(world.gripper.width + world.handling.release, world.robot.description.gripper.max_width)
    ignored = (str(held.id), *_boards(world, height))
    return not world.queries.hand_contacts(tcp_in_world, opened, ignored, margin=HAND_SPOT_CLEARANCE)


def _boards(world: World, height: float) -> tuple[str, ...]:
    """Return the names of the fixtures that are not higher than the support at `height` m."""
    fixtures = world.scene.fixtures.items()
    return tuple(str(name) for name, f in fixtures if top(f.shape, f.pose) <= height + LEVEL_TOLERANCE)


def _level_height(world: World, at: tuple[float, float]) -> float | None:
    """Return the height of the support below a point. None: it is not level around the point."""
    x, y = at
    around = [
        (0.0, 0.0),
        (LEVEL_RADIUS, 0.0),
        (-LEVEL_RADIUS, 0.0),
        (0.0, LEVEL_RADIUS),
        (0.0, -LEVEL_RADIUS),
    ]
    heights = [support_height_at(world.scene, x + dx, y + dy) for dx, dy in around]
    return heights[0] if len(set(heights)) == 1 else None
