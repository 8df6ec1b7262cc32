"""OMPL as a reference: its RRT-Connect and its path simplification among picktree's own checks and timing.

Search and shortening are OMPL's alone. Collision checker, edge steps, margin, time parameterisation, check of
the timed trajectory and the search in smaller steps after a graze are those of picktree's planner.
"""

from __future__ import annotations

from dataclasses import dataclass

from picktree.robot.planning import CollisionChecker, Scaling, time_corners
from picktree.robot.planning.collision_model import CollisionMargins
from picktree.robot.planning.joint_planner import CORNER_RADII, STEP_SHARES
from picktree.robot.planning.trajectory_check import EdgeSteps, StartTolerance, first_collision
from picktree.world import Array, PlanningScene, Trajectory
from picktree.world.robot_model import RobotModel

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

RANGE = 0.5
"""Greatest extension of a tree, rad."""
CHECKS = 200_000
"""Number of collision checks after which a search is given up."""


@dataclass(frozen=True, slots=True, eq=False)
class ReferencePlan:
    """Path (m, n), rad, and the trajectory on it; None: nothing on it is free."""

    path: Array
    trajectory: Trajectory | None


class OmplReference:
    """OMPL planner of one arm. `plan` is what is to be measured; it takes the scene over as picktree does."""

    def __init__(self, model: RobotModel, margins: CollisionMargins | None = None) -> None:
        self._model = model
        self.collision = CollisionChecker(model, margins)

    def plan(
        self, scene: PlanningScene, width: float, start: Array, goal: Array, seed: int
    ) -> ReferencePlan | None:
        """Plan from request to timed and checked trajectory; None: no path was found within CHECKS.

        A free straight edge is taken without a search, as OMPL's RRT-Connect does too at its first step.
        """
        self.collision.update(scene, width)
        way = StartTolerance(self.collision, start)
        if not way.free(goal):
            return None
        ou.RNG.setSeed(seed)
        found: ReferencePlan | None = None
        for share in STEP_SHARES:
            path = self._path(way, EdgeSteps(self._model).scaled(share), start, goal)
            if path is None:
                return found
            found = ReferencePlan(path, self._timed(way, path))
            if found.trajectory is not None:
                break
        return found

    def _path(self, way: StartTolerance, strides: EdgeSteps, start: Array, goal: Array) -> Array | None:
        """Return the simplified path (m, n), or None when the checks are spent."""
        n, end = self._model.n, self.collision.checks + CHECKS
        lower = np.minimum(np.minimum(self._model.planned_lower, start), goal)
        upper = np.maximum(np.maximum(self._model.planned_upper, start), goal)
        space = ob.RealVectorStateSpace(n)
        bounds = ob.RealVectorBounds(n)
        for joint in range(n):
            bounds.setLow(joint, float(lower[joint]))
            bounds.setHigh(joint, float(upper[joint]))
        space.setBounds(bounds)
        information = ob.SpaceInformation(space)
        information.setStateValidityChecker(lambda state: way.free(np.array(state[0:n])))
        information.setMotionValidator(_Edges(information, way, strides, n))
        information.setup()
        ends = [information.allocState(), information.allocState()]
        for state, q in zip(ends, (start, goal), strict=True):
            space.copyFromReals(state, q.tolist())
        problem = ob.ProblemDefinition(information)
        problem.setStartAndGoalStates(*ends)
        planner = og.RRTConnect(information)
        planner.setRange(RANGE)
        planner.setProblemDefinition(problem)
        planner.setup()
        planner.solve(ob.PlannerTerminationCondition(lambda: self.collision.checks >= end))
        if not problem.hasExactSolution():
            return None
        path = problem.getSolutionPath()
        og.PathSimplifier(information).simplifyMax(path)
        return np.array([path.getState(k)[0:n] for k in range(path.getStateCount())])

    def _timed(self, way: StartTolerance, path: Array) -> Trajectory | None:
        for radius in CORNER_RADII if len(path) > 2 else CORNER_RADII[:1]:
            trajectory = time_corners(self._model, path, Scaling(), radius)
            if trajectory is not None and first_collision(way, trajectory) is None:
                return trajectory
        return None


class _Edges(ob.MotionValidator):
    """Edges in picktree's steps. The first state of an edge is known to be free."""

    def __init__(
        self, information: ob.SpaceInformation, way: StartTolerance, strides: EdgeSteps, n: int
    ) -> None:
        super().__init__(information)
        self._way, self._strides, self._n = way, strides, n

    def checkMotion(self, a: ob.State, b: ob.State) -> bool:  # noqa: N802
        """Whether all steps from a (exclusive) to b are free."""
        n = self._n
        return self._strides.free(self._way.count_free, np.array(a[0:n]), np.array(b[0:n]))


ou.setLogLevel(ou.LOG_NONE)
