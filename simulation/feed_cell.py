"""Protocols between a backend and its feed: the simulated cell, and the sources of items.

The light curtain around a work place of people detects whether any part of the arm is over it.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import coal
import numpy as np
import pinocchio as pin

from picktree.robot.planning import robot_geometry
from picktree.world import Array, JournalEvent, ObjectId, Pose, RandomStreams
from picktree.world.robot_model import RobotModel
from picktree.world.scene import SceneDescription

from .spawn import SpawnedItem
from .truth import TrueBody


@dataclass(frozen=True, slots=True)
class Zone:
    """Zone of a light curtain: a rectangle seen from above, of any height."""

    centre: tuple[float, float]
    """x and y in the world, m."""
    yaw: float
    """Rotation about the vertical, rad."""
    half: tuple[float, float]
    """Half its lengths along its own x and y, m."""

    @classmethod
    def around(cls, pose: Pose, size: Sequence[float]) -> Zone:
        """Return the zone around a level rectangle of `size` at `pose` in the world that the arm must not
        enter."""
        x, y, _ = pose.position
        axis = pose.rotation()[:, 0]
        yaw = math.atan2(float(axis[1]), float(axis[0]))
        return cls((x, y), yaw, (size[0] / 2, size[1] / 2)).grown(MIN_ARM_DISTANCE)

    def grown(self, margin: float) -> Zone:
        """Return the zone enlarged by `margin` m on all sides."""
        return replace(self, half=(self.half[0] + margin, self.half[1] + margin))


class LightCurtain:
    """Light curtain over the hulls of the arm's collision meshes. The base, which never moves, is left
    out."""

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._data = model.full.createData()
        self._links: list[tuple[int, Array]] = []
        for each in robot_geometry(model):
            if each.parentJoint > 0:
                points, placement = _points(each.geometry), each.placement
                self._links.append((each.parentJoint, points @ placement.rotation.T + placement.translation))

    def crossed(self, zone: Zone, q: Array, width: float) -> bool:
        """Return whether a link is over the zone with the arm at q (n,), rad, and an opening of `width` m."""
        pin.forwardKinematics(self._model.full, self._data, self._model.full_q(q, width))
        cosine, sine = np.cos(zone.yaw), np.sin(zone.yaw)
        axes = np.array([[cosine, sine], [-sine, cosine]])
        for joint, points in self._links:
            placement = self._data.oMi[joint]
            above = (points @ placement.rotation.T + placement.translation)[:, :2] - zone.centre
            seen = above @ axes.T
            if np.all(seen.min(axis=0) <= zone.half) and np.all(seen.max(axis=0) >= np.negative(zone.half)):
                return True
        return False


def _points(geometry: coal.CollisionGeometry) -> Array:
    """Return points (n, 3) whose hull encloses the geometry, in its own frame, m."""
    if isinstance(geometry, coal.ConvexBase):
        return geometry.points().copy()
    box = geometry.aabb_local
    return np.array(list(itertools.product(*zip(box.min_.tolist(), box.max_.tolist(), strict=True))))


CELL_CHECK_INTERVAL = 12
"""Number of control periods between two checks of the cell by the feed."""
MIN_ARM_DISTANCE = 0.05
"""Least distance of the arm from new items, from a running belt, and from a bin during its exchange, m."""
DROP_HEIGHT = 5e-4
"""Height above the support from which new items drop, m."""
MAX_SETTLING_TIME = 3.0
"""Longest wait for the items of a delivery to come to rest, s."""


class FeedCell(Protocol):
    """Simulated cell as seen by item sources and bin exchange."""

    @property
    def now(self) -> float:
        """Simulated time, s."""
        ...

    @property
    def period(self) -> float:
        """Length of a control period, s."""
        ...

    def here(self) -> tuple[TrueBody, ...]:
        """Return every present item with its true pose."""
        ...

    def next_id(self) -> ObjectId:
        """Return the name of the next item that is added."""
        ...

    def put(self, item: SpawnedItem) -> None:
        """Add an item at its pose and leave it to the simulation."""
        ...

    def at_rest(self, items: Collection[ObjectId]) -> bool:
        """Return whether those of the items that are still present are at rest."""
        ...

    def take_with(self, bin_id: ObjectId, items: Collection[ObjectId]) -> None:
        """Remove items with their bin; their last truth is kept."""
        ...

    def arm_over(self, zone: Zone) -> bool:
        """Return whether any part of the arm is over the zone."""
        ...


class SourceState(Protocol):
    """Progress of an item source."""

    @property
    def deliveries(self) -> int: ...


S = TypeVar("S", bound=SourceState)


class ItemSource(ABC, Generic[S]):
    """Source of items: one entry of a scene's feed."""

    def __init__(self, scene: SceneDescription, number: int, cell: FeedCell, seed: int, state: S) -> None:
        self._scene = scene
        self._number = number
        self._delivery = scene.deliveries[number]
        self._cell = cell
        self._streams = RandomStreams(seed)
        self._state = state
        self._events: list[JournalEvent] = []

    @property
    @abstractmethod
    def exhausted(self) -> bool:
        """Whether nothing more comes from the source and its last items are at rest."""

    @property
    @abstractmethod
    def busy(self) -> bool:
        """Whether the source brings something, or would if the arm were out of the way."""

    @property
    def obstructed(self) -> bool:
        """Whether the source waits for the arm to leave."""
        return False

    @property
    def deliveries(self) -> int:
        """Number of completed deliveries: items came and are at rest."""
        return self._state.deliveries

    @abstractmethod
    def ready(self) -> None:
        """Note that the robot is ready for the next delivery."""

    @abstractmethod
    def stepped(self, step: int) -> None:
        """Advance by one control period, the step-th of the run."""

    def take_events(self) -> tuple[JournalEvent, ...]:
        """Return the events since the last call."""
        events, self._events = tuple(self._events), []
        return events

    def state(self) -> S:
        """Return the progress for a checkpoint; a belt's own state is the backend's."""
        return self._state

    def restore(self, state: S) -> None:
        self._state = state
