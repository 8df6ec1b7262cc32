"""Obstacles that are unknown to the robot, by name in order of arrival, and the check whether a place is
free."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import chain

import coal
import numpy as np
import pinocchio as pin

from picktree.robot.planning import CoalShapes, robot_geometry
from picktree.world import Array, ObjectId, Pose, Shape
from picktree.world.robot_model import RobotModel
from picktree.world.scene import Fixture

from .truth import TrueObstacle

MIN_OBSTACLE_CLEARANCE = 0.01
"""Least distance of an added obstacle to items and robot, m."""


class HiddenObstacles:
    """Hidden obstacles of one run. The backend's `put` makes the body of one, its `take` removes it."""

    def __init__(self, put: Callable[[Fixture], None], take: Callable[[ObjectId], None]) -> None:
        self._put, self._take = put, take
        self._here: dict[ObjectId, Fixture] = {}

    @property
    def here(self) -> tuple[Fixture, ...]:
        return tuple(self._here.values())

    def truth(self) -> tuple[TrueObstacle, ...]:
        return tuple(TrueObstacle.of(body) for body in self.here)

    def put(self, body: Fixture) -> ObjectId:
        """Add an obstacle under its name or, where that is taken, a numbered one; return the name."""
        name, number = body.id, 1
        while name in self._here:
            number += 1
            name = ObjectId(f"{body.id}_{number}")
        self._here[name] = replace(body, id=name)
        self._put(self._here[name])
        return name

    def take(self, name: ObjectId) -> None:
        """Remove an obstacle."""
        del self._here[name]
        self._take(name)

    def renew(self, bodies: Iterable[Fixture]) -> None:
        """Add these obstacles to a simulation that has none yet."""
        self._here = {}
        for body in bodies:
            self.put(body)


class FreeSpaceCheck:
    """Check whether a place is free of items and robot. Fixtures are ignored."""

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._shapes = CoalShapes()
        self._data = model.full.createData()
        self._links = robot_geometry(model)

    def free(
        self,
        shape: Shape,
        pose: Pose,
        items: Iterable[tuple[Shape, Pose]],
        q: Array,
        width: float,
        room: float = MIN_OBSTACLE_CLEARANCE,
    ) -> bool:
        """Return whether a body fits at `pose` between items and robot, with clearance `room`, m. The arm is
        at `q` (n,), rad, the fingers are `width` m open."""
        one, at = self._shapes.of(shape), _transform(pose)
        # Waiting obstacles test for room in each tick: nothing is computed after the first body in the way.
        lying = ((self._shapes.of(other), _transform(other_pose)) for other, other_pose in items)
        others = chain(lying, self._robot(q, width))
        request = coal.CollisionRequest()
        request.security_margin = room
        return not any(
            coal.collide(one, at, other, there, request, coal.CollisionResult()) for other, there in others
        )

    def _robot(self, q: Array, width: float) -> Iterator[tuple[coal.CollisionGeometry, coal.Transform3s]]:
        pin.forwardKinematics(self._model.full, self._data, self._model.full_q(q, width))
        for each in self._links:
            there = self._data.oMi[each.parentJoint] * each.placement
            yield each.geometry, coal.Transform3s(there.rotation, there.translation)


def _transform(pose: Pose) -> coal.Transform3s:
    return coal.Transform3s(pose.rotation(), np.array(pose.position))
