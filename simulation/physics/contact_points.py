"""Contact points of the last simulation step with the names of the touching bodies, and the item in the
hand."""

from __future__ import annotations

from dataclasses import dataclass

from ...world.values import ObjectId
from ..engine import pb
from .items import PhysicsItems
from .robot.robot_body import RobotBody
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
        """Return the item that every finger touches; None: there is none."""
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
