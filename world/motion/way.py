"""The collision test of one plan: its start may lie within the margins, because that is where the arm is."""

from __future__ import annotations

import numpy as np

from ..values import Array
from .collision import Collision
from .requests import Contact

TOLERANCE = 0.001
"""Believed penetration at the start that is put down to errors of the belief, m."""
ZONE = 0.1
"""Around the start, where it may come no closer to what it is too close to already, rad in each joint."""
SLACK = 0.0005
"""How much closer it may come in there, m."""


class Way:
    """Free or not, for configurations of a plan from `start` (n,).

    Pairs that are closer than their margin at the start are excused near it: they may not come closer.
    `stuck` holds those that penetrate by more than TOLERANCE: from there no plan may start.
    """

    def __init__(self, collision: Collision, start: Array) -> None:
        self.model = collision.model
        self._collision = collision
        self._start = start
        self.excused: tuple[Contact, ...] = ()
        self._near_start = None
        if not collision.free(start):
            self.excused = collision.contacts(start)
            self._near_start = collision.excusing(self.excused, SLACK)
        self.stuck = tuple(c for c in self.excused if collision.penetrates(c, TOLERANCE))

    def free(self, q: Array) -> bool:
        """With the full margins."""
        if self._near_start is not None and self._in_zone(q):
            return self._collision.asked(self._near_start, q)
        return self._collision.free(q)

    def nearly_free(self, q: Array) -> bool:
        """With halved margins: for re-checking between configurations that were found free."""
        if self._near_start is not None and self._in_zone(q):
            return self._collision.asked(self._near_start, q)
        return self._collision.nearly_free(q)

    def _in_zone(self, q: Array) -> bool:
        return float(np.abs(q - self._start).max()) <= ZONE
