"""The collision test of one plan: its start may lie within the margins, because that is where the arm is."""

from __future__ import annotations

import numpy as np

from ...world.values import Array
from ..requests import ContactPair
from .collision_checker import CollisionChecker
from .robot_geometry import MarginChecker

TOLERANCE = 0.001
"""Penetration at the start that is put down to errors of the belief whatever is touched, m."""
DEVIATIONS = 3.0
"""Standard deviations of an object's believed place that are put down to errors of the belief, too: where the
arm is, the object is not."""
DEEPEST = 0.006
"""More than this is never put down to them, m."""
ZONE = 0.1
"""Around the start, where it may come no closer to what it is too close to already, rad in each joint."""
LEAVING = 0.3
"""The same for objects that are not held, rad: the hand goes up beside them before it comes clear."""
SLACK = 0.0005
"""How much closer it may come in there, m."""


class StartTolerance:
    """Free or not, for configurations of a plan from `start` (n,).

    Pairs that are closer than their margin at the start are excused near it: they may not come closer, and
    further away they must have come apart. `stuck` holds those that penetrate by more than the belief may be
    wrong: from there no plan may start.
    """

    def __init__(self, collision: CollisionChecker, start: Array) -> None:
        self.model = collision.model
        self._collision = collision
        self._start = start
        self.excused: tuple[ContactPair, ...] = ()
        self._zones: list[tuple[float, MarginChecker]] = []
        self._within = False
        if not collision.free(start):
            self.excused = collision.contacts(start)
            self._within = collision.within(start)
            self._zones.append((ZONE, collision.excusing(self.excused, SLACK)))
            loose = tuple(c for c in self.excused if self._loose(c))
            if loose:
                self._zones.append((LEAVING, collision.excusing(loose, SLACK)))
        self.stuck = tuple(c for c in self.excused if collision.penetrates(c, self._tolerated(c)))

    def free(self, q: Array) -> bool:
        """With the full margins."""
        checker = self._near_start(q) if self._zones else None
        if checker is not None:
            return self._collision.asked(checker, q, within=self._within)
        return self._collision.free(q)

    def nearly_free(self, q: Array) -> bool:
        """With halved margins: for re-checking between configurations that were found free."""
        checker = self._near_start(q) if self._zones else None
        if checker is not None:
            return self._collision.asked(checker, q, within=self._within)
        return self._collision.nearly_free(q)

    def _near_start(self, q: Array) -> MarginChecker | None:
        away = float(np.abs(q - self._start).max())
        return next((checker for zone, checker in self._zones if away <= zone), None)

    def _loose(self, contact: ContactPair) -> bool:
        """Whether one of the two is an object that is not held."""
        objects = (self._collision.believed(contact.a), self._collision.believed(contact.b))
        return any(o is not None and not o.attached for o in objects)

    def _tolerated(self, contact: ContactPair) -> float:
        """Depth at the start that may be an error of the belief, m."""
        objects = (self._collision.believed(contact.a), self._collision.believed(contact.b))
        sigma = sum(o.sigma_position for o in objects if o is not None)
        return min(TOLERANCE + DEVIATIONS * sigma, DEEPEST)
