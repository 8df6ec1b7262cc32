"""Camera registration: the pose of a camera, corrected by fingers and table in its picture.

Height and tilt show on the table (`level_camera`). For a camera on the hand, a shift along the table and a
turn about the vertical show on the sides of the fingers, whose poses follow from the encoders. Nothing is
remembered between pictures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from picktree.world import Array, cross

from .backdrop import BackgroundModel
from .camera_geometry import PosedCamera, rays_of

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


MIN_LEVEL_PIXELS = 400
"""Least number of table pixels for a correction of the camera."""
LEVEL_STRIDE, LEVEL_WIDTH = 5, 320
"""Step between the rows and columns that are used, and width of the picture for which it holds. Smaller
pictures use more of them."""
MAX_LEVEL_SHIFT, MAX_LEVEL_TILT = 0.03, 0.052
"""Greatest correction of height and tilt, m and rad. A larger one is no error of the mounting and is not
applied."""


def level_camera(
    sight: PosedCamera,
    depth: Array,
    backdrop: BackgroundModel,
    table_z: float,
    clutter: NDArray[np.bool_] | None = None,
) -> PosedCamera:
    """Move and tilt the camera so that the measured table agrees with the scene file.

    `clutter` (h, w) marks pixels that are known to show something else. Only height and tilt show on a plane;
    they shift every height above the table. Without enough table, or beyond the limits, the camera is
    returned unchanged.
    """
    every = max(1, min(LEVEL_STRIDE, depth.shape[1] // (LEVEL_WIDTH // LEVEL_STRIDE)))
    grid = slice(None, None, every), slice(None, None, every)
    picked = backdrop.table[grid] & (depth[grid] > 0)
    if clutter is not None:
        picked &= ~clutter[grid]
    points = rays_of(sight.intrinsics)[grid][picked] @ sight.rotation.T
    points *= depth[grid][picked][:, None]
    off = points[:, 2] + sight.origin[2] - table_z
    design = np.column_stack([points[:, :2], np.ones(len(points))])
    near = np.abs(off) < 2 * MAX_LEVEL_SHIFT
    plane = np.zeros(3)
    for _ in range(3):
        if int(near.sum()) < MIN_LEVEL_PIXELS:
            return sight
        a = design[near]
        plane = np.asarray(np.linalg.solve(a.T @ a, a.T @ off[near]), dtype=np.float64)
        left = off - design @ plane
        near = np.abs(left) < 2.5 * max(1e-3, 1.5 * float(np.median(np.abs(left))))
    tilt = float(np.hypot(plane[0], plane[1]))
    if tilt > MAX_LEVEL_TILT or abs(float(plane[2])) > MAX_LEVEL_SHIFT:
        return sight
    normal = np.array([-plane[0], -plane[1], 1.0]) / np.sqrt(1.0 + tilt**2)
    rotation = _turning(normal, np.array([0.0, 0.0, 1.0])) @ sight.rotation
    above = (sight.origin[2] - table_z - float(plane[2])) * normal[2]
    origin = np.array([sight.origin[0], sight.origin[1], table_z + above])
    return PosedCamera.along(sight.intrinsics, origin, rotation)


def _turning(a: Array, b: Array) -> Array:
    """Compute the smallest rotation (3, 3) that takes the unit vector a to b (not opposite)."""
    axis = cross(a, b)
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + skew + skew @ skew / (1.0 + float(a @ b))
