"""A bare OMPL solve as a reference: RRT-Connect and OMPL's simplification on pinocchio's broad phase.

Nothing of picktree's planner is used: a callable that asks pinocchio, OMPL's motion validator and defaults.
"""

from __future__ import annotations

from picktree.planning.collision.collision_bodies import CoalShapes, fixed_bodies, movable_bodies
from picktree.planning.collision.collision_checker import robot_geometry
from picktree.robots.model import RobotModel, se3
from picktree.world.belief.planning_scene import PlanningScene
from picktree.world.values import Array

import numpy as np
import pinocchio as pin
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

RANGE = 0.5
"""Greatest extension of a tree, rad."""
RESOLUTION = 0.03
"""Of an edge, rad."""
CHECKS = 200_000
"""After which it gives up."""


class BarePlanner:
    """One arm among the bodies of one scene; what is made here is not part of the measured time."""

    def __init__(
        self,
        model: RobotModel,
        scene: PlanningScene,
        width: float,
        allowed: tuple[tuple[str, str], ...],
        margin: float,
    ) -> None:
        self._model = model
        self._full_q = model.full_q(np.zeros(model.n), width)
        self._arm_q = [model.full.joints[model.full.getJointId(j)].idx_q for j in model.description.joints]
        self._geometry = pin.GeometryModel()
        shapes = CoalShapes()
        robot = [(o, model.full.frames[o.parentFrame].name) for o in robot_geometry(model)]
        for o, _ in robot:
            self._geometry.addGeometryObject(o)
        bodies = (*fixed_bodies(scene), *movable_bodies(scene.objects))
        for k, body in enumerate(bodies):
            shape = shapes.of(body.shape)
            self._geometry.addGeometryObject(pin.GeometryObject(f"body {k}", 0, 0, se3(body.pose), shape))
        disabled = {frozenset(pair) for pair in (*model.description.disabled_pairs, *allowed)}
        for i, (a, link) in enumerate(robot):
            for j, (b, other) in enumerate(robot[i + 1 :], i + 1):
                if a.parentJoint != b.parentJoint and frozenset((link, other)) not in disabled:
                    self._geometry.addCollisionPair(pin.CollisionPair(i, j))
            for j, body in enumerate(bodies, len(robot)):
                if a.parentJoint > 0 and frozenset((link, body.name)) not in disabled:
                    self._geometry.addCollisionPair(pin.CollisionPair(i, j))
        count = self._geometry.ngeoms
        self._geometry_data = pin.GeometryData(self._geometry)
        self._geometry_data.setSecurityMargins(self._geometry, np.full((count, count), margin), True, False)
        self._data = model.full.createData()
        self._manager = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
            model.full, self._geometry, self._geometry_data
        )
        self.checks = 0

    def free(self, state: ob.State) -> bool:
        self.checks += 1
        self._full_q[self._arm_q] = state[0 : self._model.n]
        return not pin.computeCollisions(self._model.full, self._data, self._manager, self._full_q, True)

    def plan(self, start: Array, goal: Array, seed: int) -> Array | None:
        """The simplified path (m, n), or None after CHECKS."""
        ou.setLogLevel(ou.LOG_NONE)
        ou.RNG.setSeed(seed)
        n = self._model.n
        space = ob.RealVectorStateSpace(n)
        bounds = ob.RealVectorBounds(n)
        for joint in range(n):
            bounds.setLow(joint, float(self._model.lower[joint]))
            bounds.setHigh(joint, float(self._model.upper[joint]))
        space.setBounds(bounds)
        information = ob.SpaceInformation(space)
        information.setStateValidityChecker(self.free)
        information.setStateValidityCheckingResolution(RESOLUTION / space.getMaximumExtent())
        information.setup()
        ends: list[ob.State] = []
        for q in (start, goal):
            state = information.allocState()
            space.copyFromReals(state, [float(x) for x in q])
            ends.append(state)
        problem = ob.ProblemDefinition(information)
        problem.addStartState(ends[0])
        goals = ob.GoalStates(information)
        goals.addState(ends[1])
        problem.setGoal(goals)
        planner = og.RRTConnect(information)
        planner.setRange(RANGE)
        planner.setProblemDefinition(problem)
        planner.setup()
        planner.solve(ob.PlannerTerminationCondition(lambda: self.checks >= CHECKS))
        if not problem.hasExactSolution():
            return None
        path = problem.getSolutionPath()
        og.PathSimplifier(information).simplifyMax(path)
        return np.array([path.getState(k)[0:n] for k in range(path.getStateCount())])
