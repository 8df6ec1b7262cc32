"""Plan service: the planner's interface for skills. Requests become timed trajectories or typed failures, and
thinking is charged."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from picktree.files import PicktreeError
from picktree.world import (
    Array,
    Bounds,
    ComputeTimeAccount,
    Failure,
    Journal,
    PlanningScene,
    Pose,
    RandomStreams,
    Stopwatch,
    Trajectory,
    planner_names,
)
from picktree.world.robot_model import RobotModel

from . import planning_failures
from .goal_configurations import SOLUTIONS_PER_POSE
from .lookahead_planning import (
    ChainAnswer,
    ChainOrder,
    ChainSolver,
    CheckedBelief,
    LookaheadOutcome,
    LookaheadPlanner,
    LookaheadResult,
    PlanningWorker,
    PlanProvenanceStore,
    is_plan_free,
    solve_chain,
)
from .motion_chain import DEFAULT_LINE_ROUNDING, MotionChain, split_into_legs
from .motion_plans import ContactPair, MotionPlan
from .penetration_escape import EscapeSearch
from .plan_quality import MeasuredCost, PlanQuality, combine_qualities, measure_quality, plan_entry
from .requests import DEFAULT_CHECK_BUDGET, Goal, LineGoal, OffsetGoal, PlannerOverrides, Request, Scaling
from .scene_queries import SceneQueries
from .solver import ReachResult, RequestSolver, check_reach, free_postures

if TYPE_CHECKING:
    from .trajectory_verifier import TrajectoryVerifier

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class VerifierDisagreement:
    """Penetration that the verifier found in a trajectory that the planner called free."""

    request: str
    contacts: tuple[ContactPair, ...]


class PlanService:
    """Plan service of one robot in one believed scene.

    A request computes at once when its generator is first advanced and notes a `Plan`. It then yields
    the ticks that its collision checks and IK descents cost. The remainder below a tick stays in the thinking
    account. With `verify` each trajectory is verified a second time, which changes `disagreements` only.
    """

    def __init__(
        self,
        model: RobotModel,
        scene: PlanningScene,
        queries: SceneQueries,
        streams: RandomStreams,
        journal: Journal,
        thinking: ComputeTimeAccount,
        cost: float,
        *,
        configuration: Callable[[], Array],
        width: Callable[[], float],
        now: Callable[[], float] = lambda: math.inf,
        workspace: Bounds | None = None,
        planner: str = planner_names.AUTO,
        verify: bool = False,
        worker: bool = False,
        stopwatch: Stopwatch | None = None,
    ) -> None:
        """Arguments: `cost`, the simulated seconds of one collision check. `configuration` and `width` return
        the state of arm (n,) rad and fingers (m) for requests without a start. `now` returns the simulated
        time, s; by default results of look-ahead planning are ready at once. `worker`: whether a second
        process plans ahead, for another core; with `verify` none does."""
        self.queries = queries
        self._scene = scene
        self._model = model
        self._streams = streams
        self._journal = journal
        self._thinking = thinking
        self._configuration = configuration
        self._width = width
        self._stopwatch = stopwatch or Stopwatch()
        self.solver = RequestSolver(
            model, scene, configuration=configuration, width=width, workspace=workspace, planner=planner
        )
        self._cost = cost
        beside = (
            PlanningWorker(lambda: ChainSolver(model, scene, workspace, planner))
            if worker and not verify
            else None
        )
        self._ahead = LookaheadPlanner(now, cost, self._solve_ahead, self._resolved, beside)
        self._judge = _verifier(model) if verify else None
        self._disagreements: list[VerifierDisagreement] = []
        self.made = PlanProvenanceStore(scene, width)
        self.finds_nothing: Callable[[], bool] | None = None
        """Callback for each request: whether it finds no path, even where one exists; None: never. For
        injected faults."""
        self._manner = PlannerOverrides()

    @contextmanager
    def in_manner(self, manner: PlannerOverrides) -> Generator[None]:
        """Apply planner overrides to the requests within the block, in addition to those in force."""
        before = self._manner
        self._manner = before & manner
        try:
            yield
        finally:
            self._manner = before

    @property
    def as_usual(self) -> bool:
        """Whether no override in force makes motions keep a greater clearance."""
        return self._manner.clearance == 0.0

    @property
    def disagreements(self) -> tuple[VerifierDisagreement, ...]:
        """Trajectories in which the verifier contradicts the planner, with `verify`."""
        return tuple(self._disagreements)

    def solve(self, request: Request, *, node: str = "") -> Generator[None, None, MotionPlan]:
        """Plan the trajectory of a request; `node` keys the planner's randomness.

        Fails with planning.no_ik, .goal_in_collision, .start_in_collision, .start_outside, .constraint,
        .budget or .no_path.
        """
        request = self._manner.of(request)
        seed = self._seed(request, node)
        return (yield from self._plan(lambda: self.solver.solve(request, seed), [request]))

    def to(
        self,
        goal: Goal,
        *,
        scaling: Scaling | None = None,
        start: Array | None = None,
        node: str = "",
        budget: int = DEFAULT_CHECK_BUDGET,
    ) -> Generator[None, None, MotionPlan]:
        """Plan a trajectory from `start` (n,) rad (default: the arm's configuration) to the goal; see
        `solve`."""
        request = Request(goal, start, scaling=scaling or Scaling(), budget=budget)
        return (yield from self.solve(request, node=node))

    def line(
        self,
        line: LineGoal | OffsetGoal,
        *,
        scaling: Scaling | None = None,
        start: Array | None = None,
        node: str = "",
    ) -> Generator[None, None, MotionPlan]:
        """Plan a straight motion of the TCP to a pose or by an offset; as much of it as is free and
        reachable.

        Fails with planning.no_path when that is less than `least_fraction`, .start_in_collision or
        .start_outside. A line draws nothing at random: `node` exists so that all requests are called alike.
        """
        return (yield from self.solve(Request(line, start, scaling=scaling or Scaling()), node=node))

    def through(
        self, legs: Sequence[Request], *, node: str = "", rounded: float = DEFAULT_LINE_ROUNDING
    ) -> Generator[None, None, MotionPlan]:
        """Plan one trajectory through several motions, each from the end of the one before, without a stop in
        between.

        `MotionPlan.passes` has the time at which each ends. Each leg keeps its own scaling, allowed pairs,
        width and supposed held object; only the first may give its start. The corner between two legs is
        rounded as far as that is free, of a straight line at most `rounded` m at each end. Where no rounding
        is free, the arm stops at the corner. When a leg fails the chain does, with the leg's cause, as in
        `solve`.
        """
        legs, seeds = self._prepared(legs, node)
        return (yield from self._plan(lambda: MotionChain(self.solver, rounded).solve(legs, seeds), legs))

    def _prepared(self, legs: Sequence[Request], node: str) -> tuple[tuple[Request, ...], tuple[int, ...]]:
        """Return the legs of a chain in the manner in force, and their seeds."""
        if not legs or any(leg.start is not None for leg in legs[1:]):
            raise PicktreeError("a chain needs legs, of which only the first may say where it starts")
        legs = tuple(self._manner.of(leg) for leg in legs)
        return legs, tuple(self._seed(leg, node) for leg in legs)

    def _plan(
        self, find: Callable[[], MotionPlan], legs: Sequence[Request]
    ) -> Generator[None, None, MotionPlan]:
        """Compute a plan of these motions at once, verify and record it, and yield the ticks that it
        costs."""
        answer: MotionPlan | Failure
        if self.finds_nothing is not None:
            self.solver.finds_nothing = self.finds_nothing()
        with self.checking() as spent:
            try:
                answer = find()
            except Failure as failure:
                answer = failure
        if isinstance(answer, MotionPlan):
            self.made.note(answer)
            self._verify_legs(legs, answer)
        start = self.solver.start(legs[0])
        self._journal.note(plan_entry(self._model, legs, start, spent, answer, self._scene.version))
        yield from self.charge()
        if isinstance(answer, Failure):
            raise answer
        return answer

    def ahead(
        self, legs: Sequence[Request], *, node: str = "", rounded: float = DEFAULT_LINE_ROUNDING
    ) -> LookaheadResult:
        """Plan a motion through these legs, as `through` does, during other motions.

        `take` returns the result once the simulated time of its computation has passed; no thinking is
        charged. Results are computed one after the other: a second one waits for the first.
        """
        legs, seeds = self._prepared(legs, node)
        nothing = self.finds_nothing is not None and self.finds_nothing()
        start, width = self._configuration(), self._width()
        order = ChainOrder(legs, seeds, rounded, self._scene.snapshot(), start, width, nothing)
        return self._ahead.prepare(order)

    def take(self, prepared: LookaheadResult) -> Generator[None, None, MotionPlan | None]:
        """Return a plan of `ahead` as soon as it is ready; raise the failure with which it ended.

        When the belief has changed since, the plan is checked again, which is charged. None: it is no longer
        valid, or a checkpoint came in between; plan again:

        plan = (yield from world.plan.take(prepared)) or (yield from world.plan.through(legs))
        """
        if not self._ahead.remembers(prepared):
            return None
        yield from self._ahead.wait(prepared)
        answer = prepared.answer
        if self._scene.version == prepared.version:
            if isinstance(answer, Failure):
                raise answer
            return answer
        if isinstance(answer, Failure):
            return None
        held = self.still_free(answer)
        yield from self.charge()
        return answer if held else None

    def _solve_ahead(self, order: ChainOrder) -> ChainAnswer:
        """Plan a chain at once, in the present belief."""
        with self._stopwatch.measure("planning"):
            answer = solve_chain(self.solver, order)
        if isinstance(answer.plan, MotionPlan):
            self._verify_legs(order.legs, answer.plan)
        return answer

    def _resolved(self, order: ChainOrder, outcome: LookaheadOutcome) -> None:
        """Record the result of look-ahead planning."""
        plan, belief = outcome.answer.plan, order.belief
        self._thinking.add_unowed(outcome.cost)
        if isinstance(plan, MotionPlan):
            self.made.note(plan, CheckedBelief(belief.version, belief.allowed, order.width))
        start = order.start if order.legs[0].start is None else order.legs[0].start
        spent = MeasuredCost(outcome.answer.checks, outcome.cost)
        self._journal.note(plan_entry(self._model, order.legs, start, spent, plan, belief.version))

    def still_free(self, plan: MotionPlan) -> bool:
        """Whether a plan is free of collision in the present belief. Answers at once; the thinking account
        owes the cost."""
        with self.checking():
            free = is_plan_free(self.solver, plan)
        if free:
            self.made.renew(plan.trajectory)
        return free

    @contextmanager
    def checking(self) -> Generator[MeasuredCost]:
        """Charge the checker's queries within the block to the thinking account."""
        spent, solver = MeasuredCost(), self.solver
        checks, solves = solver.collision.checks, solver.ik.solves
        with self._stopwatch.measure("planning"):
            try:
                yield spent
            finally:
                spent.checks = solver.collision.checks - checks
                spent.seconds = (spent.checks + solver.ik.solves - solves) * self._cost
                self._thinking.spend(spent.seconds)

    def forget(self) -> None:
        """Drop the results of look-ahead planning, as a checkpoint does."""
        self._ahead.forget()

    def reachable(self, tcp_in_world: Pose, *, near: Array | None = None) -> Array | None:
        """Return a configuration free of collision for the pose, close to `near` (n,); None: none was found.

        Answers at once; the thinking account owes the cost.
        """
        with self.checking():
            solver = self.solver
            solver.look()
            around = self._configuration() if near is None else near
            first = solver.ik.descend(tcp_in_world, around)
            if first is not None and solver.collision.free(first):
                return first
            rng = self._streams.at("ik", 0)
            solutions = solver.ik.solutions(tcp_in_world, rng, around, SOLUTIONS_PER_POSE)
            return next((q for q in solutions if solver.collision.free(q)), None)

    def reached(self, request: Request) -> ReachResult:
        """Test whether the arm reaches the first pose of a request's goal, and if not, find the obstruction.
        Nothing is planned.

        The search starts near the request's start, in the scene as the request supposes it. Answers at once;
        the thinking account owes the cost.
        """
        with self.checking():
            return check_reach(self.solver, self._manner.of(request), lambda: self._streams.at("ik", 0))

    def postures(self, request: Request) -> list[Array]:
        """Return configurations (n,) free of collision at the pose of a request's goal, the nearest to its
        start first.

        Their scene and their cost are those of `reached`.
        """
        with self.checking():
            return free_postures(self.solver, self._manner.of(request), self._streams.at("ik", 0))

    def quality(self, plan: MotionPlan) -> PlanQuality:
        """Measure a plan's length, clearance, and distance to singularities and joint limits. Not charged: it
        decides nothing.

        The belief is the present one, with the plan's suppositions. It takes as long as planning a simple
        motion; so it is not part of every plan.
        """
        measured: list[PlanQuality] = []
        for leg, trajectory in zip(plan.legs or (plan,), split_into_legs(plan), strict=True):
            self.solver.look(leg.request)
            measured.append(measure_quality(self._model, self.solver.collision, trajectory))
        return combine_qualities(measured)

    def contacts(self, q: Array | None = None) -> tuple[ContactPair, ...]:
        """Return the pairs of the arm at q (n,) (default: its configuration) that are closer than their
        margins; not charged."""
        self.solver.look()
        return self.solver.collision.contacts(self._configuration() if q is None else q)

    def outward(self) -> EscapeSearch:
        """Return the search for escape paths from the arm's configuration. Only its queries within `checking`
        are charged."""
        self.solver.look()
        return EscapeSearch(self._model, self.solver.collision, self._configuration())

    def charge(self) -> Generator[None, None, None]:
        """Yield ticks until the simulated time that computing has cost so far has passed."""
        yield from self._thinking.charge()

    def _seed(self, request: Request, node: str) -> int:
        """Return a seed keyed by the node; a line draws nothing at random."""
        line = isinstance(request.target, LineGoal | OffsetGoal)
        return 0 if line else self._streams.number(self._manner.stream(f"planner {node}"))

    def _verify_legs(self, legs: Sequence[Request], plan: MotionPlan) -> None:
        for leg, part in zip(legs, split_into_legs(plan), strict=True):
            self.verify(leg, part)

    def verify(self, request: Request, trajectory: Trajectory) -> None:
        """Verify a trajectory that the planner calls free, where verification is on."""
        if self._judge is None:
            return
        with self._stopwatch.measure("verifying"):
            solver = self.solver
            scene = solver.scene(request)
            judged = (self._judge.judge(trajectory, scene, width) for width in solver.widths(request))
            contacts = next(filter(None, judged), ())
        if contacts:
            name = planning_failures.describe_goal(request.target)
            self._disagreements.append(VerifierDisagreement(name, contacts))
            _log.error(
                "%s: judged to collide: %s", name, "; ".join(planning_failures.contact_lines(contacts))
            )


def _verifier(model: RobotModel) -> TrajectoryVerifier:
    from .trajectory_verifier import TrajectoryVerifier  # slow to import, with trimesh

    return TrajectoryVerifier(model)
