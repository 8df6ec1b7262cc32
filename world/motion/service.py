"""The planner as skills meet it: requests in, timed trajectories or typed failures out, thinking charged."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from ..causes import Failure
from ..journal import Journal, PlanMade
from ..robot.model import RobotModel
from ..scene.planning_scene import PlanningScene
from ..stopwatch import Stopwatch
from ..streams import Streams
from ..thinking import ThinkingAccount
from ..trajectory import Trajectory
from ..values import Array, Bounds, Pose, Vector3
from . import failing
from .collision import Collision
from .costs import Meter, Spent
from .fcl_queries import SceneQueries
from .ik import InverseKinematics
from .judge import Judge
from .lines import straight
from .planner import Budget, Found, Planner, stays_free
from .posture import discomfort
from .requests import Contact, Goal, JointGoal, Line, NamedGoal, Offset, Plan, PoseGoal, Scaling
from .timing import time_smooth
from .way import Way

_log = logging.getLogger(__name__)

HOME = "home"
UNCOMFORTABLE = 0.3
"""See `posture.discomfort`, rad."""
SOLUTIONS = 4
"""IK solutions that are looked for, for each pose."""


@dataclass(frozen=True, slots=True)
class Disagreement:
    """The judge found penetration in a trajectory that the planner called free."""

    request: str
    contacts: tuple[Contact, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Target:
    """A configuration (n,) that reaches pose number `index` of the goal."""

    q: Array
    index: int


class PlanService:
    """Plans for one robot in one believed scene.

    A request computes at once when its generator is first advanced, notes a `PlanMade`, and then yields the
    ticks that its collision checks and IK descents cost; what is left below a tick stays in the thinking
    account. With `verify` each trajectory is judged a second time, which changes `disagreements` only.
    """

    def __init__(
        self,
        model: RobotModel,
        scene: PlanningScene,
        queries: SceneQueries,
        streams: Streams,
        journal: Journal,
        thinking: ThinkingAccount,
        cost: float,
        *,
        configuration: Callable[[], Array],
        width: Callable[[], float],
        workspace: Bounds | None = None,
        verify: bool = False,
        stopwatch: Stopwatch | None = None,
    ) -> None:
        """`cost`: simulated seconds of one collision check. `configuration` and `width` say where arm
        (n,) rad and fingers (m) are when a request gives no start."""
        self.queries = queries
        self._model = model
        self._scene = scene
        self._streams = streams
        self._journal = journal
        self._thinking = thinking
        self._configuration = configuration
        self._width = width
        self._stopwatch = stopwatch or Stopwatch()
        self._collision = Collision(model, workspace=workspace)
        self._ik = InverseKinematics(model)
        self._meter = Meter(self._collision, self._ik, thinking, cost)
        self._home = model.named(HOME)
        self._judge = Judge(model) if verify else None
        self._disagreements: list[Disagreement] = []

    @property
    def disagreements(self) -> tuple[Disagreement, ...]:
        """What the judge found against the planner, with `verify`."""
        return tuple(self._disagreements)

    def to(
        self,
        goal: Goal,
        *,
        scaling: Scaling | None = None,
        start: Array | None = None,
        node: str = "",
        budget: int = 20000,
    ) -> Generator[None, None, Plan]:
        """A trajectory from `start` (n,) rad (default: where the arm is) to the goal.

        Fails with planning.no_ik, .goal_in_collision, .start_in_collision, .budget or .no_path. `budget`
        bounds the collision checks; `node` keys the planner's randomness.
        """
        seed = self._streams.number(f"planner {node}")
        scales = scaling or Scaling()
        return (yield from self._answer(goal, start, lambda q: self._plan(goal, q, scales, budget, seed)))

    def line(
        self,
        request: Line | Offset,
        *,
        scaling: Scaling | None = None,
        start: Array | None = None,
        node: str = "",
    ) -> Generator[None, None, Plan]:
        """The TCP straight to a pose or by an offset; as much of it as is free and reachable.

        Fails with planning.no_path when that is less than `least_fraction`, or .start_in_collision. A line
        draws nothing at random: `node` is taken so that all requests are called alike.
        """
        scales = scaling or Scaling()
        return (yield from self._answer(request, start, lambda q: self._line(request, q, scales)))

    def reachable(self, tcp_in_world: Pose, *, near: Array | None = None) -> Array | None:
        """A configuration free of collision for the pose, close to `near` (n,); None: none was found.

        Answers at once; the cost is owed to the thinking account.
        """
        with self._stopwatch.measure("planning"), self._meter.measure():
            self._collision.update(self._scene, self._width())
            around = self._configuration() if near is None else near
            first = self._ik.descend(tcp_in_world, around)
            if first is not None and self._collision.free(first):
                return first
            rng = self._streams.at("ik", 0)
            solutions = self._ik.solutions(tcp_in_world, rng, around, SOLUTIONS)
            return next((q for q in solutions if self._collision.free(q)), None)

    def contacts(self, q: Array | None = None) -> tuple[Contact, ...]:
        """What the arm at q (n,) (default: where it is) is closer to than its margins; not charged."""
        self._collision.update(self._scene, self._width())
        return self._collision.contacts(self._configuration() if q is None else q)

    def charge(self) -> Generator[None, None, None]:
        """Let the simulated time pass that computing has cost so far."""
        yield from self._thinking.charge()

    def _answer(
        self, request: Goal | Line | Offset, start: Array | None, compute: Callable[[Array], Plan]
    ) -> Generator[None, None, Plan]:
        """Compute, note and charge one request; a failure is charged, too, before it is raised."""
        answer: Plan | Failure
        with self._stopwatch.measure("planning"), self._meter.measure() as spent:
            self._collision.update(self._scene, self._width())
            q: Array = np.array(self._configuration() if start is None else start, dtype=np.float64)
            try:
                answer = compute(q)
            except Failure as failure:
                answer = failure
        if isinstance(answer, Plan):
            self._verify(request, answer.trajectory)
        self._note(request, spent, answer)
        yield from self.charge()
        if isinstance(answer, Failure):
            raise answer
        return answer

    def _way(self, start: Array) -> Way:
        way = Way(self._collision, start)
        if way.stuck:
            raise failing.stuck(way.stuck)
        return way

    def _plan(self, goal: Goal, start: Array, scaling: Scaling, budget: int, seed: int) -> Plan:
        begun = self._collision.checks
        way = self._way(start)
        planner = Planner(self._model, way, start, scaling, Budget(self._collision, budget))

        def plan(found: Found, targets: Sequence[_Target]) -> Plan:
            checks = self._collision.checks - begun
            index = targets[found.goal].index
            return Plan(found.trajectory, found.path, found.planner, checks, index)

        if isinstance(goal, PoseGoal):
            near = self._near_targets(goal, start, way)
            found = planner.direct([target.q for target in near])
            if found is not None:
                return plan(found, near)
            targets = self._all_targets(goal, start, way, seed)
        else:
            targets = [_Target(self._joint_target(goal, way), 0)]
        ends = [target.q for target in targets]
        found = planner.direct(ends) or planner.around(ends, seed)
        if found is None:
            checks = self._collision.checks - begun
            raise failing.not_found(checks, budget, len(targets), way.excused)
        return plan(found, targets)

    def _near_targets(self, goal: PoseGoal, start: Array, way: Way) -> list[_Target]:
        """For each pose the solution that the start itself leads to, where it is free. Where that one is
        uncomfortable, also the one that home leads to: else the arm would wander into its limits."""
        targets: list[_Target] = []
        for k, pose in enumerate(goal.tcp_in_world):
            q = self._ik.descend(pose, start)
            if q is not None and way.free(q):
                targets.append(_Target(q, k))
            if q is None or discomfort(self._model, q) > UNCOMFORTABLE:
                other = self._ik.descend(pose, self._home)
                if other is not None and way.free(other):
                    targets.append(_Target(other, k))
        return targets

    def _all_targets(self, goal: PoseGoal, start: Array, way: Way, seed: int) -> list[_Target]:
        """Free configurations for all poses of the goal. Fails when there is none."""
        rng = np.random.default_rng(seed)
        before = self._ik.solves
        solved = [
            _Target(q, k)
            for k, pose in enumerate(goal.tcp_in_world)
            for q in self._ik.solutions(pose, rng, start, SOLUTIONS)
        ]
        if not solved:
            raise failing.out_of_reach(goal.tcp_in_world, self._ik.solves - before)
        targets = [target for target in solved if way.free(target.q)]
        if not targets:
            each = [self._collision.contacts(target.q) for target in solved]
            raise failing.goal_in_collision(each, len(goal.tcp_in_world))
        return targets

    def _joint_target(self, goal: NamedGoal | JointGoal, way: Way) -> Array:
        q = self._model.named(goal.name) if isinstance(goal, NamedGoal) else np.array(goal.position)
        if bool(np.any(q < self._model.lower) or np.any(q > self._model.upper)):
            raise failing.outside_limits(q)
        if not way.free(q):
            raise failing.goal_in_collision([self._collision.contacts(q)], 1)
        return q

    def _line(self, request: Line | Offset, start: Array, scaling: Scaling) -> Plan:
        begun = self._collision.checks
        way = self._way(start)
        if isinstance(request, Line):
            target = request.tcp_in_world
        else:
            target = self._model.tcp(start).shifted(request.by)
        found = straight(self._model, self._ik, way, start, target)
        if found.fraction < request.least_fraction:
            contacts = () if found.blocked is None else self._collision.contacts(found.blocked)
            raise failing.line_ended(found, request.least_fraction, contacts)
        trajectory = time_smooth(self._model, found.path, scaling)
        if trajectory is None or not stays_free(way, trajectory):
            raise failing.line_grazes(found.fraction)
        checks = self._collision.checks - begun
        return Plan(trajectory, found.path, "line", checks, fraction=found.fraction)

    def _verify(self, request: Goal | Line | Offset, trajectory: Trajectory) -> None:
        if self._judge is None:
            return
        with self._stopwatch.measure("verifying"):
            contacts = self._judge.judge(trajectory, self._scene, self._width())
        if contacts:
            name = failing.described(request)
            self._disagreements.append(Disagreement(name, contacts))
            _log.error("%s: judged to collide: %s", name, "; ".join(failing.listed(contacts)))

    def _note(self, request: Goal | Line | Offset, spent: Spent, answer: Plan | Failure) -> None:
        if isinstance(answer, Failure):
            outcome, message, planner, duration = answer.cause.name, answer.message, "", 0.0
            path: tuple[tuple[float, ...], ...] = ()
            tool_path: tuple[Vector3, ...] = ()
        else:
            outcome, message, planner = "found", "", answer.planner
            duration = answer.trajectory.duration
            path = tuple(tuple(float(x) for x in q) for q in answer.path)
            tool_path = self._tool_path(answer.trajectory)
        self._journal.note(
            PlanMade(
                failing.described(request),
                planner,
                spent.checks,
                spent.seconds,
                outcome,
                message,
                duration,
                path,
                tool_path,
            )
        )

    def _tool_path(self, trajectory: Trajectory) -> tuple[Vector3, ...]:
        q = trajectory.position
        picked = np.unique(np.linspace(0, len(q) - 1, min(len(q), 25)).astype(int))
        return tuple(self._model.tcp(q[int(k)]).position for k in picked)
