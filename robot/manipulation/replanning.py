"""Replanning: monitors stop a motion whose object moves or whose place is taken, and it is planned again."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

from picktree.robot import PlaceCandidate
from picktree.robot.planning import MotionPlan
from picktree.world import BeliefObject, Cause, Failure, Pose, event_types, place, planning
from picktree.world import world as world_causes

from .release_poses import bin_target, blocked, free_drop_height
from .retreat import escape_contact

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing, Watch


MIN_TARGET_DISPLACEMENT, MIN_TARGET_ROTATION = 0.008, math.radians(12.0)
"""Distance, m, and rotation, rad, from which an object counts as moved. Less is within the camera's errors,
and the fingers allow for it."""
DISPLACEMENT_SIGMAS = 4.0
"""Displacement of an uncertain object that counts as a move, in standard deviations."""
MIN_CONFIDENCE_SHARE = 0.7
"""Share of the former confidence below which a look shows no move: the arm half hides the object."""
MAX_HEAP_GROWTH = 0.01
"""Growth of the heap that is allowed at the place of the release, m."""


class TargetMoved(Failure):
    """Failure of an approach whose object has moved (world.disturbed) or is gone (world.unknown_object)."""


class BeliefWatch(ABC):
    """Monitor of a motion, for each tick: it checks again whenever a counter of the belief has changed."""

    def __init__(self, counter: Callable[[], int]) -> None:
        self._counter, self._counted = counter, counter()

    def __call__(self) -> Failure | None:
        """Return the failure that stops the arm; None to continue."""
        before, self._counted = self._counted, self._counter()
        return None if before == self._counted else self.judged()

    @abstractmethod
    def judged(self) -> Failure | None:
        """Return the reason to stop the motion, by the present belief; None without one."""


class TargetWatch(BeliefWatch):
    """Monitor of an approach: whether the object keeps its place."""

    def __init__(self, world: World, target: BeliefObject) -> None:
        super().__init__(lambda: world.scene.version)
        self._scene, self._target = world.scene, target

    def judged(self) -> Failure | None:
        target, now = self._target, self._scene.find(self._target.id)
        if now is None:
            return TargetMoved(
                world_causes.UNKNOWN_OBJECT,
                f"{target.id} is gone: its place was seen empty while the arm was on the way",
                object=target.id,
            )
        off, turn = displacement(target, now)
        if now.confidence < MIN_CONFIDENCE_SHARE * target.confidence or (off, turn) == (0.0, 0.0):
            return None
        return TargetMoved(
            world_causes.DISTURBED,
            f"{target.id} is seen {off * 1000:.0f} mm and {math.degrees(turn):.0f}° from where it was when "
            "the arm set out",
            object=target.id,
            by=target.id,
            distance=off,
            turn=turn,
        )


def displacement(before: BeliefObject, now: BeliefObject) -> tuple[float, float]:
    """Return the displacement of an object, m and rad; zero when it may be an error of perception."""
    off, turn = before.pose.distance(now.pose), before.pose.angle(now.pose)
    unsure = math.hypot(before.sigma_position, now.sigma_position)
    unsure_turn = math.hypot(before.sigma_angle, now.sigma_angle)
    if off > max(MIN_TARGET_DISPLACEMENT, DISPLACEMENT_SIGMAS * unsure) or turn > max(
        MIN_TARGET_ROTATION, DISPLACEMENT_SIGMAS * unsure_turn
    ):
        return off, turn
    return 0.0, 0.0


class PlaceWatch(BeliefWatch):
    """Monitor of a transfer to a bin: whether there is still room at the place of the release.

    It reports place.occupied when the heap has grown, and the caller looks for another spot.
    """

    def __init__(self, world: World, held: BeliefObject, landing: PlaceCandidate) -> None:
        super().__init__(lambda: world.vision.observations)
        assert held.object_in_tcp is not None
        self._world, self._landing = world, landing
        self._held, self._in_tcp = held.id, held.object_in_tcp

    def judged(self) -> Failure | None:
        world, landing = self._world, self._landing
        held = world.scene.find(self._held)
        if held is None:
            return None
        target = bin_target(world, held, landing.into)
        if any(cell.name == landing.spot for cell in target.cells):
            drop = free_drop_height(world, target, landing.above, held.shape, self._in_tcp)
            if drop >= landing.drop - MAX_HEAP_GROWTH:
                return None
        height = float(target.heights.max())
        return Failure(
            place.OCCUPIED,
            f"something was put into {landing.into} meanwhile: its heap is {height * 1000:.0f} mm high",
            object=self._held,
            by=landing.into,
            height=height,
        )


class PutDownWatch(BeliefWatch):
    """Monitor of a transfer to a point with the TCP at `pose`: whether it is still free."""

    def __init__(self, world: World, held: BeliefObject, pose: Pose) -> None:
        super().__init__(lambda: world.scene.version)
        self._world, self._held, self._pose = world, held, pose

    def judged(self) -> Failure | None:
        by = blocked(self._world.queries, self._held, self._pose)
        if by is None:
            return None
        return Failure(
            place.OCCUPIED,
            f"{by} stands where {self._held.id} should go",
            object=self._held.id,
            by=by,
        )


T = TypeVar("T")

MAX_REPLANS = 4
"""Maximum number of replans of one skill before it fails."""


class ReplanBudget:
    """Number of replans of a skill, and their limit."""

    def __init__(self, world: World, node: str, subject: str = "", most: int = MAX_REPLANS) -> None:
        """`subject`: object of the skill, for the record."""
        self._world, self._node, self._subject = world, node, subject
        self._most = most
        self.made = 0

    def allows(self, failure: Failure, *more: Cause) -> bool:
        """Return whether a motion that failed so, with the arm at rest, may be replanned, and record
        `replanned`.

        It may after planning.blocked or one of the causes `more`.
        """
        if failure.cause not in (planning.BLOCKED, *more) or self.made >= self._most:
            return False
        self.made += 1
        self._world.journal.note(
            event_types.ReplannedEvent(
                f"stopped and planned anew: {failure.message}",
                self._node,
                object=self._subject,
                cause=failure.cause.name,
                why=failure.message,
                by=tuple(_obstacle_names(failure)),
                time=self.made,
                most=self._most,
            )
        )
        return True


def follow_with_replanning(
    world: World,
    ask: Callable[[], Doing[MotionPlan]],
    *,
    node: str,
    guard: float | None = None,
    watch: Watch | None = None,
    replans: ReplanBudget | None = None,
) -> Doing[MotionPlan]:
    """Move the arm along a requested plan; replan from its present configuration when the path is no longer
    believed to be free.

    The arm brakes on its path. An arm too close to the new obstacle moves away from it first. The number of
    replans is limited; beyond it the motion fails with planning.blocked.

    `guard` and `watch` as for `ArmMotion.along`, whose failures it raises, too.
    """
    tries = replans or ReplanBudget(world, node)
    while True:
        plan = yield from plan_after_stop(world, ask, node, after=tries.made)
        try:
            yield from world.move.along(plan.trajectory, guard=guard, watch=watch, node=node)
        except Failure as failure:
            if not tries.allows(failure):
                raise
            continue
        return plan


def plan_after_stop(world: World, ask: Callable[[], Doing[T]], node: str, *, after: int = 1) -> Doing[T]:
    """Return the plan from the present configuration. `after`: number of stops before.

    After a stop, an arm that is believed to touch something moves out of contact first.
    """
    try:
        return (yield from ask())
    except Failure as failure:
        if not after or failure.cause is not planning.START_IN_COLLISION:
            raise
    yield from escape_contact(world, node)
    return (yield from ask())


def _obstacle_names(failure: Failure) -> list[str]:
    """Return the names of the obstacles: the listed contacts, or the object."""
    found = failure.evidence.get("contacts") or failure.evidence.get("by")
    return [str(one) for one in found] if isinstance(found, list) else [str(found)] if found else []
