"""Replanning: a free motion whose path becomes blocked is planned and started again."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

from ...planning.requests import MotionPlan
from ...world.causes import Cause, Failure, planning
from ...world.events.skill_events import ReplannedEvent
from ..retreat.clearing import escape_contact

if TYPE_CHECKING:
    from ...cell.world import World
    from ...control.execution.trajectory_motion import Doing, Watch

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
            ReplannedEvent(
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
    """Request a plan and follow it; replan from where the arm stands when the path is no longer believed to
    be free.

    The arm brakes on its path. An arm too close to the new obstacle moves away from it first. The number of
    replans is limited; then it fails with planning.blocked.

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
    """Return the plan from where the arm stands. `after`: number of stops before.

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
