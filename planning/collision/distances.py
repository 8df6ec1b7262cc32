"""Distances between bodies at a configuration, by coal: bounding boxes say which to measure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ...world.values import Array
from ..requests import Contact
from .coal_shapes import measuring


@dataclass(frozen=True, slots=True, eq=False)
class Near:
    """Two bodies by their numbers, their signed distance, m, and its gradient over the joints, m/rad."""

    first: int
    second: int
    distance: float
    gradient: Array


class Gaps:
    """Distances between the pairs of one geometry model; bodies that are moved in it are followed."""

    def __init__(
        self, model: pin.Model, geometry: pin.GeometryModel, names: Sequence[str], around: int
    ) -> None:
        """`around`: the number of the first body that is not of the robot nor in its hand."""
        self._model = model
        self._geometry = geometry
        self._names = names
        self._data = model.createData()
        self._geometry_data = measuring(geometry)
        boxes = [o.geometry.aabb_local for o in geometry.geometryObjects]
        low, high = np.array([b.min_ for b in boxes]), np.array([b.max_ for b in boxes])
        self._middles: Array = (low + high) / 2
        self._halves: Array = (high - low) / 2
        self._first = np.array([pair.first for pair in geometry.collisionPairs], dtype=np.int64)
        self._second = np.array([pair.second for pair in geometry.collisionPairs], dtype=np.int64)
        self._itself = self._second < around

    def nearest(self, full_q: Array, within: float = np.inf, *, itself: bool = False) -> Contact | None:
        """The nearest pair, if one is nearer than `within` m: of the robot (with what it holds) and what is
        around, or with `itself` of two of its own. Names, signed distance and the point on `b`."""
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, full_q)
        apart = np.where(self._itself == itself, self._apart(), np.inf)
        best: Contact | None = None
        for index in np.argsort(apart, kind="stable"):
            if apart[index] >= within:
                break
            found = pin.computeDistance(self._geometry, self._geometry_data, int(index))
            if found.min_distance < within:
                within = float(found.min_distance)
                x, y, z = (float(c) for c in found.getNearestPoint2())
                a, b = int(self._first[index]), int(self._second[index])
                best = Contact(self._names[a], self._names[b], within, (x, y, z))
        return best

    def near(self, full_q: Array, within: float) -> list[Near]:
        """Every pair nearer than `within` m, with how its distance changes with the joints."""
        model, data = self._model, self._data
        pin.computeJointJacobians(model, data, full_q)
        pin.updateGeometryPlacements(model, data, self._geometry, self._geometry_data, full_q)
        objects = self._geometry.geometryObjects
        found: list[Near] = []
        for index in np.flatnonzero(self._apart() < within):
            pair = self._geometry.collisionPairs[int(index)]
            measured = pin.computeDistance(self._geometry, self._geometry_data, int(index))
            distance = float(measured.min_distance)
            if distance >= within:
                continue
            # coal's normal points from the first body to the second.
            normal, gradient = np.asarray(measured.normal), np.zeros(model.nv)
            points = measured.getNearestPoint1(), measured.getNearestPoint2()
            for body, point, sign in zip((pair.first, pair.second), points, (-1.0, 1.0), strict=True):
                joint = objects[body].parentJoint
                if joint:
                    six = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
                    lever = np.asarray(point) - data.oMi[joint].translation
                    gradient += sign * (normal @ six[:3] + np.cross(lever, normal) @ six[3:])
            found.append(Near(pair.first, pair.second, distance, gradient))
        return found

    def _apart(self) -> Array:
        """Distances of the bounding boxes of all pairs: what the bodies are apart at least, m."""
        placements = self._geometry_data.oMg
        turned = np.array([placement.rotation for placement in placements])
        at = np.array([placement.translation for placement in placements])
        middles = at + np.einsum("kij,kj->ki", turned, self._middles)
        halves = np.einsum("kij,kj->ki", np.abs(turned), self._halves)
        between = np.abs(middles[self._first] - middles[self._second])
        gaps = between - halves[self._first] - halves[self._second]
        return np.linalg.norm(np.maximum(gaps, 0.0), axis=1)
