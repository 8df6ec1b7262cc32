"""Camera geometry: pixels, rays and heights of one picture, through the believed camera pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from picktree.world import Array, Intrinsics, Pose

NOISE_STRIDE = 2
"""Step between the rows, and between the columns, in which the noise of the depth is measured."""
MIN_CAMERA_DEPTH = 0.02
"""Distance from the camera's plane below which a point is not before the camera, m."""


def depth_noise(depth: NDArray[np.float32]) -> tuple[float, float]:
    """Return the standard deviation of the depth between neighbouring pixels, and the median depth, m."""
    every = slice(1, -1, NOISE_STRIDE)
    inner = depth[every, every]
    before, after = slice(None, -2, NOISE_STRIDE), slice(2, None, NOISE_STRIDE)
    around = (depth[before, every], depth[after, every], depth[every, before], depth[every, after])
    known = (inner > 0) & np.logical_and.reduce([side > 0 for side in around])
    if not bool(known.any()):
        return 0.0, 0.7
    bent = (inner - sum(around) / 4)[known]
    return 1.4826 * float(np.median(np.abs(bent))) / math.sqrt(1.25), float(np.median(inner[known]))


MAX_NOISE_RATIO, MAX_EXTRA_NOISE = 2.5, 1e-3
"""Depth that scatters this many times as much as the camera's own noise, and so many m more, is too noisy."""


def noise_factor(depth: NDArray[np.float32], own: float) -> float:
    """Return how many times as much as the camera's `own` noise, m at 0.7 m, a too noisy image scatters.

    0: it is not too noisy.
    """
    scatter, distance = depth_noise(depth)
    usual = max(own * (distance / 0.7) ** 2, 5e-4)
    return scatter / usual if scatter > MAX_NOISE_RATIO * usual + MAX_EXTRA_NOISE else 0.0


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
        """Return the height in the world (h, w) of the surfaces at `depth` (h, w), m."""
        rays, (right, down, ahead) = rays_of(self.intrinsics), self.rotation[2].tolist()
        found: Array = rays[0, :, 0] * right + (rays[:, :1, 1] * down + ahead)
        found *= depth
        found += self.origin[2]
        return found

    def at_height(self, pixel: Array, height: float) -> Array:
        """Return world x, y (2,) where the ray of a pixel (2,) crosses the horizontal plane at `height`."""
        ray = self.directions(pixel[None])[0]
        return (self.origin + ray * ((height - self.origin[2]) / ray[2]))[:2]
