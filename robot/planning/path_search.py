"""Interface of path planners: the problem that each solves.

Built-in planners and those of plug-ins (entry point group `picktree.planners`) have the same form.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from picktree.files import PicktreeError
from picktree.world import Array

EdgeFree = Callable[[Array, Array], bool]
"""Whether everything between two configurations is free, and the second one, where that is not known
before."""
END_TOLERANCE = 1e-6
"""Greatest distance of a path's ends from start and goal, rad."""


@dataclass(frozen=True, slots=True)
class ConstraintProjection:
    """Path constraints of a search, for configurations (n,), rad."""

    hold: Callable[[Array], bool]
    """Whether the constraints hold; `free` and the edges test it, too."""
    project: Callable[[Array], Array | None]
    """Return the nearest configuration on which they hold with a reserve; None: none was found."""
    step: float
    """Greatest step between two projections after which they still hold in between, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class SearchProblem:
    """Problem of a path search: from `start` to one of `goals`, configurations (n,), rad.

    Margins, path constraints and the budget are those of the request; the functions keep them.
    """

    lower: Array
    """Lower joint limits (n,) of the configurations in between, rad. Start and goals are within them."""
    upper: Array
    start: Array
    goals: Sequence[Array]
    free: Callable[[Array], bool]
    """Whether a configuration keeps margins and constraints. False once the budget is spent."""
    edge: EdgeFree
    """Whether the straight segment from a (exclusive) to b (inclusive) is free, in the arm's steps."""
    between: EdgeFree
    """Whether the straight segment between two free configurations is free."""
    spent: Callable[[], bool]
    """Whether the budget of collision checks is spent. A search must end then."""
    enough: Callable[[], bool]
    """Whether a search that has a path should stop improving it: the rest is for shortening and timing."""
    checks: int
    """Collision checks that the budget has left when the search begins."""
    rng: np.random.Generator
    """The only source of random numbers, keyed by node and seed."""
    retreat: Callable[[Array], Sequence[Array]] = lambda _: ()
    """Return configurations that lead out of a narrow place at a configuration by free edges, in their order;
    () under constraints. A path may begin and end with them."""
    constraint: ConstraintProjection | None = None
    """Path constraints; None without any."""


PathSearch: TypeAlias = Callable[[SearchProblem], Sequence[Array] | None]
"""Search of a path: configurations (n,) from the start to one of the goals, with free edges; None: the budget
is spent."""


@dataclass(frozen=True, slots=True)
class PathPlanner:
    """Path search with the name under which plans record it."""

    name: str
    search: PathSearch

    def solve(self, problem: SearchProblem) -> list[Array] | None:
        """Return the path of a search; None: the budget is spent.

        Raises PicktreeError for a path that does not lead from the start to a goal.
        """
        nearest = min(problem.goals, key=lambda goal: float(np.linalg.norm(goal - problem.start)))
        if float(np.abs(nearest - problem.start).max()) < END_TOLERANCE:
            return [problem.start, nearest]
        found = self.search(problem)
        if found is None:
            return None
        path = [np.array(q, dtype=np.float64) for q in found]
        shape = problem.start.shape
        if len(path) < 2 or not all(q.shape == shape and bool(np.isfinite(q).all()) for q in path):
            raise PicktreeError(f"the planner {self.name!r} returned no path of configurations {shape}")
        apart = [float(np.abs(goal - path[-1]).max()) for goal in problem.goals]
        if float(np.abs(path[0] - problem.start).max()) > END_TOLERANCE or min(apart) > END_TOLERANCE:
            message = f"the planner {self.name!r} returned a path that does not lead from the start to a goal"
            raise PicktreeError(message)
        return path
