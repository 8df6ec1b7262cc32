"""RRT-Connect by OMPL: between a start and any of several goals, shortened afterwards.

Kuffner and LaValle, "RRT-Connect: an efficient approach to single-query path planning", ICRA 2000.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from ..values import Array

RANGE = 0.5
"""Greatest extension of a tree, rad."""
SHORTEN = (40, 10)
"""Attempts to shorten a path, and how many in vain end it."""

ou.setLogLevel(ou.LOG_NONE)

Free = Callable[[Array], bool]
EdgeFree = Callable[[Array, Array], bool]


class _Motions(ob.MotionValidator):
    """Edges by our own test. It must not hold the space information: that would leak it."""

    def __init__(self, information: ob.SpaceInformation, edge: EdgeFree, n: int) -> None:
        super().__init__(information)
        self._edge = edge
        self._n = n

    def checkMotion(self, a: ob.State, b: ob.State) -> bool:  # noqa: N802
        return self._edge(np.array(a[0 : self._n]), np.array(b[0 : self._n]))


def connect(
    lower: Array,
    upper: Array,
    start: Array,
    goals: Sequence[Array],
    free: Free,
    edge: EdgeFree,
    give_up: Callable[[], bool],
    seed: int,
) -> Array | None:
    """A path (m, n) from start to one of the goals, or None when `give_up` came true first.

    The answer depends on the arguments alone: all of OMPL's objects are new for each call, after `seed`
    (positive) was set.
    """
    n = len(start)
    ou.RNG.setSeed(seed)
    space = ob.RealVectorStateSpace(n)
    bounds = ob.RealVectorBounds(n)
    for joint in range(n):
        bounds.setLow(joint, float(lower[joint]))
        bounds.setHigh(joint, float(upper[joint]))
    space.setBounds(bounds)
    information = ob.SpaceInformation(space)
    information.setStateValidityChecker(lambda state: free(np.array(state[0:n])))
    information.setMotionValidator(_Motions(information, edge, n))
    information.setup()

    def state_of(q: Array) -> ob.State:
        state = information.allocState()
        space.copyFromReals(state, [float(x) for x in q])
        return state

    problem = ob.ProblemDefinition(information)
    problem.addStartState(state_of(start))
    ends = ob.GoalStates(information)
    for goal in goals:
        ends.addState(state_of(goal))
    problem.setGoal(ends)
    planner = og.RRTConnect(information)
    planner.setRange(RANGE)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(ob.PlannerTerminationCondition(give_up))
    if not problem.hasExactSolution():
        return None
    path = problem.getSolutionPath()
    shorter = og.PathSimplifier(information)
    shorter.reduceVertices(path, *SHORTEN)
    shorter.partialShortcutPath(path, *SHORTEN)
    shorter.ropeShortcutPath(path)
    shorter.reduceVertices(path, *SHORTEN)
    return np.array([path.getState(k)[0:n] for k in range(path.getStateCount())])
