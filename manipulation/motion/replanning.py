"""Planning anew: what a motion in the free does when something gets into its way, instead of giving up."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, TypeVar

from ...planning.requests import MotionPlan
from ...world.causes import Cause, Failure, planning
from ...world.journal import JournalEvent
from ..retreat.clearing import escape_contact

if TYPE_CHECKING:
    from ...cell.world import World
    from ...control.execution.trajectory_motion import Watch

T = TypeVar("T")
Doing = Generator[None, None, T]

MOST = 4
"""How often one skill plans anew before it fails with what stops it."""


class ReplanBudget:
    """How often a skill has planned anew, and whether it may once more."""

    def __init__(self, world: World, node: str, subject: str = "", most: int = MOST) -> None:
        """`subject`: the object that the skill is about, for the record."""
        self._world, self._node, self._subject = world, node, subject
        self._most = most
        self.made = 0

    def allows(self, failure: Failure, *more: Cause) -> bool:
        """Whether the motion that ended so, with the arm at rest, is to be planned anew: because its way is
        blocked, or for one of the causes `more`. It is noted as an event, `replanned`."""
        if failure.cause not in (planning.BLOCKED, *more) or self.made >= self._most:
            return False
        self.made += 1
        self._world.journal.note(
            JournalEvent(
                "replanned",
                f"stopped and planned anew: {failure.message}",
                self._node,
                {
                    "object": self._subject,
                    "cause": failure.cause.name,
                    "why": failure.message,
                    "by": [*_names(failure)],
                    "time": self.made,
                    "most": self._most,
                },
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
    """Ask for a plan and follow it. When the rest of the way is no longer believed to be free, the arm brakes
    on its path, and it is asked again from where it stands, a bounded number of times; then it fails with
    planning.blocked. An arm that is believed to stand too close to what has come gets clear of it first.

    `guard` and `watch` as for `ArmMotion.along`, whose failures these are, too.
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


def plan_after_stop(world: World, ask: Callable[[], Doing[T]], node: str, *, after: int) -> Doing[T]:
    """The answer from where the arm stands `after` so many stops; if that is believed to touch something,
    from clear of it."""
    try:
        return (yield from ask())
    except Failure as failure:
        if not after or failure.cause is not planning.START_IN_COLLISION:
            raise
    yield from escape_contact(world, world.handling.slowly, node)
    return (yield from ask())


def _names(failure: Failure) -> list[str]:
    """What was in the way: the listed contacts, or the object."""
    found = failure.evidence.get("contacts") or failure.evidence.get("by")
    return [str(one) for one in found] if isinstance(found, list) else [str(found)] if found else []
