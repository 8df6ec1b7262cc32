"""Look-ahead planning: the next motion is planned while the present one runs. It is ready at a fixed
simulated time.

Plan provenance records what each trajectory was planned for, so that it can be checked again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

from ...world.belief.planning_scene import PlanningScene
from ...world.causes import Failure
from ...world.trajectory import Trajectory
from .motion_chain import split_into_legs
from .planning_worker import ChainAnswer, ChainOrder, PlanningWorker
from .requests import WIDTH_TOLERANCE, JointGoal, MotionPlan, Request
from .solver import RequestSolver
from .trajectory_check import StartTolerance, is_trajectory_free


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

    def note(self, plan: MotionPlan, seen: CheckedBelief | None = None) -> None:
        """Record a plan whose trajectory was found free in the belief `seen`; None: just now."""
        requests = [leg.request for leg in plan.legs or (plan,)]
        passes = plan.passes or (plan.trajectory.duration,)
        known = tuple(request for request in requests if request is not None)
        if len(known) == len(passes):
            self._made[plan.trajectory] = PlanProvenance(known, passes, seen or self.now())

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


@dataclass(frozen=True, slots=True, eq=False)
class LookaheadOutcome:
    """Answer with its cost and the time from which it may be used, simulated s."""

    answer: ChainAnswer
    cost: float
    ready: float


class LookaheadResult:
    """Result of planning ahead. `PlanService.take` returns it, not before `ready`.

    Reading it waits, in wall time, for the planning worker.
    """

    def __init__(
        self, order: ChainOrder, asked: float, generation: int, resolve: Callable[[LookaheadResult], None]
    ) -> None:
        """Arguments: `asked`, the simulated time of the order, s. `resolve` sets the outcome."""
        self.order = order
        self.asked = asked
        self.generation = generation
        """Number of checkpoints before it; any later checkpoint drops it."""
        self.outcome: LookaheadOutcome | None = None
        self._resolve = resolve

    @property
    def answer(self) -> MotionPlan | Failure:
        return self._resolved.answer.plan

    @property
    def cost(self) -> float:
        """Simulated thinking time that it took, s."""
        return self._resolved.cost

    @property
    def ready(self) -> float:
        """Simulated time from which it may be used, s."""
        return self._resolved.ready

    @property
    def version(self) -> int:
        """Belief version that it was computed for."""
        return self.order.belief.version

    @property
    def _resolved(self) -> LookaheadOutcome:
        if self.outcome is None:
            self._resolve(self)
        assert self.outcome is not None
        return self.outcome


class LookaheadPlanner:
    """Look-ahead planner: a second line of computation next to the one that skills wait for. It does one
    thing at a time.

    With a worker it computes in another process while ticks go on here. Answers, and the simulated times at
    which they are ready, are those without one. Checkpoints keep nothing of it: earlier results are
    forgotten there.
    """

    def __init__(
        self,
        now: Callable[[], float],
        cost: float,
        solve: Callable[[ChainOrder], ChainAnswer],
        resolved: Callable[[ChainOrder, LookaheadOutcome], None],
        worker: PlanningWorker | None = None,
    ) -> None:
        """Arguments: `now` returns the simulated time, s; `cost` is that of a check, simulated s. `solve`
        plans in this process. `resolved` is told each outcome, when it or a later one is first read."""
        self._now = now
        self._cost = cost
        self._solve = solve
        self._told = resolved
        self._worker = worker
        self._free = 0.0
        self._generation = 0
        self._pending: deque[tuple[LookaheadResult, ChainAnswer | None]] = deque()

    def prepare(self, order: ChainOrder) -> LookaheadResult:
        """Begin to plan a chain, without letting time pass."""
        result = LookaheadResult(order, self._now(), self._generation, self._resolve)
        sent = self._worker is not None and self._worker.send(order)
        self._pending.append((result, None if sent else self._solve(order)))
        return result

    def wait(self, prepared: LookaheadResult) -> Generator[None, None, None]:
        """Yield until it is ready."""
        while self._now() < prepared.ready - 1e-9:
            yield

    def remembers(self, prepared: LookaheadResult) -> bool:
        """Whether no checkpoint has come since."""
        return prepared.generation == self._generation

    def forget(self) -> None:
        """Drop what was prepared, as a checkpoint does."""
        while self._pending:
            self._next()
        self._free = 0.0
        self._generation += 1

    def _resolve(self, wanted: LookaheadResult) -> None:
        while wanted.outcome is None:
            self._told(*self._next())

    def _next(self) -> tuple[ChainOrder, LookaheadOutcome]:
        """Take the oldest answer that is not taken yet."""
        result, answer = self._pending.popleft()
        if answer is None:
            assert self._worker is not None
            answer = self._worker.receive(result.order)
        cost = answer.thoughts * self._cost
        self._free = max(self._free, result.asked) + cost
        result.outcome = LookaheadOutcome(answer, cost, self._free)
        return result.order, result.outcome


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
