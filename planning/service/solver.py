"""Request solver: one plan or one typed failure for one request, without charges, records and
verification."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...robots.model import RobotModel
from ...world.belief.planning_scene import PlanningScene
from ...world.causes import Failure
from ...world.trajectory import Trajectory
from ...world.values import Array, Bounds, Pose
from ..collision.collision_bodies import CollisionMargins
from ..collision.collision_checker import CollisionChecker
from ..collision.start_tolerance import StartTolerance
from ..collision.trajectory_check import is_trajectory_free
from ..failures import planning_failures
from ..failures.goal_rejections import GoalInspection
from ..failures.line_failures import explain_line_stop
from ..failures.obstructions import ObstructionSearch
from ..failures.request_checks import check_request
from ..kinematics.cartesian_lines import LineResult, plan_line
from ..kinematics.inverse_kinematics import InverseKinematics
from ..path_constraints import PathConstraints
from ..requests import ContactPair, Goal, LineGoal, MotionPlan, OffsetGoal, Request
from ..search.constrained_rrt import ConstrainedPlanner
from ..search.goal_configurations import GoalConfiguration, GoalSet
from ..search.joint_planner import CheckBudget, JointPlanner, TimedPath
from ..timing.time_parameterization import time_smooth


class RequestSolver:
    """Request solver for one robot in one believed scene.

    The answer depends on the request, the belief, the state of arm and fingers, and the seed.
    """

    def __init__(
        self,
        model: RobotModel,
        scene: PlanningScene,
        *,
        configuration: Callable[[], Array],
        width: Callable[[], float],
        workspace: Bounds | None = None,
        margins: CollisionMargins | None = None,
    ) -> None:
        """Use `configuration` and `width` for arm (n,) rad and fingers (m) where a request gives none."""
        self.model = model
        self.collision = CollisionChecker(model, margins, workspace=workspace)
        self.ik = InverseKinematics(model)
        self.finds_nothing = False
        """Whether each request is answered as if no path was found: for injected faults."""
        self._scene = scene
        self._configuration = configuration
        self._width = width
        self._workspace = workspace

    def solve(self, request: Request, seed: int) -> MotionPlan:
        """Plan a request. Fails with planning.*, see `PlanService.solve`."""
        check_request(self.model, request)
        self.look(request)
        begun = self._begun(request)
        if isinstance(request.target, LineGoal | OffsetGoal):
            plan = self._line(begun, request.target)
        else:
            plan = self._plan(begun, request.target, seed)
        return replace(plan, request=replace(request, start=begun.start), version=self._scene.version)

    def start(self, request: Request) -> Array:
        """Return the start of a request (n,), rad; a copy."""
        q = self._configuration() if request.start is None else request.start
        return np.array(q, dtype=np.float64)

    def scene(self, request: Request) -> PlanningScene:
        """Return the belief with the request's suppositions."""
        held = request.holding
        if held is not None:
            return self._scene.supposing(held.object, held.object_in_tcp, allowed=request.allowed)
        return self._scene.supposing(allowed=request.allowed) if request.allowed else self._scene

    def width(self, request: Request) -> float:
        """Return the opening of the fingers on the motion, m."""
        return self._width() if request.width is None else request.width

    def look(self, request: Request | None = None) -> None:
        """Update the collision checker with the belief, and with a request's suppositions."""
        if request is None:
            self.collision.update(self._scene, self._width())
        else:
            self.collision.update(self.scene(request), self.width(request), clearance=request.clearance)

    def _begun(self, request: Request) -> _Begun:
        start = self.start(request)
        way = StartTolerance(self.collision, start)
        if way.stuck:
            raise planning_failures.start_in_collision(start, way.stuck, believed=request.start is None)
        constraints = PathConstraints(self.model, request.constraints)
        if broken := constraints.broken(start):
            raise planning_failures.constraint_violated("where the motion starts", broken)
        return _Begun(request, start, way, constraints, self.collision.checks)

    def _plan(self, begun: _Begun, goal: Goal, seed: int) -> MotionPlan:
        constraints = begun.constraints
        planner = self._planner(begun)
        inspection = GoalInspection(self.model, self.collision, constraints, self._workspace)
        goals = GoalSet(self.model, self.ik, inspection, begun.way, begun.start, constraints, goal)
        try:
            found, reached = self._found(planner, goals, seed)
            if found is None or self.finds_nothing:
                raise self._not_found(begun, [target.q for target in reached])
        finally:
            self.ik.solves += constraints.projections
        checks = self.collision.checks - begun.checks
        return MotionPlan(found.trajectory, found.path, found.planner, checks, reached[found.goal].index)

    def _planner(self, begun: _Begun) -> JointPlanner | ConstrainedPlanner:
        way, start, request = begun.way, begun.start, begun.request
        if request.constraints:
            return ConstrainedPlanner(
                self.model, way, start, request.scaling, self.collision, request.budget, begun.constraints
            )
        return JointPlanner(
            self.model, way, start, request.scaling, CheckBudget(self.collision, request.budget)
        )

    def _found(
        self, planner: JointPlanner | ConstrainedPlanner, goals: GoalSet, seed: int
    ) -> tuple[TimedPath | None, list[GoalConfiguration]]:
        """Return the planner's path, and the goal configurations that it planned for."""
        for near in goals.near():
            found = planner.direct([target.q for target in near])
            if found is not None:
                return found, near
        targets = goals.all(seed)
        ends = [target.q for target in targets]
        return planner.direct(ends) or planner.around(ends, seed), targets

    def _not_found(self, begun: _Begun, ends: Sequence[Array]) -> Failure:
        """Build the failure with its obstructions. Their search is charged, but not to the budget."""
        spent = self.collision.checks - begun.checks + begun.constraints.projections
        way = begun.way
        looked = ObstructionSearch(self.model, self.collision, way, begun.constraints)
        enclosed = None
        for end in ends:
            enclosed = looked.enclosure("goal", end)
            if enclosed is None:  # one that is not enclosed is enough
                break
        if enclosed is None:
            enclosed = looked.enclosure("start", begun.start)
        between = looked.between(begun.start, ends)
        return planning_failures.not_found(spent, begun.request.budget, ends, way.excused, between, enclosed)

    def _line(self, begun: _Begun, line: LineGoal | OffsetGoal) -> MotionPlan:
        start, way = begun.start, begun.way
        target = line.tcp_in_world if isinstance(line, LineGoal) else self.model.tcp(start).shifted(line.by)
        found = plan_line(self.model, self.ik, way, start, target)
        if self.finds_nothing:
            found = LineResult(found.path[:1], 0.0, "reach", ended_at=target)
        if found.fraction < line.least_fraction:
            raise self._line_ended(found, line.least_fraction, target)
        trajectory = time_smooth(self.model, found.path, begun.request.scaling)
        if trajectory is None or not is_trajectory_free(way, trajectory):
            graze = () if trajectory is None else self._first_contacts(way, trajectory)
            raise planning_failures.line_grazes(found.fraction, graze)
        for k, q in enumerate(trajectory.position):
            if broken := begun.constraints.broken(q):
                raise planning_failures.line_breaks(broken, k / (len(trajectory.position) - 1))
        checks = self.collision.checks - begun.checks
        return MotionPlan(trajectory, found.path, "line", checks, fraction=found.fraction)

    def _line_ended(self, found: LineResult, least: float, target: Pose) -> Failure:
        begin, last = self.model.tcp(found.path[0]), self.model.tcp(found.path[-1])
        length = begin.distance(target)
        if found.blocked is None:
            why = explain_line_stop(self.model, self.ik, found, target)
            stop = planning_failures.LineStopPoint(last.position, (), why.joint, why.singular)
            return planning_failures.line_ended(found, least, length, why.why, stop)
        inspection = GoalInspection(
            self.model, self.collision, PathConstraints(self.model, ()), self._workspace
        )
        rejected = inspection.rejection(found.blocked)
        stop = planning_failures.LineStopPoint(last.position, rejected.contacts)
        return planning_failures.line_ended(
            found, least, length, planning_failures.how_rejected(rejected, "would be"), stop
        )

    def _first_contacts(self, way: StartTolerance, trajectory: Trajectory) -> tuple[ContactPair, ...]:
        """Return the contacts of a trajectory's first sample that is too close to a body."""
        for q in trajectory.position:
            if not way.nearly_free(q):
                return self.collision.contacts(q)
        return ()


@dataclass(frozen=True, slots=True, eq=False)
class _Begun:
    """Request with its start; `checks`: the checker's count at the start."""

    request: Request
    start: Array
    way: StartTolerance
    constraints: PathConstraints
    checks: int
