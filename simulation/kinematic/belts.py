"""Belts of the kinematic backend: items on a belt move with it exactly and fall off at its end. The feed's
access to the cell is here, too."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from picktree.simulation import (
    BeltDrive,
    BeltState,
    Inventory,
    LightCurtain,
    SpawnedItem,
    TrueBody,
    Zone,
    check_belts,
)
from picktree.world import Clock, ObjectId, Vector3, ray_span
from picktree.world.robot_model import RobotModel
from picktree.world.scene import Belt, Fixture, SceneDescription

from .bodies import KinematicBodies, KinematicBody, Prism
from .camera import Posture

MAX_SUPPORT_GAP = 1e-3
"""Largest gap between an item and its supporting surface, m."""
LANDING_DISTANCE = 1e-3
"""Distance from the belt's end to the landing place of an item that falls off, m."""


class KinematicBelt(BeltDrive):
    """One belt of the kinematic backend."""

    def __init__(
        self, belt: Belt, fixture: Fixture, bodies: KinematicBodies, floor: float, period: float
    ) -> None:
        super().__init__(belt, fixture)
        self._bodies = bodies
        self._floor = floor
        self._period = period
        ahead = self.track.pose.rotation()[:, 0]
        self._ahead: Vector3 = (float(ahead[0]), float(ahead[1]), 0.0)

    def step(self) -> None:
        if not self.moving:
            return
        self.state = self.state.after(self.belt.speed, self._period)
        way = self.state.speed * self._period
        if way > 0.0:
            self._carry(way)

    def interrupted(self) -> bool:
        """Return whether an item interrupts the light barrier. The arm has no body here."""
        one, other = (np.array(end) for end in self.track.beam(self.belt.eye))
        height = float(one[2])
        beam = (other - one)[None]
        for body, prism in self._bodies.standing():
            if prism.low[2] < height < prism.high[2] and _crosses(prism, one.tolist(), other.tolist()):
                rotation, position = body.pose.rotation(), np.array(body.pose.position)
                near, far = ray_span(body.entry.shape, rotation, position, one, beam)
                if near[0] <= far[0] and far[0] >= 0.0 and near[0] <= 1.0:
                    return True
        return False

    def _carry(self, way: float) -> None:
        x, y, _ = self._ahead
        riding = self._riding()
        self._bodies.shift([body.id for body in riding], (x * way, y * way, 0.0))
        for body in riding:
            self._drop_beyond(body.id)

    def _riding(self) -> list[KinematicBody]:
        """Return the items on the belt, and the items on top of them."""
        riding: list[KinematicBody] = []
        tops: list[Prism] = []
        track = self.track
        for body, prism in sorted(self._bodies.standing(), key=lambda each: (each[1].low[2], each[0].id)):
            low = prism.low[2]
            on_belt = abs(low - track.height) <= MAX_SUPPORT_GAP and track.carries(body.pose.position)
            if on_belt or any(abs(low - p.high[2]) <= MAX_SUPPORT_GAP and p.overlaps(prism) for p in tops):
                riding.append(body)
                tops.append(prism)
        return riding

    def _drop_beyond(self, item: ObjectId) -> None:
        """Drop an item beyond the belt's end once its middle has left the belt."""
        body, track = self._bodies[item], self.track
        along, _ = track.place(body.pose.position)
        if along <= track.length / 2:
            return
        reach = Prism.of(item, body.entry.shape, body.pose).outline.reach
        beyond = track.length / 2 + reach + LANDING_DISTANCE - along
        x, y, _ = self._ahead
        self._bodies.put(replace(body, pose=body.pose.shifted((x * beyond, y * beyond, 0.0))))
        self._bodies.fall(item, self._floor)


def _crosses(prism: Prism, one: Vector3, other: Vector3) -> bool:
    """Return whether the box around the outline meets the box around the line."""
    return all(
        prism.low[k] <= max(one[k], other[k]) and min(one[k], other[k]) <= prism.high[k] for k in (0, 1)
    )


class KinematicBelts:
    """All belts of a scene."""

    def __init__(self, scene: SceneDescription, bodies: KinematicBodies, floor: float, period: float) -> None:
        self.drives: Mapping[ObjectId, KinematicBelt] = MappingProxyType(
            {b.id: KinematicBelt(b, scene.fixture(b.id), bodies, floor, period) for b in scene.belts}
        )

    def step(self) -> None:
        for belt in self.drives.values():
            belt.step()

    def states(self) -> tuple[BeltState, ...]:
        return tuple(belt.state for belt in self.drives.values())

    def restore(self, saved: Sequence[BeltState]) -> None:
        """Restore the belts' states. Raises PicktreeError when they are of other belts."""
        check_belts(saved, self.drives)
        for state in saved:
            self.drives[state.id].state = state


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
        self._inventory.depart([true_body(self._bodies[name], self._inventory) for name in items], bin_id)
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
