"""Planning worker: a second process that plans what is needed later, while the ticks of this one go on.

What it answers depends on its order alone, so that a run with a worker is the same run, bit for bit.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Literal

from ...world.belief.planning_scene import PlanningScene, SceneSnapshot
from ...world.causes import Failure
from ...world.robot_model.model import RobotModel
from ...world.values import Array, Bounds
from .motion_chain import MotionChain
from .requests import MotionPlan, Request
from .solver import RequestSolver

IMPROVING_CHECKS = 2000
"""Number of collision checks by which a leg's path is improved ahead. They take 50 ms of the simulated second
in which nobody waits for the plan."""
_STANDARD_STREAMS = 3
"""Number of open files that a worker keeps beside its connection."""


@dataclass(frozen=True, slots=True, eq=False)
class ChainOrder:
    """Chain of motions to plan, with all that its plan depends on."""

    legs: tuple[Request, ...]
    seeds: tuple[int, ...]
    rounded: float
    """Length of a straight line that may be rounded at each of its ends, m."""
    belief: SceneSnapshot
    start: Array
    """Configuration (n,) of a first leg without a start, rad."""
    width: float
    """Opening of the fingers for legs that give none, m."""
    finds_nothing: bool
    """Whether an injected fault keeps the planner from finding a path."""


@dataclass(frozen=True, slots=True, eq=False)
class ChainAnswer:
    """Plan of a chain, or the failure that it came to, with what it took."""

    plan: MotionPlan | Failure
    checks: int
    """Collision checks."""
    thoughts: int
    """Collision checks and IK descents; each costs the same simulated time."""


def solve_chain(solver: RequestSolver, order: ChainOrder) -> ChainAnswer:
    """Plan a chain with a solver whose belief is that of the order, and shorten what was not direct."""
    solver.finds_nothing, solver.improving = order.finds_nothing, IMPROVING_CHECKS
    checks, descents = solver.collision.checks, solver.ik.solves
    plan: MotionPlan | Failure
    try:
        plan = MotionChain(solver, order.rounded).solve(order.legs, order.seeds)
    except Failure as failure:
        plan = failure
    finally:
        solver.improving = 0
    checks = solver.collision.checks - checks
    return ChainAnswer(plan, checks, checks + solver.ik.solves - descents)


class ChainSolver:
    """Solver of chains that takes belief, arm and fingers from each order."""

    def __init__(
        self, model: RobotModel, scene: PlanningScene, workspace: Bounds | None, planner: str
    ) -> None:
        """Use the fixtures and bins of `scene`, and the planner of that name."""
        self._scene = scene.supposing()
        self._start = model.named("home")
        self._width = 0.0
        self._solver = RequestSolver(
            model,
            self._scene,
            configuration=lambda: self._start,
            width=lambda: self._width,
            workspace=workspace,
            planner=planner,
        )

    def solve(self, order: ChainOrder) -> ChainAnswer:
        self._start, self._width = order.start, order.width
        self._scene.restore(order.belief, {})
        with self._scene.allow(*((min(pair), max(pair)) for pair in order.belief.allowed)):
            return solve_chain(self._solver, order)


def has_second_core() -> bool:
    """Whether this process may use more than one core of its machine."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0)) > 1
    return (os.cpu_count() or 1) > 1


class PlanningWorker:
    """Second process that plans chains in their order. It is forked at the first one, with all that is
    loaded by then, and ends with this process.

    Where it cannot be started, or ended before its time, chains are planned here.
    """

    def __init__(self, solver: Callable[[], ChainSolver]) -> None:
        """`solver` makes the solver of the worker."""
        self._make_solver = solver
        self._connection: Connection | Literal["none", "lost"] = "none"

    def send(self, order: ChainOrder) -> bool:
        """Give the worker an order; False: there is no worker."""
        if self._connection == "none":
            self._connection = self._start()
        if isinstance(self._connection, str):
            return False
        try:
            self._connection.send(order)
        except OSError:
            self._connection = "lost"
        return self._connection != "lost"

    def receive(self, order: ChainOrder) -> ChainAnswer:
        """Return the answer to the oldest order that was sent. Waits for it, in wall time."""
        if isinstance(self._connection, Connection):
            try:
                return self._connection.recv()
            except (EOFError, OSError):
                self._connection = "lost"
        return self._make_solver().solve(order)

    def _start(self) -> Connection | Literal["lost"]:
        if "fork" not in multiprocessing.get_all_start_methods():
            return "lost"
        context = multiprocessing.get_context("fork")
        ours, theirs = context.Pipe()
        try:
            context.Process(target=self._serve, args=(theirs,), name="planning", daemon=True).start()
        except (OSError, AssertionError):  # no memory, or this process may not have children
            return "lost"
        theirs.close()
        return ours

    def _serve(self, connection: Connection) -> None:
        """Answer orders until the other process closes the connection or ends."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # instead of the handler that ends a run
        # An open log would look as if its run still went on when only the worker is left.
        os.closerange(_STANDARD_STREAMS, connection.fileno())
        os.closerange(connection.fileno() + 1, os.sysconf("SC_OPEN_MAX"))
        # What fails here fails again in the other process, which tells it.
        with suppress(Exception):
            solver = self._make_solver()
            while True:
                connection.send(solver.solve(connection.recv()))
