"""Light curtain around a work place of people: detects whether any part of the arm is over it."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import coal
import numpy as np
import pinocchio as pin

from ...planning.collision.collision_checker import robot_geometry
from ...robots.model import RobotModel
from ...world.values import Array


@dataclass(frozen=True, slots=True)
class Zone:
    """Zone of a light curtain: a rectangle seen from above, of any height."""

    centre: tuple[float, float]
    """x and y in the world, m."""
    yaw: float
    """Rotation about the vertical, rad."""
    half: tuple[float, float]
    """Half its lengths along its own x and y, m."""

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
