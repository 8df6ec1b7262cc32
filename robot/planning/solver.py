"""Request solver: one plan or one typed failure for one request; charges and records are elsewhere.

Reachability of a pose is the cheap test before planning.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from picktree.world import Array, Bounds, Failure, PlanningScene, Pose, Trajectory, planner_names, planning
from picktree.world.robot_model import RobotModel

from . import planning_failures
from .cartesian_lines import LineResult, plan_line
from .collision_checker import CollisionChecker
from .collision_model import CollisionMargins
from .constrained_rrt import ConstrainedPlanner
from .goal_configurations import (
    HOME_CONFIGURATION,
    SOLUTIONS_PER_POSE,
    UNCOMFORTABLE_COST,
    GoalConfiguration,
    GoalSet,
)
from .inverse_kinematics import InverseKinematics
from .joint_planner import PLANNER_NAME, CheckBudget, FoundPath, JointPlanner, load_planner
from .limits import configuration_cost
from .motion_plans import ContactPair, MotionPlan, PlannedPath
from .path_constraints import PathConstraints
from .path_search import PathPlanner
from .planning_failures import GoalInspection, ObstructionSearch, explain_line_stop
from .requests import (
    CARRYING_ACCELERATION,
    WIDTH_TOLERANCE,
    Goal,
    LineGoal,
    OffsetGoal,
    PoseGoal,
    Request,
    check_request,
)
from .return_path import ReturnSearch
from .time_parameterization import time_smooth
from .trajectory_check import StartTolerance, is_trajectory_free

RETURN_ATTEMPTS = 4
"""Number of return paths that are tried: a straight one, then others."""


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
        planner: str = planner_names.AUTO,
    ) -> None:
        """Use `configuration` and `width` for arm (n,) rad and fingers (m), and the planner of that name,
        where a request gives none."""
        self.model = model
        self.collision = CollisionChecker(model, margins, workspace=workspace)
        self.ik = InverseKinematics(model)
        self.improving = 0
        """Number of collision checks that may be spent on a shorter path where a search found one."""
        self.finds_nothing = False
        """Whether each request is answered as if no path was found: for injected faults."""
        self._scene = scene
        self._configuration = configuration
        self._width = width
        self._workspace = workspace
        self._usual = planner

    def solve(self, request: Request, seed: int) -> MotionPlan:
        """Plan a request. Fails with planning.*, see `PlanService.solve`."""
        found = self._solved(request, seed, timed=True)
        assert isinstance(found, MotionPlan)
        return found

    def path(self, request: Request, seed: int) -> PlannedPath:
        """Plan the path of a request, free at the steps of its search, and fail as `solve`.

        Without constraints it has no time, and the steps are coarser than those of a trajectory's check.
        """
        return self._solved(request, seed, timed=bool(request.constraints))

    def _solved(self, request: Request, seed: int, *, timed: bool) -> PlannedPath:
        check_request(self.model, request)
        if self.scene(request).held is not None:
            scaling = request.scaling
            gently = replace(scaling, tool=min(scaling.tool, CARRYING_ACCELERATION))
            request = replace(request, scaling=gently)
        self.look(request)
        begun = self._start_search(request)
        if isinstance(request.target, LineGoal | OffsetGoal):
            found = self._line(begun, request.target, timed=timed)
        else:
            found = self._plan(begun, request.target, seed, timed=timed)
        return replace(found, request=replace(request, start=begun.start), version=self._scene.version)

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

    def widths(self, request: Request) -> tuple[float, ...]:
        """Return the opening of the fingers on the motion, m, or the widest and narrowest where they move."""
        width, narrowest = self._width() if request.width is None else request.width, request.narrowest
        return (width,) if narrowest is None or width - narrowest < WIDTH_TOLERANCE else (width, narrowest)

    def look(self, request: Request | None = None) -> None:
        """Update the collision checker with the belief, and with a request's suppositions."""
        if request is None:
            self.collision.update(self._scene, self._width())
        else:
            self.collision.update(self.scene(request), *self.widths(request), clearance=request.clearance)

    def _start_search(self, request: Request) -> _Begun:
        start = self.start(request)
        way = StartTolerance(self.collision, start)
        believed = request.start is None
        if way.excess is not None and (way.stuck or way.excess.more_than_a_turn):
            raise planning_failures.start_outside(start, way.excess, way.stuck, believed=believed)
        if way.stuck:
            raise planning_failures.start_in_collision(start, way.stuck, believed=believed)
        constraints = PathConstraints(self.model, request.constraints)
        if broken := constraints.broken(start):
            raise planning_failures.constraint_violated("where the motion starts", broken)
        return _Begun(request, start, way, constraints, self.collision.checks)

    def _plan(self, begun: _Begun, goal: Goal, seed: int, *, timed: bool) -> PlannedPath:
        """Plan to a goal; from a start beyond limits or workspace by a return path first."""
        excess, way = begun.way.excess, begun.way
        if excess is None:
            return self._plan_inside(begun, goal, seed, timed=timed)
        search = ReturnSearch(self.model, self.collision, self.ik, way, begun.start, begun.constraints.hold)
        home = self.model.named(HOME_CONFIGURATION)
        why = ""
        for attempt in range(RETURN_ATTEMPTS):
            back = search.around(seed + attempt, begun.request.budget) if attempt else search.straight([home])
            if back is None:
                continue
            inside = replace(begun, start=back[-1], way=StartTolerance(self.collision, back[-1]))
            try:
                found = self._plan_inside(inside, goal, seed, timed=timed)
            except Failure as failure:
                fails_anywhere = failure.evidence.get("enclosed") == "goal"
                if failure.cause not in (planning.NO_PATH, planning.BUDGET) or fails_anywhere:
                    raise
                why = f"a motion leads back in, but not on from there: {failure.message}"
                continue
            path = np.concatenate([back[:-1], found.path])
            trajectory = self._planner(begun, None, timed=True).timed(path) if timed else None
            if trajectory is not None or not timed:
                checks = self.collision.checks - begun.checks
                return _planned(trajectory, PlannedPath(path, found.planner, checks, found.goal_index))
            why = "each motion that leads back in comes too close to something when it is timed"
        inner = np.clip(begun.start, way.lower, way.upper)
        between = ObstructionSearch(self.model, self.collision, way, begun.constraints).between(
            begun.start, [inner, home]
        )
        why = why or planning_failures.no_way_back(between)
        raise planning_failures.start_outside(
            begun.start, excess, why=why, believed=begun.request.start is None
        )

    def _plan_inside(self, begun: _Begun, goal: Goal, seed: int, *, timed: bool) -> PlannedPath:
        """Plan from a start within limits and workspace."""
        constraints = begun.constraints
        chosen = self._chosen(begun.request)
        planner = self._planner(begun, chosen, timed=timed)
        inspection = GoalInspection(self.model, self.collision, constraints, self._workspace)
        goals = GoalSet(self.model, self.ik, inspection, begun.way, begun.start, constraints, goal)
        try:
            found, reached = self._search_path(planner, goals, seed, direct=chosen is None)
            if found is None or self.finds_nothing:
                raise self._search_failure(begun, [target.q for target in reached])
        finally:
            self.ik.solves += constraints.projections
        if self.improving and found.planner == PLANNER_NAME and isinstance(planner, JointPlanner):
            found = planner.within(CheckBudget(self.collision, self.improving)).improved(found, seed)
        checks, index = self.collision.checks - begun.checks, reached[found.goal].index
        return _planned(found.trajectory, PlannedPath(found.path, found.planner, checks, index))

    def _chosen(self, request: Request) -> PathPlanner | None:
        """Return the planner of a request; None: `auto`. Raises PicktreeError for an unknown name."""
        name = request.planner or self._usual
        return None if name == planner_names.AUTO else load_planner(name)

    def _planner(
        self, begun: _Begun, chosen: PathPlanner | None, *, timed: bool
    ) -> JointPlanner | ConstrainedPlanner:
        way, start, request = begun.way, begun.start, begun.request
        if request.constraints:
            return ConstrainedPlanner(
                self.model,
                way,
                start,
                request.scaling,
                self.collision,
                request.budget,
                begun.constraints,
                chosen,
            )
        budget = CheckBudget(self.collision, request.budget)
        return JointPlanner(self.model, way, start, request.scaling if timed else None, budget, chosen)

    def _search_path(
        self, planner: JointPlanner | ConstrainedPlanner, goals: GoalSet, seed: int, *, direct: bool
    ) -> tuple[FoundPath | None, list[GoalConfiguration]]:
        """Return the planner's path, and the goal configurations that it planned for.

        With `direct` straight edges are tried first.
        """
        for near in goals.near() if direct else ():
            found = planner.direct([target.q for target in near])
            if found is not None:
                return found, near
        targets = goals.sample(seed)
        ends = [target.q for target in targets]
        return (planner.direct(ends) if direct else None) or planner.around(ends, seed), targets

    def _search_failure(self, begun: _Begun, ends: Sequence[Array]) -> Failure:
        """Build the failure with its obstructions. Their search is charged, but not to the budget.

        With `finds_nothing` the failure names no obstruction: none kept the planner from a path.
        """
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
        return planning_failures.not_found(
            spent,
            begun.request.budget,
            ends,
            way.excused,
            between,
            enclosed,
            searched=not self.finds_nothing,
        )

    def _line(self, begun: _Begun, line: LineGoal | OffsetGoal, *, timed: bool) -> PlannedPath:
        start, way = begun.start, begun.way
        target = line.tcp_in_world if isinstance(line, LineGoal) else self.model.tcp(start).shifted(line.by)
        found = plan_line(self.model, self.ik, way, start, target)
        if self.finds_nothing:
            found = LineResult(found.path[:1], 0.0, "reach", ended_at=target)
        if found.fraction < line.least_fraction:
            ended = self._line_ended(found, line.least_fraction, target)
            if way.excess is None:
                raise ended
            raise planning_failures.start_outside(
                start,
                way.excess,
                why=f"no straight motion leads back in, a free one may: {ended.message}",
                believed=begun.request.start is None,
            )
        trajectory = self._timed_line(begun, found) if timed else None
        checks = self.collision.checks - begun.checks
        return _planned(trajectory, PlannedPath(found.path, "line", checks, fraction=found.fraction))

    def _timed_line(self, begun: _Begun, found: LineResult) -> Trajectory:
        way = begun.way
        trajectory = time_smooth(self.model, found.path, begun.request.scaling)
        if trajectory is None or not is_trajectory_free(way, trajectory):
            graze = () if trajectory is None else self._first_contacts(way, trajectory)
            raise planning_failures.line_grazes(found.fraction, graze)
        for k, q in enumerate(trajectory.position):
            if broken := begun.constraints.broken(q):
                share = k / (len(trajectory.position) - 1)
                where = f"on the line, at {share:.0%} of its time,"
                raise planning_failures.constraint_violated(where, broken, fraction=share)
        return trajectory

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


def _planned(trajectory: Trajectory | None, path: PlannedPath) -> PlannedPath:
    """Return a path with its trajectory; the path alone where it has none."""
    if trajectory is None:
        return path
    return MotionPlan(
        path.path, path.planner, path.checks, path.goal_index, path.fraction, trajectory=trajectory
    )


@dataclass(frozen=True, slots=True, eq=False)
class ReachResult:
    """Result of a reachability test: `q` (n,) rad reaches the pose and is free.

    If `q` is None, `contact` is in the way at the best of `solutions` solutions, or the pose is out of reach.
    """

    q: Array | None
    solutions: int
    contact: ContactPair | None = None

    @property
    def why_not(self) -> str:
        """Reason in a few words; empty when the pose is reached."""
        if self.q is not None:
            return ""
        if self.contact is None:
            return "out of reach" if not self.solutions else "outside the workspace"
        depth = -self.contact.distance * 1000
        near = f"{depth:.1f} mm deep in" if depth > 0 else f"only {-depth:.1f} mm from"
        return f"{self.contact.a} would be {near} {self.contact.b}"


def check_reach(
    solver: RequestSolver, request: Request, rng: Callable[[], np.random.Generator]
) -> ReachResult:
    """Find a free configuration for the first pose of a request's goal, near the request's start.

    The scene is as the request supposes it. The path in between is not checked. `rng` is called where
    solutions from random seeds are needed.
    """
    assert isinstance(request.target, PoseGoal), "a pose is asked for"
    pose = request.target.tcp_in_world[0]
    near = solver.start(request)
    solver.look(request)
    solutions: list[Array] = []
    for seed in (near, solver.model.named(HOME_CONFIGURATION)):
        q = solver.ik.descend(pose, seed)
        if q is not None:
            solutions.append(q)
            if solver.collision.free(q) and configuration_cost(solver.model, q) < UNCOMFORTABLE_COST:
                return ReachResult(q, len(solutions))
    if not any(solver.collision.free(q) for q in solutions):
        blocked = next((c for q in solutions[:1] for c in solver.collision.contacts(q)), None)
        if blocked is not None and _is_hand_contact(solver, request, blocked):
            return ReachResult(None, len(solutions), blocked)
        solutions += solver.ik.solutions(pose, rng(), near, SOLUTIONS_PER_POSE)
    free = [q for q in solutions if solver.collision.free(q)]
    if free:
        best = min(free, key=lambda q: float(np.linalg.norm(q - near)) + configuration_cost(solver.model, q))
        return ReachResult(best, len(solutions))
    worst = [contacts[0] for q in solutions if (contacts := solver.collision.contacts(q))]
    least = max(worst, key=lambda contact: contact.distance, default=None)
    return ReachResult(None, len(solutions), least)


def free_postures(solver: RequestSolver, request: Request, rng: np.random.Generator) -> list[Array]:
    """Return free, comfortable configurations (n,) at the first pose of a request's goal, the nearest to its
    start first."""
    assert isinstance(request.target, PoseGoal), "a pose is asked for"
    solver.look(request)
    near = solver.start(request)
    found = solver.ik.solutions(request.target.tcp_in_world[0], rng, near, SOLUTIONS_PER_POSE)
    return [
        q
        for q in found
        if configuration_cost(solver.model, q) < UNCOMFORTABLE_COST and solver.collision.free(q)
    ]


def _is_hand_contact(solver: RequestSolver, request: Request, contact: ContactPair) -> bool:
    """Whether the hand or the held object touches a surrounding body. It then does so at this pose in any
    posture of the arm."""
    description, scene = solver.model.description, solver.scene(request)
    held = scene.held
    hand = (*description.gripper.fingers, description.tcp_link, *(() if held is None else (held.id,)))
    around = (*scene.fixtures, *scene.bins, *(o.id for o in scene.objects))
    return contact.a in hand and contact.b.split("/")[0] in around
