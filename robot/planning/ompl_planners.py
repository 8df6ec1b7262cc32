"""OMPL's planners as path searches.

They search joint space; under path constraints, the projected state space.

The request's functions alone check configurations and edges. Each search seeds OMPL's generator, creates new
objects and ends on a count. So the same problem gives the same path.

Sucan, Moll and Kavraki, "The Open Motion Planning Library", IEEE RAM 19 (2012). Kingston, Moll and Kavraki,
"Exploring implicit spaces for constrained sampling-based planning", IJRR 38 (2019).
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from picktree.world import Array

from .path_search import ConstraintProjection, PathSearch, SearchProblem

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_EXTENSION = 1.0
"""Greatest extension of a tree, rad."""
MAX_GEODESIC_STEP = 0.1
"""Greatest step of a motion under constraints between two projections, rad."""
EVALUATIONS_PER_CHECK = 5
"""Evaluations of the termination condition that count as one collision check: lazy planners may grow without
checks."""
CLASSES = {
    "rrt_connect": "RRTConnect",
    "kpiece": "KPIECE1",
    "bkpiece": "BKPIECE1",
    "lbkpiece": "LBKPIECE1",
    "rrt_star": "RRTstar",
    "informed_rrt_star": "InformedRRTstar",
    "bit_star": "BITstar",
    "aorrtc": "AORRTC",
    "prm_star": "PRMstar",
}
"""OMPL's classes by name."""
OPTIMISING = ("rrt_star", "informed_rrt_star", "bit_star", "prm_star", "aorrtc")
"""Planners that improve their path for as long as they may."""
WITHOUT_GOAL_TREE = ("kpiece", "rrt_star", "informed_rrt_star", "bit_star", "prm_star")
"""Planners that grow no tree from the goals: they hardly find into a narrow place. For them the ends of
retreat paths are starts and goals, too."""

ou.setLogLevel(ou.LOG_NONE)


def ompl_search(name: str) -> PathSearch:
    """Return the search of a built-in name."""
    return partial(_improving_search if name in OPTIMISING else _search, name)


def _search(name: str, problem: SearchProblem) -> list[Array] | None:
    """Search until the first path."""
    search = _OmplSearch(name, problem)
    return search.path() if search.solve(improve=False) else None


def _improving_search(name: str, problem: SearchProblem) -> list[Array] | None:
    """Search a path, and improve it until `enough`.

    A free straight edge to the nearest goal is the shortest path that there is.
    """
    nearest = min(problem.goals, key=lambda goal: float(np.linalg.norm(goal - problem.start)))
    if problem.between(problem.start, nearest):
        return [problem.start, nearest]
    if name == "aorrtc":
        return _aorrtc(problem)
    search = _OmplSearch(name, problem)
    solved = search.grow() if name == "prm_star" else search.solve(improve=True)
    return search.path() if solved else None


def _aorrtc(problem: SearchProblem) -> list[Array] | None:
    """Search a path to one of the goals, and improve it until `enough`.

    With several goals, or where start and goal connect at once, OMPL's AORRTC may return paths between goals.
    A path of RRT-Connect then decides on the goal, and serves if none is better.
    """
    first = None
    if len(problem.goals) > 1 or problem.constraint is not None:
        first = _search("rrt_connect", problem)
        if first is None:
            return None
        enough, spent = problem.enough, problem.spent
        problem = replace(problem, goals=[first[-1]], spent=lambda: spent() or enough())
    search = _OmplSearch("aorrtc", problem)
    found = search.path() if search.solve(improve=True) else first
    return found if found is None or np.array_equal(found[0], problem.start) else first


class _Budget:
    """Conditions that end a planner. Its own steps count, too: evaluations of these conditions."""

    def __init__(self, problem: SearchProblem) -> None:
        self._problem = problem
        self._evaluations = 0

    def spent(self) -> bool:
        self._evaluations += 1
        return self._problem.spent() or self._evaluations > EVALUATIONS_PER_CHECK * self._problem.checks

    def enough(self) -> bool:
        """Whether a path need not be improved further."""
        return self._problem.enough() or self._evaluations > self._problem.checks


class _Validator(ob.MotionValidator):
    """Motion validator that checks edges as the request does."""

    def __init__(self, information: ob.SpaceInformation, problem: SearchProblem) -> None:
        super().__init__(information)
        # The information itself is not kept: it owns the validator, and would never be freed.
        self._edge = problem.edge
        self._n = len(problem.start)

    def checkMotion(self, a: ob.State, b: ob.State) -> bool:  # noqa: N802 - OMPL's name
        return self._edge(np.array(a[0 : self._n]), np.array(b[0 : self._n]))


class _Projection(ob.Constraint):
    """Path constraints, as a projection onto the configurations where they hold."""

    def __init__(self, dimension: int, constraint: ConstraintProjection) -> None:
        super().__init__(dimension, 1)
        self._constraint = constraint

    def project(self, x: NDArray[np.float64]) -> bool:
        """Move x (n,) in place. False: no configuration nearby keeps the constraints."""
        projected = self._constraint.project(np.array(x))
        if projected is None:
            return False
        x[:] = projected
        return True

    def isSatisfied(self, x: NDArray[np.float64]) -> bool:  # noqa: N802 - OMPL's name
        return self._constraint.hold(np.array(x))


class _OmplSearch:
    """One search by one planner, with all of OMPL's objects made for it.

    Callbacks of OMPL must not refer to this object: a planner keeps its last condition, and neither would
    ever be freed.
    """

    def __init__(self, name: str, problem: SearchProblem) -> None:
        self._problem = problem
        self._n = len(problem.start)
        self._budget = _Budget(problem)
        ou.RNG.setSeed(int(problem.rng.integers(1, 2**31)))  # before anything that makes a generator
        self._information = (
            self._unconstrained() if problem.constraint is None else self._constrained(problem.constraint)
        )
        self._definition = ob.ProblemDefinition(self._information)
        self._rooted = name in WITHOUT_GOAL_TREE
        self._chains: dict[bytes, list[Array]] = {}
        for q in self._ends(problem.start):
            self._definition.addStartState(self._state(q))
        goals = ob.GoalStates(self._information)
        for goal in problem.goals:
            for q in self._ends(goal):
                goals.addState(self._state(q))
        self._definition.setGoal(goals)
        self._planner = getattr(og, CLASSES[name])(self._information)
        if hasattr(self._planner, "setRange"):
            self._planner.setRange(MAX_EXTENSION)
        if name == "informed_rrt_star":
            # Its direct samples depend on what was in memory before; the same samples by rejection do not.
            self._planner.setInformedSampling(False)
            self._planner.setSampleRejection(True)
        self._planner.setProblemDefinition(self._definition)
        self._planner.setup()

    def _ends(self, q: Array) -> list[Array]:
        """Return q, and the last configuration of its retreat path where the planner needs it."""
        chain = [q, *(self._problem.retreat(q) if self._rooted else ())]
        self._chains |= {end.tobytes(): chain for end in (chain[0], chain[-1])}
        return chain[:1] + chain[1:][-1:]

    def _joint_space(self) -> ob.RealVectorStateSpace:
        space, bounds = ob.RealVectorStateSpace(self._n), ob.RealVectorBounds(self._n)
        for joint in range(self._n):
            bounds.setLow(joint, float(self._problem.lower[joint]))
            bounds.setHigh(joint, float(self._problem.upper[joint]))
        space.setBounds(bounds)
        return space

    def _unconstrained(self) -> ob.SpaceInformation:
        information = ob.SpaceInformation(self._joint_space())
        free, n = self._problem.free, self._n
        information.setStateValidityChecker(lambda state: free(np.array(state[0:n])))
        information.setMotionValidator(_Validator(information, self._problem))
        information.setup()
        return information

    def _constrained(self, constraint: ConstraintProjection) -> ob.SpaceInformation:
        # Atlas and tangent bundle need equations; ours are inequalities, which have an inside.
        space = ob.ProjectedStateSpace(self._joint_space(), _Projection(self._n, constraint))
        information = ob.ConstrainedSpaceInformation(space)
        space.setDelta(min(MAX_GEODESIC_STEP, constraint.step))
        free, n = self._problem.free, self._n
        information.setStateValidityChecker(lambda state: free(np.array([state[k] for k in range(n)])))
        information.setup()
        return information

    def _state(self, q: Array) -> ob.State:
        state = self._information.allocState()
        values = [float(x) for x in q]
        if self._problem.constraint is not None:
            state.copy(values)
        else:
            self._information.getStateSpace().copyFromReals(state, values)
        return state

    def solve(self, *, improve: bool) -> bool:
        """Run the planner to its end, or with a path until `enough`. Returns whether it reached a goal."""
        budget, planner, definition = self._budget, self._planner, self._definition

        def found() -> bool:
            # RRT* and BIT* hand their path over at the end. AORRTC keeps the condition, which must not refer
            # to the planner.
            return math.isfinite(cost().value()) if cost else definition.hasExactSolution()

        cost = None if isinstance(planner, og.AORRTC) else getattr(planner, "bestCost", None)
        done = ob.PlannerTerminationCondition(
            lambda: budget.spent() or (improve and budget.enough() and found())
        )
        planner.solve(done)
        return definition.hasExactSolution()

    def grow(self) -> bool:
        """Grow a roadmap until `enough`, without a path until the budget is spent. Returns whether it has
        reached a goal.

        PRM's own `solve` looks for paths in a second thread, at times that no seed decides. With a condition
        that is true at once it only adds start and goals, and at last returns the path to them.
        """
        spent, always = self._budget.spent, ob.plannerAlwaysTerminatingCondition()
        for enough in (self._budget.enough, spent):
            for _ in self._problem.goals:
                self._planner.solve(always)
            self._planner.growRoadmapPtc(
                ob.PlannerTerminationCondition(lambda enough=enough: spent() or enough())
            )
            self._definition.clearSolutionPaths()
            self._planner.solve(always)
            if self._definition.hasSolution() and self._definition.getSolutionDifference() == 0.0:
                return True
        return False

    def path(self) -> list[Array]:
        """Return the corners of the found path; under constraints also the points between them."""
        path = self._definition.getSolutionPath()
        if self._problem.constraint is not None:
            path.interpolate()
        states = [path.getState(k) for k in range(path.getStateCount())]
        found = [np.array([state[k] for k in range(self._n)]) for state in states]
        first, last = (self._chains[q.tobytes()] for q in (found[0], found[-1]))
        before = first[:-1] if np.array_equal(found[0], first[-1]) else []
        after = last[-2::-1] if np.array_equal(found[-1], last[-1]) else []
        return [*before, *found, *after]
