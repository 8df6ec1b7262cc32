"""Planning the next motion while one goes on: computed at once, ready at a fixed simulated time."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Generic, TypeVar
from weakref import WeakKeyDictionary

from ...errors import PicktreeError
from ...world.belief.planning_scene import PlanningScene
from ...world.causes import Failure
from ...world.thinking_time import ComputeTimeAccount
from ...world.trajectory import Trajectory
from ..collision.start_tolerance import StartTolerance
from ..collision.trajectory_check import is_trajectory_free
from ..requests import JointGoal, MotionPlan, Request
from .motion_chain import split_into_legs
from .solver import RequestSolver

SAME_WIDTH = 0.002
"""Change of the fingers' opening that makes no difference, m."""


@dataclass(frozen=True, slots=True)
class CheckedBelief:
    """The belief and the hand for which a trajectory was found free."""

    version: int
    allowed: frozenset[frozenset[str]]
    """Pairs that the scene allowed to touch, beside those of the requests."""
    width: float
    """Opening of the fingers, m."""

    def covers(self, now: CheckedBelief, *, width_matters: bool) -> bool:
        """Whether what was free then is free now: nothing new is believed, and nothing allowed then is
        forbidden now."""
        same_hand = not width_matters or abs(self.width - now.width) <= SAME_WIDTH
        return self.version == now.version and self.allowed <= now.allowed and same_hand


@dataclass(frozen=True, slots=True, eq=False)
class PlanProvenance:
    """What a trajectory was planned for, and the belief in which it was found free last."""

    requests: tuple[Request, ...]
    """One motion's, or those of a chain's legs."""
    passes: tuple[float, ...]
    """When each of them ends, s."""
    seen: CheckedBelief


class PlanProvenanceStore:
    """Remembers plans for as long as somebody keeps their trajectory. Nothing of it outlives a checkpoint,
    because no plan does."""

    def __init__(self, scene: PlanningScene, width: Callable[[], float]) -> None:
        self._scene = scene
        self._width = width
        self._made: WeakKeyDictionary[Trajectory, PlanProvenance] = WeakKeyDictionary()

    def note(self, plan: MotionPlan) -> None:
        """The plan's trajectory was just found free."""
        requests = [leg.request for leg in plan.legs or (plan,)]
        passes = plan.passes or (plan.trajectory.duration,)
        known = tuple(request for request in requests if request is not None)
        if len(known) == len(passes):
            self._made[plan.trajectory] = PlanProvenance(known, passes, self.now())

    def renew(self, trajectory: Trajectory) -> None:
        """The trajectory, which need be no plan of ours, was found free in the belief as it is now."""
        made = self._made.get(trajectory)
        if made is None:
            request = Request(JointGoal(trajectory.end), trajectory.start)
            made = PlanProvenance((request,), (trajectory.duration,), self.now())
        self._made[trajectory] = replace(made, seen=self.now())

    def of(self, trajectory: Trajectory) -> PlanProvenance | None:
        """None: no plan of ours, and never found free."""
        return self._made.get(trajectory)

    def now(self) -> CheckedBelief:
        snapshot = self._scene.snapshot()
        return CheckedBelief(snapshot.version, snapshot.allowed, self._width())


T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class LookaheadResult(Generic[T]):
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


class LookaheadPlanner:
    """A second line of thought beside the one that skills wait for. It does one thing after the other.

    Nothing of it is kept in a checkpoint: what was prepared before is forgotten there.
    """

    def __init__(self, thinking: ComputeTimeAccount, now: Callable[[], float]) -> None:
        """`now`: simulated seconds."""
        self._thinking = thinking
        self._now = now
        self._free = 0.0
        self._generation = 0

    def prepare(self, steps: Generator[None, None, T], version: int) -> LookaheadResult[T]:
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
        return LookaheadResult(answer, self._free, cost, version, self._generation)

    def wait(self, prepared: LookaheadResult[T]) -> Generator[None, None, None]:
        """Yield until it is ready."""
        while self._now() < prepared.ready - 1e-9:
            yield

    def remembers(self, prepared: LookaheadResult[T]) -> bool:
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


def is_plan_free(solver: RequestSolver, plan: MotionPlan) -> bool:
    """Whether a plan's trajectory is free in the belief as it is now, by the fast checker.

    What is held now is taken as it is believed to be, where the plan supposed that object in the hand.
    """
    trajectories = split_into_legs(plan) if plan.legs else [plan.trajectory]
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
        way = StartTolerance(solver.collision, solver.start(request))
        if way.stuck or not is_trajectory_free(way, trajectory):
            return False
    return True
