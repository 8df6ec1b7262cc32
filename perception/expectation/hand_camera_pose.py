"""Where a camera on the hand really is, by the fingers in its own picture.

Height and tilt show on the table (`backdrop.levelled`); what is left, a shift along the table and a turn
about the vertical, shows on the sides of the fingers, which stand where the encoders say. So an error of the
mounting is seen in each picture by itself, and nothing has to be remembered from one to the next.

The fit is iterated closest points, point to plane (Chen & Medioni 1992), with Tukey's weights.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...world.values import Array
from ..geometry.camera_geometry import PosedCamera

NEAR = 0.016
"""Points within this distance of a finger's believed surface may be of it, m."""
LEAST = 60
"""Fewer points of a finger than this say nothing."""
ROUNDS = 25
FINE = 4e-4
"""Residuals of this size are noise, m."""
GOOD = 8e-4
"""With a median residual above this the fit is not believed, m."""
MOST, MOST_TURN = 0.02, math.radians(5)
"""A correction beyond this is no error of a mounting, m and rad."""
EVERY, SPOTS = 2, 600
"""Of every so many rows and columns one is looked at, and so many points of a finger are used at most."""


@dataclass(frozen=True, slots=True, eq=False)
class ConvexFacets:
    """A convex body in the world: inside is `normals @ p <= offsets`; (k, 3) and (k,) m."""

    normals: Array
    offsets: Array
    middle: Array
    """(3,)"""
    radius: float
    """Of a sphere about the middle that contains it, m."""

    def outside(self, points: Array) -> tuple[Array, Array]:
        """How far points (n, 3) are beyond the face that they are furthest beyond (n,), m, negative inside,
        and that face's normal (n, 3)."""
        beyond = points @ self.normals.T - self.offsets
        face = beyond.argmax(axis=1)
        return beyond[np.arange(len(points)), face], self.normals[face]


def register_hand_camera(sight: PosedCamera, depth: Array, fingers: Sequence[ConvexFacets]) -> PosedCamera:
    """The camera moved along the level and turned about the vertical so that the fingers, as measured, are
    where they are believed to be. As it was where they are not both in view, or do not fit."""
    clouds = [_cloud(sight, depth, finger) for finger in fingers]
    if len(clouds) < 2 or min(len(cloud) for cloud in clouds) < LEAST:
        return sight
    middle = np.concatenate(clouds).mean(axis=0)
    move = np.zeros(3)  # x, y, yaw
    residuals = np.zeros(0)
    for _ in range(ROUNDS):
        parts = [_linear(cloud, finger, middle, move) for cloud, finger in zip(clouds, fingers, strict=True)]
        residuals = np.concatenate([r for r, _ in parts])
        design = np.concatenate([d for _, d in parts])
        scale = 4.7 * max(FINE, 1.5 * float(np.median(np.abs(residuals))))
        weight = np.clip(1.0 - (residuals / scale) ** 2, 0.0, None) ** 2
        normal = design.T @ (design * weight[:, None]) + np.diag([1e-3, 1e-3, 1e-6])
        step = np.asarray(np.linalg.solve(normal, -design.T @ (weight * residuals)), dtype=np.float64)
        move = move + np.clip(step, -0.01, 0.01)
        if float(np.abs(step).max()) < 1e-6:
            break
    x, y, yaw = (float(c) for c in move)
    doubtful = float(np.median(np.abs(residuals))) > GOOD
    if doubtful or math.hypot(x, y) > MOST or abs(yaw) > MOST_TURN:
        return sight
    turn = _about_vertical(yaw)
    origin = turn @ (sight.origin - middle) + middle + np.array([x, y, 0.0])
    return PosedCamera.along(sight.intrinsics, origin, turn @ sight.rotation)


def _cloud(sight: PosedCamera, depth: Array, finger: ConvexFacets) -> Array:
    """Measured points (n, 3) that may be the finger's."""
    picked = np.zeros(depth.shape, dtype=np.bool_)
    picked[::EVERY, ::EVERY] = True
    away = float((finger.middle - sight.origin) @ sight.rotation[:, 2])
    reach = finger.radius + NEAR
    rows, columns = np.nonzero(picked & (depth > max(0.0, away - reach)) & (depth < away + reach))
    pixels = np.stack([columns, rows], axis=1).astype(np.float64)
    points = sight.origin + sight.directions(pixels) * depth[rows, columns][:, None]
    points = points[np.linalg.norm(points - finger.middle, axis=1) < reach]
    off, _ = finger.outside(points)
    points = points[np.abs(off) < NEAR]
    return points[:: max(1, len(points) // SPOTS)]


def _linear(cloud: Array, finger: ConvexFacets, middle: Array, move: Array) -> tuple[Array, Array]:
    """Residuals (n,) after a move, and how they change with it (n, 3)."""
    arm = (cloud - middle) @ _about_vertical(float(move[2])).T
    off, normals = finger.outside(arm + middle + np.array([move[0], move[1], 0.0]))
    by_yaw = normals[:, 1] * arm[:, 0] - normals[:, 0] * arm[:, 1]
    return off, np.column_stack([normals[:, 0], normals[:, 1], by_yaw])


def _about_vertical(yaw: float) -> Array:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
