"""Penetration of items and fixtures with holes, measured on the contacts of the simulation."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping

from ...world.values import ObjectId
from ..engine import pb

PENETRATION_WINDOW = 1.0
"""Time for which measured depths are kept, s."""
PENETRATION_INTERVAL = 12
"""Number of steps between two measurements."""


class Penetrations:
    """Penetration monitor: contacts of items with the fixtures of one client.

    With `every` at 1 the greatest depth of each item is exact; a measurement costs 0.1 ms for an item in a
    round hole.
    """

    def __init__(self, client: int) -> None:
        self._client = client
        self._bored: Collection[int] = ()
        self._items: Mapping[ObjectId, int] = {}
        self._recent: dict[ObjectId, deque[tuple[float, float]]] = {}
        self._steps = 0
        self.every = PENETRATION_INTERVAL
        self.greatest: dict[ObjectId, float] = {}
        """Greatest depth of each item that touched a fixture since `watch`, m."""
        self.lasting: dict[ObjectId, float] = {}
        """Greatest depth of each item in two consecutive measurements since `watch`, m.

        It matters with `every` at 1: the engine may detect a new contact of a curved edge a step late, and
        corrects it in the next step.
        """
        self._before: dict[ObjectId, float] = {}

    def watch(self, items: Mapping[ObjectId, int], bored: Collection[int]) -> None:
        """Watch these items, by pybullet's body numbers; the mapping may change. Earlier measurements are
        dropped."""
        self._items, self._bored = items, frozenset(bored)
        self._recent, self.greatest, self._steps = {}, {}, 0
        self.lasting, self._before = {}, {}

    def stepped(self, now: float) -> None:
        """Measure after a step, when a measurement is due."""
        self._steps += 1
        if not self._bored or self._steps % self.every:
            return
        for name, number in self._items.items():
            contacts = pb.getContactPoints(number, physicsClientId=self._client)
            depths = [-c[8] for c in contacts if c[2] in self._bored]
            depth = max(0.0, *depths) if depths else 0.0
            if depths:
                self._note(name, now, depth)
            twice = min(depth, self._before.get(name, 0.0))
            self.lasting[name] = max(twice, self.lasting.get(name, 0.0))
            self._before[name] = depth

    def _note(self, name: ObjectId, now: float, depth: float) -> None:
        recent = self._recent.setdefault(name, deque())
        recent.append((now, depth))
        while recent[0][0] < now - PENETRATION_WINDOW:
            recent.popleft()
        self.greatest[name] = max(depth, self.greatest.get(name, 0.0))

    def of(self, name: ObjectId) -> float:
        """Return the item's greatest depth now and within the last second in which it touched a fixture,
        m."""
        number = self._items[name]
        depths = [depth for _, depth in self._recent.get(name, ())]
        low, high = pb.getAABB(number, -1, self._client)
        # The engine keeps no contacts of bodies that sleep or were restored: measure the shapes
        # themselves.
        for body, _ in pb.getOverlappingObjects(low, high, physicsClientId=self._client):
            if body in self._bored:
                near = pb.getClosestPoints(number, body, 0.0, physicsClientId=self._client)
                depths += [-point[8] for point in near]
        return max(0.0, *depths) if depths else 0.0
