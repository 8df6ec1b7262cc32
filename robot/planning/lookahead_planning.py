"""Look-ahead planning: the next motion is planned while the present one runs. It is ready at a fixed
simulated time.

A second process plans it where there is one. Its answer depends on its order alone, so that a run with a
worker is the same run, bit for bit. Plan provenance records the requests and the belief of each trajectory,
so that it can be checked again.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Generator
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Literal
from weakref import WeakKeyDictionary

from picktree.world import Array, Bounds, Failure, PlanningScene, SceneSnapshot, Trajectory
from picktree.world.robot_model import RobotModel

from .motion_chain import MotionChain, split_into_legs
from .motion_plans import MotionPlan
from .requests import WIDTH_TOLERANCE, JointGoal, Request
from .solver import RequestSolver
from .trajectory_check import StartTolerance, is_trajectory_free

IMPROVING_CHECKS = 2000
"""Number of collision checks by which a leg's path is improved ahead. They take 50 ms of the simulated second
before the plan is needed."""
_STANDARD_STREAMS = 3
"""Number of open files that a worker keeps beside its connection."""


@dataclass(frozen=True, slots=True, eq=False)
class ChainOrder:
    """Chain of motions to plan, with all that its plan depends on."""

    legs: tuple[Request, ...]
    seeds: tuple[int, ...]
    rounded: float
    """Length of a straight line that may be rounded at each of its ends, m."""
    belief: SceneSnapshot
    start: Array
    """Configuration (n,) of a first leg without a start, rad."""
    width: float
    """Opening of the fingers for legs that give none, m."""
    finds_nothing: bool
    """Whether an injected fault keeps the planner from finding a path."""


@dataclass(frozen=True, slots=True, eq=False)
class ChainAnswer:
    """Plan of a chain, or its failure, with the cost of the search."""

    plan: MotionPlan | Failure
    checks: int
    """Collision checks."""
    thoughts: int
    """Collision checks and IK descents; each costs the same simulated time."""


def solve_chain(solver: RequestSolver, order: ChainOrder) -> ChainAnswer:
    """Plan a chain with a solver whose belief is that of the order, and shorten the paths that are not
    direct."""
    solver.finds_nothing, solver.improving = order.finds_nothing, IMPROVING_CHECKS
    checks, descents = solver.collision.checks, solver.ik.solves
    plan: MotionPlan | Failure
    try:
        plan = MotionChain(solver, order.rounded).solve(order.legs, order.seeds)
    except Failure as failure:
        plan = failure
    finally:
        solver.improving = 0
    checks = solver.collision.checks - checks
    return ChainAnswer(plan, checks, checks + solver.ik.solves - descents)


class ChainSolver:
    """Solver of chains that takes belief, arm and fingers from each order."""

    def __init__(
        self, model: RobotModel, scene: PlanningScene, workspace: Bounds | None, planner: str
    ) -> None:
        """Use the fixtures and bins of `scene`, and the planner of that name."""
        self._scene = scene.supposing()
        self._start = model.named("home")
        self._width = 0.0
        self._solver = RequestSolver(
            model,
            self._scene,
            configuration=lambda: self._start,
            width=lambda: self._width,
            workspace=workspace,
            planner=planner,
        )

    def solve(self, order: ChainOrder) -> ChainAnswer:
        self._start, self._width = order.start, order.width
        self._scene.restore(order.belief, {})
        with self._scene.allow(*((min(pair), max(pair)) for pair in order.belief.allowed)):
            return solve_chain(self._solver, order)


def has_second_core() -> bool:
    """Whether this process may use more than one core of its machine."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0)) > 1
    return (os.cpu_count() or 1) > 1


class PlanningWorker:
    """Second process that plans chains in their order. It is forked at the first one, with all that is
    loaded by then, and ends with this process.

    Where it cannot be started, or ended before its time, chains are planned here.
    """

    def __init__(self, solver: Callable[[], ChainSolver]) -> None:
        """`solver` makes the solver of the worker."""
        self._make_solver = solver
        self._connection: Connection | Literal["none", "lost"] = "none"

    def send(self, order: ChainOrder) -> bool:
        """Give the worker an order; False: there is no worker."""
        if self._connection == "none":
            self._connection = self._start()
        if isinstance(self._connection, str):
            return False
        try:
            self._connection.send(order)
        except OSError:
            self._connection = "lost"
        return self._connection != "lost"

    def receive(self, order: ChainOrder) -> ChainAnswer:
        """Return the answer to the oldest order that was sent. Waits for it, in wall time."""
        if isinstance(self._connection, Connection):
            try:
                return self._connection.recv()
            except (EOFError, OSError):
                self._connection = "lost"
        return self._make_solver().solve(order)

    def _start(self) -> Connection | Literal["lost"]:
        if "fork" not in multiprocessing.get_all_start_methods():
            return "lost"
        context = multiprocessing.get_context("fork")
        ours, theirs = context.Pipe()
        try:
            context.Process(target=self._serve, args=(theirs,), name="planning", daemon=True).start()
        except (OSError, AssertionError):  # no memory, or this process may not have children
            return "lost"
        theirs.close()
        return ours

    def _serve(self, connection: Connection) -> None:
        """Answer orders until the other process closes the connection or ends."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # instead of the handler that ends a run
        # An open log would look as if its run still went on when only the worker is left.
        os.closerange(_STANDARD_STREAMS, connection.fileno())
        os.closerange(connection.fileno() + 1, os.sysconf("SC_OPEN_MAX"))
        # A failure here occurs again in the other process, which reports it.
        with suppress(Exception):
            solver = self._make_solver()
            while True:
                connection.send(solver.solve(connection.recv()))


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
        self._provenances: WeakKeyDictionary[Trajectory, PlanProvenance] = WeakKeyDictionary()

    def note(self, plan: MotionPlan, seen: CheckedBelief | None = None) -> None:
        """Record a plan whose trajectory was found free in the belief `seen`; None: just now."""
        requests = [leg.request for leg in plan.legs or (plan,)]
        passes = plan.passes or (plan.trajectory.duration,)
        known = tuple(request for request in requests if request is not None)
        if len(known) == len(passes):
            self._provenances[plan.trajectory] = PlanProvenance(known, passes, seen or self.now())

    def renew(self, trajectory: Trajectory) -> None:
        """Record that a trajectory was found free in the present belief. It need not be a recorded plan."""
        made = self._provenances.get(trajectory)
        if made is None:
            request = Request(JointGoal(trajectory.end), trajectory.start)
            made = PlanProvenance((request,), (trajectory.duration,), self.now())
        self._provenances[trajectory] = replace(made, seen=self.now())

    def of(self, trajectory: Trajectory) -> PlanProvenance | None:
        """Return the provenance of a trajectory; None: it is no recorded plan, and was never found free."""
        return self._provenances.get(trajectory)

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
        self,
        order: ChainOrder,
        order_time: float,
        generation: int,
        resolve: Callable[[LookaheadResult], None],
    ) -> None:
        """Arguments: `order_time`, the simulated time of the order, s. `resolve` sets the outcome."""
        self.order = order
        self.order_time = order_time
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
    """Look-ahead planner: a second line of computation next to the one that skills wait for. It computes one
    plan at a time.

    With a worker it computes in another process during the ticks. The results, and the simulated times at
    which they are ready, are the same without a worker. Checkpoints do not contain its state: a checkpoint
    discards earlier results.
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
        plans in this process. `resolved` is called with each outcome, when it or a later one is first
        read."""
        self._now = now
        self._cost = cost
        self._solve = solve
        self._report_outcome = resolved
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
        """Drop prepared results, as a checkpoint does."""
        while self._pending:
            self._next()
        self._free = 0.0
        self._generation += 1

    def _resolve(self, wanted: LookaheadResult) -> None:
        while wanted.outcome is None:
            self._report_outcome(*self._next())

    def _next(self) -> tuple[ChainOrder, LookaheadOutcome]:
        """Take the oldest answer that is not taken yet."""
        result, answer = self._pending.popleft()
        if answer is None:
            assert self._worker is not None
            answer = self._worker.receive(result.order)
        cost = answer.thoughts * self._cost
        self._free = max(self._free, result.order_time) + cost
        result.outcome = LookaheadOutcome(answer, cost, self._free)
        return result.order, result.outcome


def is_plan_free(solver: RequestSolver, plan: MotionPlan) -> bool:
    """Whether a plan's trajectory is free in the present belief, by the fast checker.

    An object that the plan assumed in the hand is checked with its present belief, once it is held.
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
