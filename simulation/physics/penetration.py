"""How deep items and fixtures with holes are in each other: contacts of the simulation, measured."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping

from ...world.values import ObjectId
from .engine import pb

WINDOW = 1.0
"""What was is kept for so long, s."""
EVERY = 12
"""Steps between two looks."""


class Penetrations:
    """Watches the contacts of items with the fixtures of one client. `every` may be set to 1 by whoever wants
    the greatest depth of each item exactly; a look costs 0.1 ms for an item that is in a round hole."""

    def __init__(self, client: int) -> None:
        self._client = client
        self._bored: Collection[int] = ()
        self._items: Mapping[ObjectId, int] = {}
        self._recent: dict[ObjectId, deque[tuple[float, float]]] = {}
        self._steps = 0
        self.every = EVERY
        self.greatest: dict[ObjectId, float] = {}
        """Of each item that ever was at a fixture since `watch`, m."""
        self.lasting: dict[ObjectId, float] = {}
        """The same of what was seen at two looks in a row. With `every` at 1: the engine may notice a new
        contact of a curved edge a step late, and takes it back in the next."""
        self._before: dict[ObjectId, float] = {}

    def watch(self, items: Mapping[ObjectId, int], bored: Collection[int]) -> None:
        """From now on these items, which may change, by pybullet's body numbers; nothing is remembered."""
        self._items, self._bored = items, frozenset(bored)
        self._recent, self.greatest, self._steps = {}, {}, 0
        self.lasting, self._before = {}, {}

    def stepped(self, now: float) -> None:
        """To be called after each step."""
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
        while recent[0][0] < now - WINDOW:
            recent.popleft()
        self.greatest[name] = max(depth, self.greatest.get(name, 0.0))

    def of(self, name: ObjectId) -> float:
        """The greatest depth of the item now, and within the last second in which it was seen to touch a
        fixture, m."""
        number = self._items[name]
        depths = [depth for _, depth in self._recent.get(name, ())]
        low, high = pb.getAABB(number, -1, self._client)
        # Contacts of what sleeps, or was restored, are not kept: the shapes themselves are asked.
        for body, _ in pb.getOverlappingObjects(low, high, physicsClientId=self._client):
            if body in self._bored:
                near = pb.getClosestPoints(number, body, 0.0, physicsClientId=self._client)
                depths += [-point[8] for point in near]
        return max(0.0, *depths) if depths else 0.0
