"""From one request to one plan or one typed failure: no charging, no noting, no judging."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..robot.model import RobotModel
from ..scene.planning_scene import PlanningScene
from ..values import Array, Bounds
from . import failing
from .collision import Collision
from .constrained import ConstrainedPlanner
from .constraints import PathConstraints
from .goals import Goals
from .ik import InverseKinematics
from .lines import straight
from .margins import Margins
from .planner import Budget, Found, Planner, stays_free
from .requests import Goal, Line, Offset, Plan, Request
from .timing import time_smooth
from .way import Way


class Solver:
    """Answers requests for one robot in one believed scene.

    The answer depends on the request, the belief, where arm and fingers are, and the seed.
    """

    def __init__(
        self,
        model: RobotModel,
        scene: PlanningScene,
        *,
        configuration: Callable[[], Array],
        width: Callable[[], float],
        workspace: Bounds | None = None,
        margins: Margins | None = None,
    ) -> None:
        """`configuration` and `width` say where arm (n,) rad and fingers (m) are when a request does not."""
        self.model = model
        self.collision = Collision(model, margins, workspace=workspace)
        self.ik = InverseKinematics(model)
        self._scene = scene
        self._configuration = configuration
        self._width = width

    def solve(self, request: Request, seed: int) -> Plan:
        """The plan for a request. Fails with planning.*, see `PlanService.solve`."""
        self.look(request)
        start = self.start(request)
        if isinstance(request.target, Line | Offset):
            plan = self._line(request, request.target, start)
        else:
            plan = self._plan(request, request.target, start, seed)
        return replace(plan, request=replace(request, start=start))

    def start(self, request: Request) -> Array:
        """Where a request begins (n,), rad; a copy."""
        q = self._configuration() if request.start is None else request.start
        return np.array(q, dtype=np.float64)

    def scene(self, request: Request) -> PlanningScene:
        """The belief with what the request supposes."""
        held = request.holding
        if held is not None:
            return self._scene.supposing(held.object, held.object_in_tcp, allowed=request.allowed)
        return self._scene.supposing(allowed=request.allowed) if request.allowed else self._scene

    def width(self, request: Request) -> float:
        """Opening of the fingers on the way, m."""
        return self._width() if request.width is None else request.width

    def look(self, request: Request | None = None) -> None:
        """Bring the collision checker up to date with the belief, and with what a request supposes."""
        if request is None:
            self.collision.update(self._scene, self._width())
        else:
            self.collision.update(self.scene(request), self.width(request), clearance=request.clearance)

    def _way(self, start: Array) -> Way:
        way = Way(self.collision, start)
        if way.stuck:
            raise failing.stuck(way.stuck)
        return way

    def _plan(self, request: Request, goal: Goal, start: Array, seed: int) -> Plan:
        begun = self.collision.checks
        way = self._way(start)
        constraints = self._constraints(request, start)
        planner = self._planner(request, way, start, constraints)
        goals = Goals(self.model, self.ik, self.collision, way, start, constraints, goal)
        try:
            found, target = self._found(planner, goals, seed)
        finally:
            self.ik.solves += constraints.projections
        checks = self.collision.checks - begun
        if found is None:
            raise failing.not_found(checks, request.budget, target, way.excused)
        return Plan(found.trajectory, found.path, found.planner, checks, target)

    def _planner(
        self, request: Request, way: Way, start: Array, constraints: PathConstraints
    ) -> Planner | ConstrainedPlanner:
        if request.constraints:
            return ConstrainedPlanner(
                self.model, way, start, request.scaling, self.collision, request.budget, constraints
            )
        return Planner(self.model, way, start, request.scaling, Budget(self.collision, request.budget))

    def _found(
        self, planner: Planner | ConstrainedPlanner, goals: Goals, seed: int
    ) -> tuple[Found | None, int]:
        """What the planner found and the goal's index, or None and how many goals it looked for."""
        for near in goals.near():
            found = planner.direct([target.q for target in near])
            if found is not None:
                return found, near[found.goal].index
        targets = goals.all(seed)
        ends = [target.q for target in targets]
        found = planner.direct(ends) or planner.around(ends, seed)
        return found, len(targets) if found is None else targets[found.goal].index

    def _constraints(self, request: Request, start: Array) -> PathConstraints:
        constraints = PathConstraints(self.model, request.constraints)
        if broken := constraints.broken(start):
            raise failing.breaks("where the motion starts", broken)
        return constraints

    def _line(self, request: Request, line: Line | Offset, start: Array) -> Plan:
        begun = self.collision.checks
        way = self._way(start)
        constraints = self._constraints(request, start)
        target = line.tcp_in_world if isinstance(line, Line) else self.model.tcp(start).shifted(line.by)
        found = straight(self.model, self.ik, way, start, target)
        if found.fraction < line.least_fraction:
            contacts = () if found.blocked is None else self.collision.contacts(found.blocked)
            raise failing.line_ended(found, line.least_fraction, contacts)
        trajectory = time_smooth(self.model, found.path, request.scaling)
        if trajectory is None or not stays_free(way, trajectory):
            raise failing.line_grazes(found.fraction)
        for k, q in enumerate(trajectory.position):
            if broken := constraints.broken(q):
                raise failing.line_breaks(broken, k / (len(trajectory.position) - 1))
        checks = self.collision.checks - begun
        return Plan(trajectory, found.path, "line", checks, fraction=found.fraction)
