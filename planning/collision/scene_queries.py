"""Scene queries without the arm: whether a spot is free, what the hand would touch, and the nearest body."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from ...robots.model import RobotModel
from ...world.belief.planning_scene import BeliefObject, PlanningScene
from ...world.shapes import Shape
from ...world.values import Array, Pose, Vector3
from ..requests import ContactPair
from .collision_bodies import CollisionBody, CollisionMargins, fixed_bodies, movable_bodies
from .fcl_shapes import FclDistance, FclPlacedSolid, bounds_apart, distance_between, place, solid


@dataclass(frozen=True, slots=True)
class Clearance:
    """Nearest body: its name, signed distance in m, nearest points on the queried shape and on the body."""

    name: str
    distance: float
    point: Vector3
    point_on_body: Vector3


class SceneQueries:
    """Distances in the believed scene, by python-fcl. Objects in the hand are not part of it.

    It follows the scene by itself. Contacts come nearest first; `a` names the queried body, `b` the scene's
    id.
    """

    def __init__(self, model: RobotModel, scene: PlanningScene) -> None:
        self._gripper = model.description.gripper
        self._model = model
        self._scene = scene
        self._margins = CollisionMargins()
        self._hand = [(solid(shape), pose) for shape, pose in self._gripper.hand]
        self._finger = solid(self._gripper.finger_boxes[0])
        self._still = [(body, place(solid(body.shape), body.pose)) for body in fixed_bodies(scene)]
        self._known: dict[CollisionBody, FclPlacedSolid] = {}
        self._objects: tuple[BeliefObject, ...] | None = None
        self._around: list[tuple[CollisionBody, FclPlacedSolid]] = []
        self._low: Array = np.empty((0, 3))
        self._high: Array = np.empty((0, 3))

    def hand_contacts(
        self, tcp_in_world: Pose, width: float, ignore: Collection[str] = (), margin: float = 0.003
    ) -> list[ContactPair]:
        """Return contacts of hand and fingers, opened by `width` m, that are closer than `margin` at that
        pose.

        Fingers may come to 0.5 mm of a level board, unless `margin` is wider than the usual 3 mm.
        """
        usual = margin <= self._margins.gripper
        finger_support = min(margin, self._margins.finger_support) if usual else margin
        parts = [("hand", place(s, tcp_in_world @ pose)) for s, pose in self._hand]
        for _, pose in self._model.finger_boxes(width):
            parts.append(("finger", place(self._finger, tcp_in_world @ pose)))
        found: list[ContactPair] = []
        for name, part in parts:
            for body, near in self._near(part, ignore, margin):
                least = finger_support if name == "finger" and body.support else margin
                if near.distance < least:
                    found.append(ContactPair(name, body.name, near.distance, near.point_b))
        return sorted(found, key=lambda contact: contact.distance)

    def free(
        self, shape: Shape, pose: Pose, ignore: Collection[str] = (), margin: float = 0.0
    ) -> list[ContactPair]:
        """Return contacts of a shape at a pose in the world that are closer than `margin`; empty: it is
        free."""
        placed = place(solid(shape), pose)
        found = [
            ContactPair("shape", body.name, near.distance, near.point_b)
            for body, near in self._near(placed, ignore, margin)
            if near.distance < margin
        ]
        return sorted(found, key=lambda contact: contact.distance)

    def clearance(self, shape: Shape, pose: Pose, ignore: Collection[str] = ()) -> Clearance | None:
        """Return the body nearest to a shape at a pose in the world; None when there is no body."""
        placed = place(solid(shape), pose)
        nearest: tuple[CollisionBody, FclDistance] | None = None
        self._follow()
        for body, other in self._around:
            if body.name in ignore:
                continue
            if nearest is not None and bounds_apart(placed, other, nearest[1].distance):
                continue
            near = distance_between(placed, other)
            if nearest is None or near.distance < nearest[1].distance:
                nearest = (body, near)
        if nearest is None:
            return None
        body, near = nearest
        return Clearance(body.name, near.distance, near.point_a, near.point_b)

    def _near(
        self, part: FclPlacedSolid, ignore: Collection[str], margin: float
    ) -> list[tuple[CollisionBody, FclDistance]]:
        """Return bodies whose bounding boxes come within `margin` of the part's, with the exact distance."""
        self._follow()
        reach = max(0.0, margin)
        touched = np.all(self._low <= part.high + reach, axis=1) & np.all(
            self._high >= part.low - reach, axis=1
        )
        bodies = [self._around[int(k)] for k in np.flatnonzero(touched)]
        return [(body, distance_between(part, other)) for body, other in bodies if body.name not in ignore]

    def _follow(self) -> None:
        """Take over the present belief of the scene; unchanged bodies are kept."""
        objects = self._scene.objects
        if self._objects == objects:
            return
        known: dict[CollisionBody, FclPlacedSolid] = {}
        for body in movable_bodies(objects):
            before = self._known.get(body)
            known[body] = before if before is not None else place(solid(body.shape), body.pose)
        self._objects, self._known = objects, known
        self._around = [*self._still, *known.items()]
        self._low = np.array([placed.low for _, placed in self._around]).reshape(-1, 3)
        self._high = np.array([placed.high for _, placed in self._around]).reshape(-1, 3)
