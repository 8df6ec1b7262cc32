"""Look-ahead planning: the next motion is planned while the present one runs. It is computed at once and
ready at a fixed simulated time.

Plan provenance records what each trajectory was planned for, so that it can be checked again.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Generic, TypeVar
from weakref import WeakKeyDictionary

from ...errors import PicktreeError
from ...world.belief.planning_scene import PlanningScene
from ...world.causes import Failure
from ...world.computing_time import ComputeTimeAccount
from ...world.trajectory import Trajectory
from ..collision.trajectory_check import StartTolerance, is_trajectory_free
from ..requests import JointGoal, MotionPlan, Request
from .motion_chain import split_into_legs
from .solver import RequestSolver

WIDTH_TOLERANCE = 0.002
"""Change of the fingers' opening that makes no difference, m."""


@dataclass(frozen=True, slots=True)
class CheckedBelief:
    """Belief and hand for which a trajectory was found free."""

    version: int
    allowed: frozenset[frozenset[str]]
    """Pairs that the scene allowed to touch, in addition to those of the requests."""
    width: float
    """Opening of the fingers, m."""

    def covers(self, now: CheckedBelief, *, width_matters: bool) -> bool:
        """Whether a trajectory that was free then is free now.

        The belief is unchanged, and no pair that was allowed then is forbidden now.
        """
        same_hand = not width_matters or abs(self.width - now.width) <= WIDTH_TOLERANCE
        return self.version == now.version and self.allowed <= now.allowed and same_hand


@dataclass(frozen=True, slots=True, eq=False)
class PlanProvenance:
    """Requests that a trajectory was planned for, and the belief in which it was found free last."""

    requests: tuple[Request, ...]
    """Request of one motion, or those of a chain's legs."""
    passes: tuple[float, ...]
    """Time at which the motion of each request ends, s."""
    seen: CheckedBelief


class PlanProvenanceStore:
    """Provenance of plans, for as long as their trajectories are referenced. None outlives a checkpoint,
    because no plan does."""

    def __init__(self, scene: PlanningScene, width: Callable[[], float]) -> None:
        self._scene = scene
        self._width = width
        self._made: WeakKeyDictionary[Trajectory, PlanProvenance] = WeakKeyDictionary()

    def note(self, plan: MotionPlan) -> None:
        """Record a plan whose trajectory was just found free."""
        requests = [leg.request for leg in plan.legs or (plan,)]
        passes = plan.passes or (plan.trajectory.duration,)
        known = tuple(request for request in requests if request is not None)
        if len(known) == len(passes):
            self._made[plan.trajectory] = PlanProvenance(known, passes, self.now())

    def renew(self, trajectory: Trajectory) -> None:
        """Record that a trajectory was found free in the present belief. It need not be a recorded plan."""
        made = self._made.get(trajectory)
        if made is None:
            request = Request(JointGoal(trajectory.end), trajectory.start)
            made = PlanProvenance((request,), (trajectory.duration,), self.now())
        self._made[trajectory] = replace(made, seen=self.now())

    def of(self, trajectory: Trajectory) -> PlanProvenance | None:
        """Return the provenance of a trajectory; None: it is no recorded plan, and was never found free."""
        return self._made.get(trajectory)

    def now(self) -> CheckedBelief:
        snapshot = self._scene.snapshot()
        return CheckedBelief(snapshot.version, snapshot.allowed, self._width())


T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class LookaheadResult(Generic[T]):
    """Result of planning ahead. `PlanService.take` returns it, not before `ready`."""

    answer: T | Failure
    ready: float
    """Simulated time from which it may be used, s."""
    cost: float
    """Simulated thinking time that it took, s."""
    version: int
    """Belief version that it was computed for."""
    generation: int
    """Number of checkpoints before it; any later checkpoint drops it."""


class LookaheadPlanner:
    """Look-ahead planner: a second line of computation next to the one that skills wait for. It does one
    thing at a time.

    Checkpoints keep nothing of it: earlier results are forgotten there.
    """

    def __init__(self, thinking: ComputeTimeAccount, now: Callable[[], float]) -> None:
        """Use `now` as the clock, simulated s."""
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
    """Whether a plan's trajectory is free in the present belief, by the fast checker.

    An object that the plan supposed in the hand is taken as it is believed to be, once it is held.
    """
    for leg, trajectory in zip(plan.legs or (plan,), split_into_legs(plan), strict=True):
        request = leg.request
        if request is None:
            return False
        request = without_held_supposition(solver, request)
        try:
            solver.look(request)
        except Failure:  # what it supposed to hold is no longer known
            return False
        way = StartTolerance(solver.collision, solver.start(request))
        if way.stuck or not is_trajectory_free(way, trajectory):
            return False
    return True


def without_held_supposition(solver: RequestSolver, request: Request) -> Request:
    """Drop the supposition of a held object that is held by now: the measured pose in the hand counts."""
    held = solver.scene(replace(request, holding=None)).held
    if held is not None and request.holding is not None and held.id == request.holding.object:
        return replace(request, holding=None)
    return request
