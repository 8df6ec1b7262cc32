"""Contact look-ahead: what the arm would touch next, for motions without a plan."""

from __future__ import annotations

import numpy as np

from ...world.values import Array
from ..collision.start_tolerance import StartTolerance
from ..requests import ContactPair
from .plan_service import PlanService


class JogCollisionCheck:
    """Collision check of the next configurations of a moving arm, in the present belief.

    Contacts that exist already may be left. The checks are not charged, because they run while the arm moves.
    The caller expects their answer a tick late (2,000 checks take a tick of 0.05 s).
    """

    def __init__(self, plans: PlanService) -> None:
        self._plans = plans

    def __call__(self, path: Array) -> tuple[str, ...]:
        """Return the names of bodies that are touched on configurations (k, n) and halfway between them; ():
        it is free."""
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
    """Return the names of touched bodies or links of the robot, without those that the arm was near
    already."""
    left = {(c.a, c.b): c.distance for c in excused}
    met = [c for c in contacts if c.distance < left.get((c.a, c.b), 1.0)]
    return tuple(dict.fromkeys(c.b for c in met)) or ("the edge of the workspace",)
