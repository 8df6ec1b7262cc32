"""Reachability of a pose: the cheap test before planning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...world.values import Array
from .configuration_cost import configuration_cost
from .goal_configurations import HOME_CONFIGURATION, SOLUTIONS_PER_POSE, UNCOMFORTABLE_COST
from .requests import ContactPair, PoseGoal, Request
from .solver import RequestSolver


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
