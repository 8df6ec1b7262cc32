"""Poses and outlines in the plane: bodies on a table, seen from above."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .shapes import Cylinder, Shape, Sphere, corners
from .values import Array, Pose, quaternion_product

MIN_UPRIGHT_COSINE = 0.7
"""Cosine of the greatest tilt of an upright cylinder."""
MAX_LEVEL_SINE = 0.5
"""Sine of the angle up to which an axis of a body counts as level."""
SAME_CORNER_DISTANCE = 5e-4
"""Corners of an outline that come to lie so near to each other when it is turned are the same, m."""
SYMMETRY_FOLDS = (12, 8, 6, 5, 4, 3, 2)
"""Rotational symmetries of outlines that are recognised, the highest first."""


@dataclass(frozen=True, slots=True)
class PlanarPose:
    """A pose in the plane, or a frame given in another: m, and the turn of its x axis, rad."""

    x: float
    y: float
    yaw: float = 0.0

    def __matmul__(self, other: PlanarPose) -> PlanarPose:
        """Composition: `a_in_c = b_in_c @ a_in_b`."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return PlanarPose(
            self.x + c * other.x - s * other.y, self.y + s * other.x + c * other.y, self.yaw + other.yaw
        )

    def inverse(self) -> PlanarPose:
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return PlanarPose(-c * self.x - s * self.y, s * self.x - c * self.y, -self.yaw)

    def apply(self, points: Array) -> Array:
        """Points (n, 2) of this frame, given in the parent frame."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return points @ np.array([[c, s], [-s, c]]) + (self.x, self.y)

    @property
    def direction(self) -> Array:
        """Unit vector (2,) of its x axis."""
        return np.array([math.cos(self.yaw), math.sin(self.yaw)])

    def distance(self, other: PlanarPose) -> float:
        """Distance of the two origins, m."""
        return math.hypot(other.x - self.x, other.y - self.y)


@dataclass(frozen=True, slots=True, eq=False)
class PlanarOutline:
    """A convex body from above: corners (n, 2), counter-clockwise, grown by `radius`; a round body has one
    corner, the origin."""

    corners: Array
    radius: float = 0.0

    @property
    def round(self) -> bool:
        return len(self.corners) == 1

    @property
    def reach(self) -> float:
        """Greatest distance of its border from the origin, m."""
        return float(np.hypot(*self.corners.T).max()) + self.radius

    @property
    def turn(self) -> float:
        """Angle of rotational symmetry, rad; 0 for a body without a heading."""
        if self.round:
            return 0.0
        for fold in SYMMETRY_FOLDS:
            turned = PlanarPose(0.0, 0.0, 2 * math.pi / fold).apply(self.corners)
            apart = np.hypot(*(turned[:, None, :] - self.corners[None, :, :]).transpose(2, 0, 1))
            if float(apart.min(axis=1).max()) < SAME_CORNER_DISTANCE:
                return 2 * math.pi / fold
        return 2 * math.pi

    def inertia(self) -> float:
        """Mean square of the distance of its points from the origin, m². It weights frictional resistance
        against rotation relative to translation."""
        if self.round:
            return self.radius**2 / 2
        a, b = self.corners, np.roll(self.corners, -1, axis=0)
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        square = (a * a).sum(axis=1) + (a * b).sum(axis=1) + (b * b).sum(axis=1)
        return float((cross * square).sum() / (6.0 * cross.sum()))


def heading(shape: Shape, pose: Pose) -> float:
    """Return the rotation of a body at `pose` about the vertical, rad. It is that of a lying cylinder's
    axis, else of the first level axis; 0 for bodies that are round from above."""
    rotation = pose.rotation()
    match shape:
        case Sphere():
            return 0.0
        case Cylinder():
            if abs(float(rotation[2, 2])) > MIN_UPRIGHT_COSINE:
                return 0.0
            axis = rotation[:, 2]
        case _:
            level = next((k for k in range(3) if abs(float(rotation[2, k])) < MAX_LEVEL_SINE), 0)
            axis = rotation[:, level]
    return math.atan2(float(axis[1]), float(axis[0]))


def planar(shape: Shape, pose: Pose) -> PlanarPose:
    """Return the pose of a body on its table."""
    return PlanarPose(pose.position[0], pose.position[1], heading(shape, pose))


def moved(shape: Shape, pose: Pose, to: PlanarPose) -> Pose:
    """Return the body pushed to another place on the same table."""
    half = (to.yaw - heading(shape, pose)) / 2
    turned = quaternion_product((0.0, 0.0, math.sin(half), math.cos(half)), pose.orientation)
    return Pose((to.x, to.y, pose.position[2]), turned)


def outline(shape: Shape, pose: Pose) -> PlanarOutline:
    """Return the outline of a body at `pose`, in its own planar frame."""
    rotation = pose.rotation()
    match shape:
        case Sphere(radius):
            return PlanarOutline(np.zeros((1, 2)), radius)
        case Cylinder(radius, height):
            if abs(float(rotation[2, 2])) > MIN_UPRIGHT_COSINE:
                return PlanarOutline(np.zeros((1, 2)), radius)
            a, b = height / 2, radius
            return PlanarOutline(np.array([[a, -b], [a, b], [-a, b], [-a, -b]]))
        case _:
            import cv2  # slow to load, and checks of missions need no outline

            points = (corners(shape) @ rotation.T)[:, :2]
            level = PlanarPose(0.0, 0.0, -heading(shape, pose)).apply(points)
            hull = cv2.convexHull(level.astype(np.float32))[:, 0].astype(np.float64)
            cross = hull[:, 0] * np.roll(hull[:, 1], -1) - hull[:, 1] * np.roll(hull[:, 0], -1)
            return PlanarOutline(hull if float(cross.sum()) > 0 else hull[::-1])


def wrap_angle(angle: float, turn: float = 2 * math.pi) -> float:
    """Return the equivalent angle nearest to 0, rad; angles are equivalent up to whole multiples of
    `turn`."""
    return angle - turn * round(angle / turn) if turn else 0.0


def outline_distance(one: PlanarOutline, at: PlanarPose, other: PlanarOutline, there: PlanarPose) -> float:
    """Return the free distance of two outlines, m; negative: the least translation that separates them."""
    a, b = at.apply(one.corners), there.apply(other.corners)
    radii = one.radius + other.radius
    apart = max(_beyond(a, b), _beyond(b, a))
    if apart <= 0.0 and max(len(a), len(b)) > 1:
        return apart - radii
    return min(_nearest(a, b), _nearest(b, a)) - radii


def _beyond(polygon: Array, points: Array) -> float:
    """Return the greatest distance by which the line of an edge separates all points; negative when none
    does."""
    if len(polygon) < 2:
        return -math.inf
    edge = np.roll(polygon, -1, axis=0) - polygon
    out = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.hypot(edge[:, 0], edge[:, 1])[:, None]
    off = ((points[None, :, :] - polygon[:, None, :]) * out[:, None, :]).sum(axis=2)
    return float(off.min(axis=1).max())


def _nearest(points: Array, polygon: Array) -> float:
    """Return the least distance of points to the border of a polygon."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    square = np.maximum((edge * edge).sum(axis=1), 1e-18)
    away = points[:, None, :] - polygon[None, :, :]
    share = np.clip((away * edge[None]).sum(axis=2) / square, 0.0, 1.0)
    rest = away - share[:, :, None] * edge[None]
    return float(np.sqrt((rest * rest).sum(axis=2)).min())
