"""Calibration data: viewpoints for images of the target, detected squares, touches, and their form in the
log."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from picktree.world import Array, Intrinsics, Pose, Vector3, event_types

VIEW_TILTS = (0.12, 0.5, 0.68)
"""Angles between line of sight and target normal of successive views, rad."""
VIEW_DISTANCES = (1.0, 1.15, 1.3)
"""Distances of successive views, as multiples of the nearest at which the target fills its share of the
image."""
MAX_IMAGE_SHARE = 0.8
"""Maximum share of the image's shorter side that the target fills."""
ROLL_STEP = 1.3
"""Rotation about the line of sight from view to view, rad."""


@dataclass(frozen=True, slots=True)
class DetectedTile:
    """Detected square of the target. Pixels (column u, row v) are those of `Intrinsics`."""

    index: int
    """Index of the square among those of the target."""
    pixel: tuple[float, float]
    """Centroid of the square's area in the image, pixels."""
    depth: float
    """Depth along the optical axis at `depth_pixel`, m: harmonic mean over the inside of the square."""
    depth_pixel: tuple[float, float]
    depth_sigma: float
    """Standard error of the depth, from the scatter, m."""
    area: int
    """Area in the image, pixels."""


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """Viewpoint: camera poses of which any one will do; the first is the best."""

    name: str
    camera_in_world: tuple[Pose, ...]


def viewpoints(target: Pose, size: Vector3, intrinsics: Intrinsics, count: int) -> tuple[Viewpoint, ...]:
    """Return `count` viewpoints from which a target of `size` (m) is seen whole. Successive views go round
    the target at varied distances and tilts."""
    across = math.hypot(size[0], size[1])
    shorter = min(intrinsics.width / intrinsics.fx, intrinsics.height / intrinsics.fy)
    nearest = across / (MAX_IMAGE_SHARE * shorter) + size[2] / 2
    return tuple(_viewpoint(target, size, nearest, number) for number in range(count))


def _viewpoint(target: Pose, size: Vector3, nearest: float, number: int) -> Viewpoint:
    tilt, distance = (
        VIEW_TILTS[number % len(VIEW_TILTS)],
        nearest * VIEW_DISTANCES[number // len(VIEW_TILTS) % len(VIEW_DISTANCES)],
    )
    azimuth = 2.4 * number  # rad: spreads any number of views evenly
    up = target.rotation()
    top = np.array(target.position) + up[:, 2] * size[2] / 2
    aside = up @ np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    forward: Array = -(math.cos(tilt) * up[:, 2] + math.sin(tilt) * aside)
    first = np.cross(up @ np.array([-math.sin(azimuth), math.cos(azimuth), 0.0]), forward)
    second = np.cross(forward, first)
    poses: list[Pose] = []
    for roll in (0.0, 0.5, -0.5, 1.0, -1.0, math.pi):  # rad about the line of sight
        turn = ROLL_STEP * number + roll
        right = math.cos(turn) * first + math.sin(turn) * second
        axes = np.column_stack([right, np.cross(forward, right), forward])
        poses.append(Pose.from_rotation(top - distance * forward, axes))
    return Viewpoint(f"view {number + 1}", tuple(poses))


@dataclass(frozen=True, slots=True)
class TargetImage:
    """Image of the target, reduced to its detected squares."""

    camera: str
    on_hand: bool
    intrinsics: Intrinsics
    tcp: Pose
    """Pose of the TCP in the world with the arm at rest, by encoders and model."""
    believed: Pose
    """Believed pose of the optical frame: in the TCP frame, or in the world for a fixed camera."""
    tiles: tuple[DetectedTile, ...]

    def to_event(self, message: str, node: str) -> event_types.CalibrationShotEvent:
        i = self.intrinsics
        return event_types.CalibrationShotEvent(
            message,
            node,
            camera=self.camera,
            on_hand=self.on_hand,
            intrinsics=(i.width, i.height, i.fx, i.fy, i.cx, i.cy),
            tcp=_numbers(self.tcp),
            believed=_numbers(self.believed),
            tiles=tuple(
                (t.index, *t.pixel, t.depth, *t.depth_pixel, t.depth_sigma, t.area) for t in self.tiles
            ),
        )

    @classmethod
    def from_event(cls, event: event_types.CalibrationShotEvent) -> TargetImage:
        width, height, fx, fy, cx, cy = event.intrinsics
        return cls(
            event.camera,
            event.on_hand,
            Intrinsics(int(width), int(height), fx, fy, cx, cy),
            _pose(event.tcp),
            _pose(event.believed),
            tuple(
                DetectedTile(int(n), (u, v), z, (du, dv), sigma, int(area))
                for n, u, v, z, du, dv, sigma, area in event.tiles
            ),
        )


@dataclass(frozen=True, slots=True)
class TargetTouch:
    """Touch: the closed fingers at rest against a face of the target."""

    face: Vector3
    """Normal of the face in the target's frame, pointing outwards."""
    tcp: Pose
    """Pose of the TCP in the world, by encoders and model."""
    force: float
    """Force with which the fingers press against the face, N."""
    name: str = ""

    def to_event(self, message: str, node: str) -> event_types.CalibrationTouchEvent:
        tcp = _numbers(self.tcp)
        return event_types.CalibrationTouchEvent(
            message, node, face=self.face, tcp=tcp, force=self.force, name=self.name
        )

    @classmethod
    def from_event(cls, event: event_types.CalibrationTouchEvent) -> TargetTouch:
        x, y, z = event.face
        return cls((x, y, z), _pose(event.tcp), event.force, event.name)


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationData:
    """All images and touches of one target."""

    shots: tuple[TargetImage, ...]
    touches: tuple[TargetTouch, ...]
    tips: Array
    """Corners (n, 3) of the closed fingers' pads in the TCP's frame, m."""


def _numbers(pose: Pose) -> tuple[float, ...]:
    return (*pose.position, *pose.orientation)


def _pose(numbers: Sequence[float]) -> Pose:
    x, y, z, *turn = numbers
    a, b, c, d = turn
    return Pose((x, y, z), (a, b, c, d))
