"""Pose of a camera on the hand, registered by the fingers in its own picture.

Height and tilt show on the table (`backdrop.level_camera`). A shift along the table and a turn about the
vertical remain. They show on the sides of the fingers, whose poses follow from the encoders. An error of the
mounting is thus seen in each picture by itself; nothing is remembered between pictures.

The fit is iterated closest points, point to plane (Chen & Medioni 1992), with Tukey's weights.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...world.values import Array
from ..geometry.camera_geometry import PosedCamera

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

    The camera is returned unchanged when a finger is hardly in view or the fit is poor or too large.
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
