"""Hand-eye calibration in closed form: first guess of a camera on the hand, and the check that the views
suffice."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ..world.scene.calibration_results import TargetTile
from ..world.values import Array, Pose
from .observations import TargetImage
from .target_detection import align_points

MIN_VIEW_ROTATION = math.radians(10.0)
"""Minimum rotation between two views, rad; smaller ones determine the rotation axis poorly."""


def target_in_camera(shot: TargetImage, tiles: Sequence[TargetTile]) -> Pose:
    """Return the target's pose in the camera's optical frame, from the squares' depths alone, unweighted."""
    i = shot.intrinsics
    rays = np.array([((t.pixel[0] - i.cx) / i.fx, (t.pixel[1] - i.cy) / i.fy, 1.0) for t in shot.tiles])
    depths = np.array([t.depth for t in shot.tiles])
    return align_points(np.array([tiles[t.index].centre for t in shot.tiles]), rays * depths[:, None])


def camera_in_tcp(shots: Sequence[TargetImage], tiles: Sequence[TargetTile]) -> Pose:
    """Solve AX = XB for X, the camera in the TCP, with views that `spread` accepts. A is the hand's motion
    between two views, B the camera's motion relative to the target. The rotation is solved first, then the
    translation. Park & Martin (1994)."""
    views = [(shot.tcp, target_in_camera(shot, tiles)) for shot in shots]
    motions = [
        (hand.inverse() @ first, seen @ there.inverse())
        for (first, there), (hand, seen) in combinations(views, 2)
    ]
    alphas = np.array([_turn(a) for a, _ in motions])
    betas = np.array([_turn(b) for _, b in motions])
    u, _, vt = np.linalg.svd(alphas.T @ betas)
    rotation: Array = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    left = np.concatenate([a.rotation() - np.eye(3) for a, _ in motions])
    right = np.concatenate([rotation @ np.array(b.position) - np.array(a.position) for a, b in motions])
    translation: Array = np.asarray(np.linalg.lstsq(left, right, rcond=None)[0], np.float64)
    return Pose.from_rotation(translation, rotation)


def spread(shots: Sequence[TargetImage]) -> float:
    """Return the greatest angle between two rotation axes of the hand over all pairs of views, rad.
    Rotations about one axis alone leave the camera's position along it undetermined (Tsai & Lenz 1989)."""
    axes = [axis for one, other in combinations(shots, 2) if (axis := _axis(one.tcp, other.tcp)) is not None]
    if len(axes) < 2:
        return 0.0
    between = np.abs(np.array(axes) @ np.array(axes).T)
    return float(np.arccos(np.clip(between.min(), 0.0, 1.0)))


def _axis(one: Pose, other: Pose) -> Array | None:
    turn = _turn(one.inverse() @ other)
    angle = float(np.linalg.norm(turn))
    return None if angle < MIN_VIEW_ROTATION else turn / angle


def _turn(pose: Pose) -> Array:
    """Return the rotation vector (3,), rad."""
    x, y, z, w = pose.orientation
    size = math.sqrt(x * x + y * y + z * z)
    angle = 2.0 * math.atan2(size, abs(w))
    return np.array([x, y, z]) * (math.copysign(angle, w) / max(size, 1e-12))
