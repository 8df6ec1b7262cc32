"""What the arm would touch next, for motions that nobody has planned."""

from __future__ import annotations

import numpy as np

from ...world.values import Array
from ..collision.start_tolerance import StartTolerance
from ..requests import ContactPair
from .plan_service import PlanService


class JogCollisionCheck:
    """Asks the fast checker about the next configurations of an arm that is moving, in the belief as it is.

    What the arm is too close to already may be left. The checks are not charged: they are made while the arm
    moves, and who asks counts on their answer coming a tick late (2,000 checks take a tick of 0.05 s).
    """

    def __init__(self, plans: PlanService) -> None:
        self._plans = plans

    def __call__(self, path: Array) -> tuple[str, ...]:
        """Names of what is met on configurations (k, n) and halfway between them; nothing: it is free."""
        solver = self._plans.solver
        solver.look()
        collision = solver.collision
        between = (path[:-1] + path[1:]) / 2
        way = StartTolerance(collision, path[0])
        for q in np.concatenate([path[1:], between]):
            if not way.free(q):
                return _names(collision.contacts(q), way.excused)
        return ()


def _names(contacts: tuple[ContactPair, ...], excused: tuple[ContactPair, ...]) -> tuple[str, ...]:
    """The other bodies, or the robot's own links, that are met, without those that it was near already."""
    left = {(c.a, c.b): c.distance for c in excused}
    met = [c for c in contacts if c.distance < left.get((c.a, c.b), 1.0)]
    return tuple(dict.fromkeys(c.b for c in met)) or ("the edge of the workspace",)
