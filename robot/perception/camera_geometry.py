"""Camera geometry: pixels, rays and heights of one picture, through the believed camera pose.

A camera on the hand is registered by the fingers in its own picture. Height and tilt show on the table
(`backdrop.level_camera`). A shift along the table and a turn about the vertical show on the sides of the
fingers, whose poses follow from the encoders. Nothing is remembered between pictures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...world.protocols import Intrinsics
from ...world.values import Array, Pose

MIN_CAMERA_DEPTH = 0.02
"""Distance from the camera's plane below which a point is not before the camera, m."""


def depth_noise(depth: NDArray[np.float32]) -> tuple[float, float]:
    """Return the standard deviation of the depth between neighbouring pixels, and the median depth, m."""
    inner = depth[1:-1, 1:-1]
    around = (depth[:-2, 1:-1], depth[2:, 1:-1], depth[1:-1, :-2], depth[1:-1, 2:])
    known = (inner > 0) & np.logical_and.reduce([side > 0 for side in around])
    if not bool(known.any()):
        return 0.0, 0.7
    bent = (inner - sum(around) / 4)[known]
    return 1.4826 * float(np.median(np.abs(bent))) / math.sqrt(1.25), float(np.median(inner[known]))


NOISY, NOISY_DEPTH = 2.5, 1e-3
"""Depth that scatters this many times as much as the camera's own noise, and so many m more, is too noisy."""


def noise_factor(depth: NDArray[np.float32], own: float) -> float:
    """Return how many times as much as the camera's `own` noise, m at 0.7 m, a too noisy image scatters.

    0: it is not too noisy.
    """
    scatter, distance = depth_noise(depth)
    usual = max(own * (distance / 0.7) ** 2, 5e-4)
    return scatter / usual if scatter > NOISY * usual + NOISY_DEPTH else 0.0


@lru_cache(maxsize=16)
def rays_of(intrinsics: Intrinsics) -> Array:
    """Return directions (h, w, 3) in the camera's frame with z = 1: depth times direction is the point."""
    u = (np.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx
    v = (np.arange(intrinsics.height) - intrinsics.cy) / intrinsics.fy
    rays = np.ones((intrinsics.height, intrinsics.width, 3))
    rays[:, :, 0] = u[None, :]
    rays[:, :, 1] = v[:, None]
    rays.flags.writeable = False
    return rays


@dataclass(frozen=True, eq=False)
class PosedCamera:
    """Pinhole camera at a pose: world to pixels and back."""

    intrinsics: Intrinsics
    origin: Array
    """Optical centre in the world (3,), m."""
    rotation: Array
    """Camera axes in the world, as columns (3, 3)."""
    projection: Array
    """Projection matrix (3, 3): homogeneous pixel = projection @ (point - origin)."""

    @classmethod
    def at(cls, intrinsics: Intrinsics, camera_in_world: Pose) -> PosedCamera:
        return cls.along(intrinsics, np.array(camera_in_world.position), camera_in_world.rotation())

    @classmethod
    def along(cls, intrinsics: Intrinsics, origin: Array, rotation: Array) -> PosedCamera:
        i = intrinsics
        matrix = np.array([[i.fx, 0.0, i.cx], [0.0, i.fy, i.cy], [0.0, 0.0, 1.0]])
        return cls(intrinsics, origin, rotation, matrix @ rotation.T)

    def apart(self, other: PosedCamera, distance: float) -> float:
        """Bound the distance between the points at which two cameras place one pixel's surface at that
        distance, m."""
        turn = float(np.linalg.norm(self.rotation - other.rotation, 2))
        return float(np.linalg.norm(self.origin - other.origin)) + turn * distance

    def before(self, points: Array) -> Array:
        """Clip the hull of `points` (n, 3) at the camera's plane. Returns points (m, 3) of the part before
        the camera; none without one."""
        depth = (points - self.origin) @ self.rotation[:, 2] - MIN_CAMERA_DEPTH
        behind = depth < 0.0
        if not behind.any():
            return points
        # Points where the edges between the two sides cross the plane. Segments that are no edges cross it
        # further inside.
        a, b = points[~behind], points[behind]
        share = depth[~behind][:, None] / (depth[~behind][:, None] - depth[behind][None])
        crossing = a[:, None] + share[:, :, None] * (b[None] - a[:, None])
        return np.concatenate([a, crossing.reshape(-1, 3)])

    def pixels(self, points: Array) -> Array:
        """Project world points (n, 3) to pixel coordinates (n, 2); points behind the camera are held at 2
        cm."""
        h = (points - self.origin) @ self.projection.T
        return h[:, :2] / np.maximum(h[:, 2:], 0.02)

    def directions(self, pixels: Array) -> Array:
        """Return rays in the world (n, 3) through pixels (n, 2), scaled so that depth times ray is the
        point."""
        i = self.intrinsics
        rays = np.ones((len(pixels), 3))
        rays[:, 0] = (pixels[:, 0] - i.cx) / i.fx
        rays[:, 1] = (pixels[:, 1] - i.cy) / i.fy
        return rays @ self.rotation.T

    def all_directions(self) -> Array:
        """Return the rays of all pixels in the world (h, w, 3)."""
        return rays_of(self.intrinsics) @ self.rotation.T

    def heights(self, depth: Array) -> Array:
        """Return the height in the world (h, w) of what is seen at `depth` (h, w), m."""
        rays, (right, down, ahead) = rays_of(self.intrinsics), self.rotation[2].tolist()
        found: Array = rays[0, :, 0] * right + (rays[:, :1, 1] * down + ahead)
        found *= depth
        found += self.origin[2]
        return found

    def at_height(self, pixel: Array, height: float) -> Array:
        """Return world x, y (2,) where the ray of a pixel (2,) crosses the horizontal plane at `height`."""
        ray = self.directions(pixel[None])[0]
        return (self.origin + ray * ((height - self.origin[2]) / ray[2]))[:2]


FINGER_DISTANCE = 0.016
"""Distance from a finger's believed surface within which a point may belong to it, m."""
MIN_FINGER_POINTS = 60
"""Least number of points of each finger."""
MAX_ICP_ROUNDS = 25
RESIDUAL_NOISE = 4e-4
"""Residual that is put down to noise, m."""
MAX_MEDIAN_RESIDUAL = 8e-4
"""Median residual above which the fit is rejected, m."""
MAX_CAMERA_SHIFT, MAX_CAMERA_TURN = 0.02, math.radians(5)
"""Greatest correction, m and rad. A larger one is no error of a mounting."""
PIXEL_STRIDE, MAX_FINGER_POINTS = 2, 600
"""Step between the rows and columns that are used; greatest number of points of a finger."""


@dataclass(frozen=True, slots=True, eq=False)
class ConvexFacets:
    """Convex body in the world: inside is `normals @ p <= offsets`; (k, 3) and (k,) m."""

    normals: Array
    offsets: Array
    middle: Array
    """Centre of the bounding sphere in the world (3,), m."""
    radius: float
    """Radius of the sphere about the middle that contains the body, m."""

    def outside(self, points: Array) -> tuple[Array, Array]:
        """Compute signed distances (n,) of points (n, 3), m, and the normals (n, 3) of their faces.

        The face of a point is the one that it is furthest beyond. Distances are negative inside.
        """
        beyond = points @ self.normals.T - self.offsets
        face = beyond.argmax(axis=1)
        return beyond[np.arange(len(points)), face], self.normals[face]


def register_hand_camera(sight: PosedCamera, depth: Array, fingers: Sequence[ConvexFacets]) -> PosedCamera:
    """Move the camera along the level and turn it about the vertical until the measured fingers match their
    believed poses.

    The camera is returned unchanged when a finger is hardly in view or the fit is poor or too large. The fit
    is iterated closest points, point to plane (Chen & Medioni 1992), with Tukey's weights.
    """
    clouds = [_cloud(sight, depth, finger) for finger in fingers]
    if len(clouds) < 2 or min(len(cloud) for cloud in clouds) < MIN_FINGER_POINTS:
        return sight
    middle = np.concatenate(clouds).mean(axis=0)
    move = np.zeros(3)  # x, y, yaw
    residuals = np.zeros(0)
    for _ in range(MAX_ICP_ROUNDS):
        parts = [_linear(cloud, finger, middle, move) for cloud, finger in zip(clouds, fingers, strict=True)]
        residuals = np.concatenate([r for r, _ in parts])
        design = np.concatenate([d for _, d in parts])
        scale = 4.7 * max(RESIDUAL_NOISE, 1.5 * float(np.median(np.abs(residuals))))
        weight = np.clip(1.0 - (residuals / scale) ** 2, 0.0, None) ** 2
        normal = design.T @ (design * weight[:, None]) + np.diag([1e-3, 1e-3, 1e-6])
        step = np.asarray(np.linalg.solve(normal, -design.T @ (weight * residuals)), dtype=np.float64)
        move = move + np.clip(step, -0.01, 0.01)
        if float(np.abs(step).max()) < 1e-6:
            break
    x, y, yaw = (float(c) for c in move)
    doubtful = float(np.median(np.abs(residuals))) > MAX_MEDIAN_RESIDUAL
    if doubtful or math.hypot(x, y) > MAX_CAMERA_SHIFT or abs(yaw) > MAX_CAMERA_TURN:
        return sight
    turn = _about_vertical(yaw)
    origin = turn @ (sight.origin - middle) + middle + np.array([x, y, 0.0])
    return PosedCamera.along(sight.intrinsics, origin, turn @ sight.rotation)


def _cloud(sight: PosedCamera, depth: Array, finger: ConvexFacets) -> Array:
    """Select the measured points (n, 3) that may belong to the finger."""
    picked = np.zeros(depth.shape, dtype=np.bool_)
    picked[::PIXEL_STRIDE, ::PIXEL_STRIDE] = True
    away = float((finger.middle - sight.origin) @ sight.rotation[:, 2])
    reach = finger.radius + FINGER_DISTANCE
    rows, columns = np.nonzero(picked & (depth > max(0.0, away - reach)) & (depth < away + reach))
    pixels = np.stack([columns, rows], axis=1).astype(np.float64)
    points = sight.origin + sight.directions(pixels) * depth[rows, columns][:, None]
    points = points[np.linalg.norm(points - finger.middle, axis=1) < reach]
    off, _ = finger.outside(points)
    points = points[np.abs(off) < FINGER_DISTANCE]
    return points[:: max(1, len(points) // MAX_FINGER_POINTS)]


def _linear(cloud: Array, finger: ConvexFacets, middle: Array, move: Array) -> tuple[Array, Array]:
    """Compute residuals (n,) after a move, and their derivatives (n, 3) by x, y and yaw."""
    arm = (cloud - middle) @ _about_vertical(float(move[2])).T
    off, normals = finger.outside(arm + middle + np.array([move[0], move[1], 0.0]))
    by_yaw = normals[:, 1] * arm[:, 0] - normals[:, 0] * arm[:, 1]
    return off, np.column_stack([normals[:, 0], normals[:, 1], by_yaw])


def _about_vertical(yaw: float) -> Array:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
