"""Physics backend behind the protocol of the feed."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from ...robots.description import RobotDescription
from ...robots.model import RobotModel
from ...world.values import ObjectId
from ..feed.light_curtain import LightCurtain, Zone
from ..scoring.truth import TrueBody
from ..spawning.spawn import SpawnedItem
from .items import PhysicsItems
from .robot.devices import EVERYDAY_PERIOD, IdealSensors


class PhysicsCell:
    """`FeedCell` of the physics backend."""

    def __init__(self, robot: RobotDescription, items: PhysicsItems, senses: IdealSensors) -> None:
        self._items = items
        self._senses = senses
        self._joints = len(robot.joints)
        self._curtain = LightCurtain(RobotModel(robot))

    @property
    def now(self) -> float:
        return self._senses.now

    @property
    def period(self) -> float:
        return EVERYDAY_PERIOD

    def here(self) -> tuple[TrueBody, ...]:
        return self._items.here()

    def next_id(self) -> ObjectId:
        return self._items.inventory.next_id()

    def put(self, item: SpawnedItem) -> None:
        self._items.put(item)

    def at_rest(self, items: Collection[ObjectId]) -> bool:
        return self._items.at_rest(items)

    def take_with(self, bin_id: ObjectId, items: Collection[ObjectId]) -> None:
        self._items.take_with(bin_id, items)

    def arm_over(self, zone: Zone) -> bool:
        """Return whether any part of the arm is over the zone, by the true joint positions."""
        position = self._senses.reading.position
        arm, fingers = position[: self._joints], position[self._joints :]
        return self._curtain.crossed(zone, np.array(arm), sum(fingers))
