"""Kinematic backend behind the protocol of the feed."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

from ...robots.model import RobotModel
from ...world.protocols import Clock
from ...world.values import ObjectId
from ..feed.light_curtain import LightCurtain, Zone
from ..scoring.truth import TrueBody
from ..spawning.inventory import Inventory, departed
from ..spawning.spawn import SpawnedItem
from .bodies import KinematicBodies, KinematicBody
from .camera import Posture


class KinematicCell:
    """`FeedCell` of the kinematic backend."""

    def __init__(
        self,
        model: RobotModel,
        bodies: KinematicBodies,
        inventory: Inventory,
        clock: Clock,
        period: float,
        posture: Callable[[], Posture],
    ) -> None:
        self._bodies = bodies
        self._inventory = inventory
        self._clock = clock
        self._posture = posture
        self._curtain = LightCurtain(model)
        self.period = period

    @property
    def now(self) -> float:
        return self._clock.now

    def here(self) -> tuple[TrueBody, ...]:
        return tuple(true_body(body, self._inventory) for body in self._bodies.present)

    def next_id(self) -> ObjectId:
        return self._inventory.next_id()

    def put(self, item: SpawnedItem) -> None:
        """Add an item, which is at its place of rest at once."""
        self._inventory.add(item)
        self._bodies.put(body_of(item))
        self._bodies.drop(item.id)

    def at_rest(self, items: Collection[ObjectId]) -> bool:
        return True

    def take_with(self, bin_id: ObjectId, items: Collection[ObjectId]) -> None:
        for name in items:
            body = true_body(self._bodies[name], self._inventory)
            self._inventory.depart(departed(body, bin_id, body.brought_by))
        self._bodies.forget(items)

    def arm_over(self, zone: Zone) -> bool:
        posture = self._posture()
        return self._curtain.crossed(zone, posture.position, posture.width)


def body_of(item: SpawnedItem) -> KinematicBody:
    """Return the body of a new item."""
    return KinematicBody(item.id, item.entry, item.colour, item.pose, item.entry.friction)


def true_body(body: KinematicBody, inventory: Inventory) -> TrueBody:
    """Return the ground truth of a body."""
    brought_by = inventory.here[body.id].brought_by
    true = TrueBody.of(body.id, body.entry, body.colour, body.pose)
    return replace(true, present=body.present, brought_by=brought_by)
