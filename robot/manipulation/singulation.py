"""Singulation: pushes that make room around an object, so that a grasp becomes possible.

The result of a push is computed beforehand, among all neighbours, with `world.quasi_static_pushing`; the
kinematic backend simulates pushes with the same model. A push is worth the grasps that are possible after it.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from picktree.robot.planning import PoseGoal, Request
from picktree.world import (
    BeliefObject,
    ObjectId,
    PlanarPushModel,
    Pose,
    Shape,
    bottom,
    extents,
    planar_geometry,
    top,
    world_facts,
)
from picktree.world.robot_model import tool_outline
from picktree.world.scene import Fixture

from .grasps import GraspCandidate, distinct_grasps
from .object_grasps import object_grasps
from .stroke_execution import SUPPORT_EDGE_MARGIN, placed, support_of, within
from .stroke_planning import PushSide, PushStroke, height, push_sides, straight, straight_stroke

if TYPE_CHECKING:
    from picktree.robot import World

PUSHED_INSTEAD_DISTANCE = 0.05
"""Border distance to the target below which an object may be pushed in its place, m."""
RELEVANT_DISTANCE = 0.25
"""Distance from the target beyond which objects do not count, m."""
PUSH_LENGTHS = (0.035, 0.055, 0.08)
"""Travel of a push beyond the first contact, m."""
CLOSED_FINGERS_OFFSET = 0.009
"""Offset of closed fingers from the middle of a side, m: the pushed object turns away from others."""
MIN_START_GAP = 0.005
"""Distance of the fingers from the object where there is no room for more, m."""
SIMULATION_STEP = 0.005
"""Travel between two simulated steps, m."""
EXTRA_GRASP_MARGIN = 0.003
"""Margin added to a grasp's margin for errors of the simulation, m."""
FIXTURE_CLEARANCE = 0.006
"""Clearance of pushed objects from bins and other fixtures, m."""
ISOLATION_DISTANCE = 0.03
"""Free distance from which an unknown object counts as isolated, m."""
START_HAND_CLEARANCE = 0.003
"""Clearance of the hand where the push begins, m."""
SURE_GRASP_VALUE, BARE_GRASP_VALUE, OTHER_GRASP_VALUE = 3.0, 1.5, 0.4
"""Values of a sure grasp of the target, of a barely possible one, and of a grasp of another object."""
FREE_DISTANCE_VALUE = 8.0
"""Value of free distance around the target, 1/m, up to `ISOLATION_DISTANCE`."""
PUSH_TRAVEL_COST, MOVED_OBJECT_COST = 2.0, 0.1
"""Costs of travel, 1/m, and of each moved object."""
MAX_EXTRA_HEIGHT, MAX_UNKNOWN_REACH = 0.015, 0.12
"""Height above the tallest item, and reach from its middle, m, beyond which an unknown object is neither an
item nor a few items."""
MIN_PUSH_VALUE = 0.1
"""Least value of a push."""
MAX_FINALISTS = 5
"""Number of best pushes whose value for other objects is computed."""


@dataclass(frozen=True, slots=True, eq=False)
class SingulationPush:
    """Push at one object with its expected result."""

    name: str
    pushed: BeliefObject
    stroke: PushStroke
    along: tuple[ObjectId, ...]
    """Other objects that the push moves."""
    there: Mapping[ObjectId, planar_geometry.PlanarPose]
    """Expected poses of all moved objects."""
    worth: float


def has_room(world: World, belief: BeliefObject) -> bool:
    """Return whether the hand fits around an object and the arm reaches that grasp.

    An unknown object must be isolated. Costs are added to the thinking account.
    """
    if belief.role != "item":
        return free_distance(world, belief) >= ISOLATION_DISTANCE
    for grasp in object_grasps(belief, world.robot.description.gripper):
        clear = world.queries.hand_clearance(
            grasp.tcp_in_world, grasp.opening, (belief.id,), grasp.margin, least=math.inf
        )
        if clear < math.inf:
            continue
        pair = (("gripper", str(belief.id)),)
        request = Request(PoseGoal((grasp.tcp_in_world,)), width=grasp.opening, allowed=pair)
        if world.plan.reached(request).q is not None:
            return True
    return False


def free_distance(world: World, belief: BeliefObject) -> float:
    """Return the free distance of an object from all others, m; inf without others."""
    return min((_between(belief, o) for o in world.scene.objects if o.id != belief.id), default=math.inf)


def _between(one: BeliefObject, other: BeliefObject) -> float:
    """Return the free distance of two objects seen from above, m."""
    return planar_geometry.outline_distance(
        planar_geometry.outline(one.shape, one.pose),
        planar_geometry.planar(one.shape, one.pose),
        planar_geometry.outline(other.shape, other.pose),
        planar_geometry.planar(other.shape, other.pose),
    )


def most_crowded_object(world: World) -> ObjectId | None:
    """Return the object that needs room most. None: all have room.

    An unknown object no larger than a few items comes first, else the item with the least room whose grasps
    are blocked.
    """
    tallest = max((_longest(e.shape) for e in world.description.catalogue), default=0.0)
    unknown = [
        o
        for o in world.scene.objects
        if o.role == "obstacle"
        and support_of(world, o) is not None
        and top(o.shape, o.pose) - bottom(o.shape, o.pose) < tallest + MAX_EXTRA_HEIGHT
        and planar_geometry.outline(o.shape, o.pose).reach < MAX_UNKNOWN_REACH
    ]
    items = [
        o
        for o in world.to_do()
        if not o.attached
        and support_of(world, o) is not None
        and world.attempts.refusal(world_facts.PUSH, o, world.scene) is None
    ]
    for group in (unknown, items):
        for o in sorted(group, key=lambda o: (free_distance(world, o), o.id)):
            if not has_room(world, o):
                return o.id
    return None


def _longest(shape: Shape) -> float:
    """Return the greatest extent of a shape, m."""
    low, high = extents(shape, np.eye(3))
    return float((high - low).max())


def singulation_pushes(world: World, target: BeliefObject) -> list[SingulationPush]:
    """Return pushes that make room around the target, best first. Their cost is added to the thinking
    account."""
    support = support_of(world, target)
    if support is None:
        return []
    near = [
        o
        for o in world.scene.objects
        if not o.attached
        and o.pose.distance(target.pose) < RELEVANT_DISTANCE
        and support_of(world, o) is support
    ]
    case = _Case(world, target, near, support)
    found = [
        one for pushed in case.candidates() for begin in _begins(world, pushed) for one in case.judged(begin)
    ]
    found.sort(key=_rank)
    # Only the best pushes are tested for grasps of other objects.
    found[:MAX_FINALISTS] = [case.with_neighbours(one) for one in found[:MAX_FINALISTS]]
    world.thinking.spend(case.checks * world.description.thinking.collision_check)
    return sorted(found, key=_rank)


def _rank(one: SingulationPush) -> tuple[float, str]:
    return (-one.worth, one.name)


class _Case:
    """Target with the objects around it."""

    def __init__(
        self, world: World, target: BeliefObject, near: Sequence[BeliefObject], support: Fixture
    ) -> None:
        self._world = world
        self._target = target
        self._support = support
        self._near = {o.id: o for o in near}
        self._shapes: dict[ObjectId, tuple[planar_geometry.PlanarOutline, planar_geometry.PlanarPose]] = {
            o.id: (planar_geometry.outline(o.shape, o.pose), planar_geometry.planar(o.shape, o.pose))
            for o in near
        }
        self._supposed = world.scene.supposing()
        from picktree.robot.planning import SceneQueries

        self._queries = SceneQueries(world.robot, self._supposed)
        self._gripper = world.robot.description.gripper
        self._grasps: dict[tuple[ObjectId, Pose], list[GraspCandidate]] = {}
        self._there: Mapping[ObjectId, planar_geometry.PlanarPose] = {}
        """Supposed poses of the moved objects."""
        self.checks = 0
        self._now = self._worth()

    def candidates(self) -> list[BeliefObject]:
        """Return the target and the objects close to it."""
        target = self._target
        others = [o for o in self._near.values() if o.id != target.id]
        return [target, *(o for o in others if _between(target, o) < PUSHED_INSTEAD_DISTANCE)]

    def judged(self, begin: Sequence[PushStroke]) -> Iterator[SingulationPush]:
        """Yield the push for each allowed length with enough value.

        It uses the first of the strokes `begin` that can begin.
        """
        stroke = next((one for one in begin if self._begins(one)), None)
        if stroke is None:
            return
        pushed = self._near[stroke.object]
        for length, there in self._slid(stroke).items():
            if pushed.id not in there or not self._may_be(there):
                continue
            with self._supposing(there):
                worth = self._worth() - self._now - PUSH_TRAVEL_COST * length - MOVED_OBJECT_COST * len(there)
            if worth < MIN_PUSH_VALUE:
                continue
            one = straight_on(stroke, length)
            along = tuple(name for name in there if name != pushed.id)
            x, y = stroke.way.start.direction
            name = f"{pushed.id} {stroke.side.name} {math.degrees(math.atan2(y, x)):.0f} deg"
            yield SingulationPush(f"{name} {length * 1000:.0f} mm", pushed, one, along, there, worth)

    def with_neighbours(self, one: SingulationPush) -> SingulationPush:
        """Return the push with its value for other objects added."""
        with self._supposing(one.there):
            after = self._graspable_neighbours()
        return replace(one, worth=one.worth + OTHER_GRASP_VALUE * (after - self._graspable_now))

    @cached_property
    def _graspable_now(self) -> int:
        return self._graspable_neighbours()

    def _graspable_neighbours(self) -> int:
        """Return the number of other items in the supposed scene around which the hand fits."""
        others = [o for name, o in self._near.items() if o.role == "item" and name != self._target.id]
        return sum(self._fits(self._supposed.get(o.id), enough=BARE_GRASP_VALUE) > 0.0 for o in others)

    @contextmanager
    def _supposing(self, there: Mapping[ObjectId, planar_geometry.PlanarPose]) -> Generator[None]:
        for name, at in there.items():
            o = self._near[name]
            self._supposed.put(replace(o, pose=planar_geometry.moved(o.shape, o.pose, at)), "supposed")
        self._there = there
        yield
        self._there = {}
        for name in there:
            self._supposed.put(self._near[name], "as it is")

    def _begins(self, stroke: PushStroke) -> bool:
        """Return whether the hand fits where the push begins, over the table."""
        world, pushed = self._world, self._near[stroke.object]
        opening = stroke.side.opening
        level = height(pushed, self._gripper, world.robot.fingers.reach(opening))
        start = stroke.way.at(-stroke.gap) @ stroke.side.tool
        if not all(
            within(self._support, start.apply(f.corners), 0.0) for f in tool_outline(self._gripper, opening)
        ):
            return False
        self.checks += 1
        tcp = stroke.tcp_at(-stroke.gap, level, flipped=False)
        return not world.queries.hand_contacts(tcp, opening, (pushed.id,), START_HAND_CLEARANCE)

    def _slid(self, stroke: PushStroke) -> dict[float, dict[ObjectId, planar_geometry.PlanarPose]]:
        """Return the poses of the moved objects for each length that keeps the tool over the table."""
        sliding = PlanarPushModel({str(name): both for name, both in self._shapes.items()})
        fingers = tool_outline(self._gripper, stroke.side.opening)
        touched: set[str] = set()
        found: dict[float, dict[ObjectId, planar_geometry.PlanarPose]] = {}
        begun = -SIMULATION_STEP
        for length in PUSH_LENGTHS:
            steps = math.ceil((length - begun) / SIMULATION_STEP)
            for k in range(1, steps + 1):
                way = begun + (length - begun) * k / steps
                at = stroke.way.at(way) @ stroke.side.tool
                touched |= sliding.press([(finger, at) for finger in fingers], deepest=math.inf)
            self.checks += steps
            begun = length
            at = stroke.way.at(length) @ stroke.side.tool
            if not all(within(self._support, at.apply(f.corners), 0.0) for f in fingers):
                break
            found[length] = {name: sliding.where(name) for name in self._near if name in touched}
        return found

    def _may_be(self, there: Mapping[ObjectId, planar_geometry.PlanarPose]) -> bool:
        """Return whether all moved objects stay on their table, and away from fixed bodies."""
        ignore = (*self._near, self._support.id)
        for name, at in there.items():
            o, (shape, _) = self._near[name], self._shapes[name]
            if not within(self._support, placed(shape, at), SUPPORT_EDGE_MARGIN):
                return False
            self.checks += 1
            if self._world.queries.free(
                o.shape, planar_geometry.moved(o.shape, o.pose, at), ignore, FIXTURE_CLEARANCE
            ):
                return False
        return True

    def _worth(self) -> float:
        """Return the value of the supposed scene for the target."""
        here = self._supposed.get(self._target.id)
        away = max(0.0, self._free_distance())
        if here.role != "item":
            return 2 * FREE_DISTANCE_VALUE * away
        return self._fits(here) + FREE_DISTANCE_VALUE * away

    def _free_distance(self) -> float:
        """Return the supposed free distance of the target from all others, m, up to `ISOLATION_DISTANCE`."""
        name, least = self._target.id, ISOLATION_DISTANCE
        shape, at = self._shapes[name]
        at = self._there.get(name, at)
        for other, (their, there) in self._shapes.items():
            there = self._there.get(other, there)
            reach = shape.reach + their.reach + least
            if other != name and math.hypot(there.x - at.x, there.y - at.y) < reach:
                least = min(least, planar_geometry.outline_distance(shape, at, their, there))
        return least

    def _fits(self, o: BeliefObject, enough: float = SURE_GRASP_VALUE) -> float:
        """Return the value of the best fit of the hand around an object; a fit of value `enough` ends the
        search."""
        worth = 0.0
        for grasp in self._distinct_grasps(o):
            self.checks += 1
            margin = grasp.margin + EXTRA_GRASP_MARGIN
            clear = self._queries.hand_clearance(
                grasp.tcp_in_world, grasp.opening, (o.id,), margin, grasp.margin
            )
            if clear >= grasp.margin:
                worth = BARE_GRASP_VALUE if clear < margin else SURE_GRASP_VALUE
                if worth >= enough:
                    return worth
        return worth

    def _distinct_grasps(self, o: BeliefObject) -> list[GraspCandidate]:
        """Return the `distinct_grasps` of an object at its supposed pose."""
        known = self._grasps.get((o.id, o.pose))
        if known is None:
            known = self._grasps[o.id, o.pose] = distinct_grasps(object_grasps(o, self._gripper))
        return known


def straight_on(stroke: PushStroke, length: float) -> PushStroke:
    """Return the same push with another length, m."""
    way = straight(stroke.way.start, length)
    return replace(stroke, way=way, ends=stroke.side.object(way.at(length)))


def _begins(world: World, belief: BeliefObject) -> Iterator[tuple[PushStroke, PushStroke]]:
    """Yield straight pushes at an object: open fingers at the middle of a side, or closed ones beside it.

    Each pair begins from a comfortable distance, and from the least one.
    """
    gripper = world.robot.description.gripper
    shape = planar_geometry.outline(belief.shape, belief.pose)
    for side in _all_sides(belief, world):
        variants: list[PushSide] = [side]
        if not shape.round:
            at, half = side.tool, min(side.half, gripper.pads[0][0].size[1])
            closed = replace(side, opening=0.0, half=half)
            asides = (
                (0.0, CLOSED_FINGERS_OFFSET, -CLOSED_FINGERS_OFFSET)
                if side.opening > 0.0
                else (CLOSED_FINGERS_OFFSET, -CLOSED_FINGERS_OFFSET)
            )
            variants += [
                replace(
                    closed,
                    name=f"{side.name} {aside * 1000:+.0f} mm",
                    tool=planar_geometry.PlanarPose(at.x, at.y + aside),
                )
                for aside in asides
            ]
        for variant in variants:
            stroke = straight_stroke(variant, belief, PUSH_LENGTHS[-1])
            yield stroke, replace(stroke, gap=min(stroke.gap, MIN_START_GAP))


def _all_sides(belief: BeliefObject, world: World) -> Iterator[PushSide]:
    gripper = world.robot.description.gripper
    if planar_geometry.outline(belief.shape, belief.pose).round:
        for k in range(0, 8, 2):
            yield from push_sides(belief, gripper, k * math.pi / 4)[:1]
        for k in range(1, 8, 2):
            yield from push_sides(belief, gripper, k * math.pi / 4)[:1]
    else:
        yield from push_sides(belief, gripper, 0.0)
