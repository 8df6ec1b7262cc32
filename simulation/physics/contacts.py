"""Contacts of the last simulation step: points, item in the hand, penetration of items with holes, and finger
forces on fragile items."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

from picktree.simulation import TrueBody, checkpoints
from picktree.world import JournalEvent, ObjectId, event_types

from .engine import pb
from .items import PhysicsItems
from .robot_body import RobotBody
from .static_bodies import StaticBodies


@dataclass(frozen=True, slots=True)
class TrueContact:
    """Contact point with the names of two bodies: items, fixtures, bins or robot links; for tests and the
    analyst."""

    one: str
    other: str
    distance: float
    """Distance, m; negative: penetration."""
    force: float
    """Force along the normal, N."""


class ContactPoints:
    """Contact points of one client after its last step."""

    def __init__(self, body: RobotBody, items: PhysicsItems, static: StaticBodies, client: int) -> None:
        self._body = body
        self._items = items
        self._static = static
        self._client = client

    def all(self) -> tuple[TrueContact, ...]:
        """Return all contact points of the client."""
        return tuple(
            TrueContact(self._name(c[1], c[3]), self._name(c[2], c[4]), c[8], c[9])
            for c in pb.getContactPoints(physicsClientId=self._client)
        )

    def in_hand(self) -> ObjectId | None:
        """Return the item that every finger touches; None without one."""
        found: set[int] | None = None
        fingers = self._body.description.gripper.fingers
        for link, name in self._body.links.items():
            if name in fingers:
                points = pb.getContactPoints(self._body.body, linkIndexA=link, physicsClientId=self._client)
                touched = {point[2] for point in points}
                found = touched if found is None else found & touched
        names = sorted(filter(None, map(self._items.name, found or ())))
        return ObjectId(names[0]) if names else None

    def _name(self, body: int, link: int) -> str:
        if body == self._body.body:
            return self._body.links[link]
        if body in self._static.names:
            return self._static.names[body]
        return self._items.name(body) or "?"


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


MIN_EXAMINED_EFFORT_SHARE = 0.15
"""Effort of the finger drives from which contacts are examined, as a share of the least force limit."""


class CrushDetector:
    """Crush detector: examines the contacts of the fingers in every step in which they press."""

    def __init__(
        self, body: RobotBody, items: PhysicsItems, limits: Mapping[str, float], client: int
    ) -> None:
        """`limits`: greatest force of a finger that items of a kind survive, N."""
        self._body = body
        self._items = items
        self._limits = limits
        self._client = client
        self._arm = len(body.description.joints)
        self._worth = MIN_EXAMINED_EFFORT_SHARE * min(limits.values(), default=float("inf"))
        if body.description.gripper.linkage is not None:
            self._worth = 0.0
        self._greatest_forces: dict[ObjectId, checkpoints.PressedItem] = {}
        self._events: list[JournalEvent] = []

    def stepped(self, now: float, reading: checkpoints.RobotReading) -> None:
        """Examine the contacts after a step."""
        if not self._limits or max(map(abs, reading.effort[self._arm :])) < self._worth:
            return
        fingers = self._body.description.gripper.fingers
        for link, name in self._body.links.items():
            if name in fingers:
                self._look(link, name, now)

    def greatest_forces(self) -> Mapping[ObjectId, checkpoints.PressedItem]:
        """Return the greatest forces on every fragile item that was between the fingers."""
        return dict(self._greatest_forces)

    def take_events(self) -> tuple[JournalEvent, ...]:
        events, self._events = tuple(self._events), []
        return events

    def state(self) -> tuple[checkpoints.PressedItem, ...]:
        """Return the state for a checkpoint."""
        return tuple(self._greatest_forces.values())

    def restore(self, state: Iterable[checkpoints.PressedItem]) -> None:
        self._greatest_forces = {item.id: item for item in state}
        self._events = []

    def with_crush_force(self, body: TrueBody) -> TrueBody:
        """Return the item's truth with the force that crushed it, if one did."""
        pressed = self._greatest_forces.get(body.id)
        return body if pressed is None or not pressed.crushed else replace(body, crushed=pressed.force)

    def _look(self, link: int, finger: str, now: float) -> None:
        found = pb.getContactPoints(self._body.body, linkIndexA=link, physicsClientId=self._client)
        forces: dict[int, float] = {}
        for point in found:
            forces[point[2]] = forces.get(point[2], 0.0) + point[9]
        for number, force in forces.items():
            name = self._items.name(number)
            if name is not None:
                self._pressed(ObjectId(name), force, finger, now)

    def _pressed(self, name: ObjectId, force: float, finger: str, now: float) -> None:
        limit = self._limits.get(self._items.inventory.here[name].entry.kind)
        if limit is None:
            return
        before = self._greatest_forces.get(name) or checkpoints.PressedItem(name, 0.0, limit)
        gripped = force if self._body.grip.width <= 0.0 else 0.0
        if force <= before.force and gripped <= before.gripped:
            return
        after = replace(before, force=max(force, before.force), gripped=max(gripped, before.gripped))
        self._greatest_forces[name] = after
        if after.crushed and not before.crushed:
            self._events.append(
                event_types.CrushedEvent(
                    f"{name} was crushed: {finger} pressed with {force:.1f} N, and it bears {limit:g} N",
                    object=name,
                    finger=finger,
                    force=force,
                    limit=limit,
                    time=now,
                )
            )
