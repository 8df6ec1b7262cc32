"""Planning the next motion while one goes on: computed at once, ready at a fixed simulated time."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from ...errors import PicktreeError
from ...world.causes import Failure
from ...world.thinking_time import ThinkingAccount
from ..collision.start_tolerance import Way
from ..collision.trajectory_check import stays_free
from ..requests import Plan
from .motion_chain import parts
from .solver import Solver

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Prepared(Generic[T]):
    """What planning ahead came to. `PlanService.take` hands it out, not before `ready`."""

    answer: T | Failure
    ready: float
    """Simulated time at which it may be known, s."""
    cost: float
    """Simulated seconds of thinking that it took."""
    version: int
    """Of the belief that it was computed for."""
    generation: int
    """Which checkpoints it has seen: those that come later drop it."""


class Ahead:
    """A second line of thought beside the one that skills wait for. It does one thing after the other.

    Nothing of it is kept in a checkpoint: what was prepared before is forgotten there.
    """

    def __init__(self, thinking: ThinkingAccount, now: Callable[[], float]) -> None:
        """`now`: simulated seconds."""
        self._thinking = thinking
        self._now = now
        self._free = 0.0
        self._generation = 0

    def prepare(self, steps: Generator[None, None, T], version: int) -> Prepared[T]:
        """Compute `steps` at once, without letting time pass. They may wait for nothing but thinking."""
        thinking = self._thinking
        owed, before = thinking.owed, thinking.total
        thinking.owed = 0.0
        answer: T | Failure
        try:
            answer = self._finished(steps, before)
        except Failure as failure:
            answer = failure
        finally:
            cost = thinking.total - before
            thinking.owed = owed
        self._free = max(self._free, self._now()) + cost
        return Prepared(answer, self._free, cost, version, self._generation)

    def wait(self, prepared: Prepared[T]) -> Generator[None, None, None]:
        """Yield until it is ready."""
        while self._now() < prepared.ready - 1e-9:
            yield

    def remembers(self, prepared: Prepared[T]) -> bool:
        """Whether no checkpoint has come since."""
        return prepared.generation == self._generation

    def forget(self) -> None:
        """Drop what was prepared, as a checkpoint does."""
        self._free = 0.0
        self._generation += 1

    def _finished(self, steps: Generator[None, None, T], before: float) -> T:
        thinking = self._thinking
        paid = 0.0
        while True:
            try:
                next(steps)
            except StopIteration as end:
                return end.value
            paid += thinking.tick
            if paid > thinking.total - before + 1e-9:
                steps.close()
                raise PicktreeError("only planning can be done ahead: these steps wait for something else")


def still_free(solver: Solver, plan: Plan) -> bool:
    """Whether a plan's trajectory is free in the belief as it is now, by the fast checker.

    What is held now is taken as it is believed to be, where the plan supposed that object in the hand.
    """
    trajectories = parts(plan) if plan.legs else [plan.trajectory]
    for leg, trajectory in zip(plan.legs or (plan,), trajectories, strict=True):
        request = leg.request
        if request is None:
            return False
        held = solver.scene(replace(request, holding=None)).held
        if held is not None and request.holding is not None and held.id == request.holding.object:
            request = replace(request, holding=None)
        try:
            solver.look(request)
        except Failure:  # what it supposed to hold is no longer known
            return False
        way = Way(solver.collision, solver.start(request))
        if way.stuck or not stays_free(way, trajectory):
            return False
    return True
