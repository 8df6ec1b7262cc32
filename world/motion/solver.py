"""From one request to one plan or one typed failure: no charging, no noting, no judging."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..robot.model import RobotModel
from ..scene.planning_scene import PlanningScene
from ..values import Array, Bounds
from . import failing
from .collision import Collision
from .ik import InverseKinematics
from .lines import straight
from .planner import Budget, Found, Planner, stays_free
from .posture import discomfort
from .requests import Goal, JointGoal, Line, NamedGoal, Offset, Plan, PoseGoal, Request
from .timing import time_smooth
from .way import Way

HOME = "home"
UNCOMFORTABLE = 0.3
"""See `posture.discomfort`, rad."""
SOLUTIONS = 4
"""IK solutions that are looked for, for each pose."""


@dataclass(frozen=True, slots=True, eq=False)
class _Target:
    """A configuration (n,) that reaches pose number `index` of the goal."""

    q: Array
    index: int


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
    ) -> None:
        """`configuration` and `width` say where arm (n,) rad and fingers (m) are when a request does not."""
        self.model = model
        self.collision = Collision(model, workspace=workspace)
        self.ik = InverseKinematics(model)
        self._scene = scene
        self._configuration = configuration
        self._width = width
        self._home = model.named(HOME)

    def solve(self, request: Request, seed: int) -> Plan:
        """The plan for a request. Fails with planning.*, see `PlanService.solve`."""
        self.look(request)
        start = self.start(request)
        if isinstance(request.target, Line | Offset):
            return self._line(request, request.target, start)
        return self._plan(request, request.target, start, seed)

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
            self.collision.update(self.scene(request), self.width(request))

    def _way(self, start: Array) -> Way:
        way = Way(self.collision, start)
        if way.stuck:
            raise failing.stuck(way.stuck)
        return way

    def _plan(self, request: Request, goal: Goal, start: Array, seed: int) -> Plan:
        begun = self.collision.checks
        way = self._way(start)
        planner = Planner(self.model, way, start, request.scaling, Budget(self.collision, request.budget))

        def plan(found: Found, targets: Sequence[_Target]) -> Plan:
            checks = self.collision.checks - begun
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
            checks = self.collision.checks - begun
            raise failing.not_found(checks, request.budget, len(targets), way.excused)
        return plan(found, targets)

    def _near_targets(self, goal: PoseGoal, start: Array, way: Way) -> list[_Target]:
        """For each pose the solution that the start itself leads to, where it is free. Where that one is
        uncomfortable, also the one that home leads to: else the arm would wander into its limits."""
        targets: list[_Target] = []
        for k, pose in enumerate(goal.tcp_in_world):
            q = self.ik.descend(pose, start)
            if q is not None and way.free(q):
                targets.append(_Target(q, k))
            if q is None or discomfort(self.model, q) > UNCOMFORTABLE:
                other = self.ik.descend(pose, self._home)
                if other is not None and way.free(other):
                    targets.append(_Target(other, k))
        return targets

    def _all_targets(self, goal: PoseGoal, start: Array, way: Way, seed: int) -> list[_Target]:
        """Free configurations for all poses of the goal. Fails when there is none."""
        rng = np.random.default_rng(seed)
        before = self.ik.solves
        solved = [
            _Target(q, k)
            for k, pose in enumerate(goal.tcp_in_world)
            for q in self.ik.solutions(pose, rng, start, SOLUTIONS)
        ]
        if not solved:
            raise failing.out_of_reach(goal.tcp_in_world, self.ik.solves - before)
        targets = [target for target in solved if way.free(target.q)]
        if not targets:
            each = [self.collision.contacts(target.q) for target in solved]
            raise failing.goal_in_collision(each, len(goal.tcp_in_world))
        return targets

    def _joint_target(self, goal: NamedGoal | JointGoal, way: Way) -> Array:
        q = self.model.named(goal.name) if isinstance(goal, NamedGoal) else np.array(goal.position)
        if bool(np.any(q < self.model.lower) or np.any(q > self.model.upper)):
            raise failing.outside_limits(q)
        if not way.free(q):
            raise failing.goal_in_collision([self.collision.contacts(q)], 1)
        return q

    def _line(self, request: Request, line: Line | Offset, start: Array) -> Plan:
        begun = self.collision.checks
        way = self._way(start)
        target = line.tcp_in_world if isinstance(line, Line) else self.model.tcp(start).shifted(line.by)
        found = straight(self.model, self.ik, way, start, target)
        if found.fraction < line.least_fraction:
            contacts = () if found.blocked is None else self.collision.contacts(found.blocked)
            raise failing.line_ended(found, line.least_fraction, contacts)
        trajectory = time_smooth(self.model, found.path, request.scaling)
        if trajectory is None or not stays_free(way, trajectory):
            raise failing.line_grazes(found.fraction)
        checks = self.collision.checks - begun
        return Plan(trajectory, found.path, "line", checks, fraction=found.fraction)
