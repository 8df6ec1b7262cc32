"""Crush detection: true forces of the fingers on fragile items, and items that they have crushed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from ...world.events.run_events import CrushedEvent
from ...world.journal import JournalEvent
from ...world.values import ObjectId
from ..checkpoints.physics_state import PressedItem, RobotReading
from ..engine import pb
from ..scoring.truth import TrueBody
from .items import PhysicsItems
from .robot.robot_body import RobotBody

MIN_EXAMINED_EFFORT_SHARE = 0.15
"""Effort of the finger drives from which contacts are examined, as a share of the least force limit."""


@dataclass(frozen=True, slots=True)
class PeakFingerForce:
    """Greatest force of one finger on a fragile item so far, and the force that the item survives, N."""

    force: float
    limit: float
    gripped: float = 0.0
    """Greatest force while the fingers had the command to close, N; other forces were bumps."""

    @property
    def crushed(self) -> bool:
        return self.force > self.limit


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
        self._most: dict[ObjectId, PeakFingerForce] = {}
        self._events: list[JournalEvent] = []

    def stepped(self, now: float, reading: RobotReading) -> None:
        """Examine the contacts after a step."""
        if not self._limits or max(map(abs, reading.effort[self._arm :])) < self._worth:
            return
        fingers = self._body.description.gripper.fingers
        for link, name in self._body.links.items():
            if name in fingers:
                self._look(link, name, now)

    def most(self) -> Mapping[ObjectId, PeakFingerForce]:
        """Return the greatest forces on every fragile item that was between the fingers."""
        return dict(self._most)

    def take_events(self) -> tuple[JournalEvent, ...]:
        events, self._events = tuple(self._events), []
        return events

    def state(self) -> tuple[PressedItem, ...]:
        """Return the state for a checkpoint."""
        return tuple(PressedItem(name, p.force, p.limit, p.gripped) for name, p in self._most.items())

    def restore(self, state: Iterable[PressedItem]) -> None:
        self._most = {item.id: PeakFingerForce(item.force, item.limit, item.gripped) for item in state}
        self._events = []

    def told(self, body: TrueBody) -> TrueBody:
        """Return the item's truth with the force that crushed it, if one did."""
        pressed = self._most.get(body.id)
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
        before = self._most.get(name) or PeakFingerForce(0.0, limit)
        gripped = force if self._body.grip.width <= 0.0 else 0.0
        if force <= before.force and gripped <= before.gripped:
            return
        after = PeakFingerForce(max(force, before.force), limit, max(gripped, before.gripped))
        self._most[name] = after
        if after.crushed and not before.crushed:
            self._events.append(
                CrushedEvent(
                    f"{name} was crushed: {finger} pressed with {force:.1f} N, and it bears {limit:g} N",
                    object=name,
                    finger=finger,
                    force=force,
                    limit=limit,
                    time=now,
                )
            )
