"""Start tolerance: the collision test of one plan, whose start may be within the margins because the arm is
there."""

from __future__ import annotations

import numpy as np

from ...world.values import Array
from ..requests import ContactPair
from .collision_checker import CollisionChecker
from .robot_geometry import MarginChecker

BELIEF_PENETRATION = 0.001
"""Penetration at the start that is put down to errors of the belief, for all bodies, m."""
POSITION_SIGMAS = 3.0
"""Standard deviations of an object's believed place that are put down to errors of the belief, too.

The object cannot be where the arm is.
"""
MAX_BELIEF_PENETRATION = 0.006
"""Greatest penetration that is put down to errors of the belief, m."""
START_ZONE = 0.1
"""Size of the zone around the start in which excused pairs may come no closer, rad in each joint."""
START_ZONE_OF_OBJECTS = 0.3
"""Size of that zone for objects that are not held, rad: the hand rises next to them before it comes clear."""
APPROACH_SLACK = 0.0005
"""Greatest further approach of an excused pair in the zone, m."""


class StartTolerance:
    """Collision check of one plan's configurations (n,), rad. Contacts that exist at its `start` are excused
    near it.

    Excused pairs may not come closer near the start, and must have come apart further away. `stuck` has the
    pairs that penetrate by more than the belief may be wrong: from there no plan may start.
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
            self._zones.append((START_ZONE, collision.excusing(self.excused, APPROACH_SLACK)))
            loose = tuple(c for c in self.excused if self._loose(c))
            if loose:
                self._zones.append((START_ZONE_OF_OBJECTS, collision.excusing(loose, APPROACH_SLACK)))
        self.stuck = tuple(c for c in self.excused if collision.penetrates(c, self._tolerated(c)))

    def free(self, q: Array) -> bool:
        """Whether q keeps the full margins."""
        checker = self._near_start(q) if self._zones else None
        if checker is not None:
            return self._collision.asked(checker, q, within=self._within)
        return self._collision.free(q)

    def nearly_free(self, q: Array) -> bool:
        """Whether q keeps halved margins: for samples between configurations that were found free."""
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
        """Return the depth at the start that may be an error of the belief, m."""
        objects = (self._collision.believed(contact.a), self._collision.believed(contact.b))
        sigma = sum(o.sigma_position for o in objects if o is not None)
        return min(BELIEF_PENETRATION + POSITION_SIGMAS * sigma, MAX_BELIEF_PENETRATION)
