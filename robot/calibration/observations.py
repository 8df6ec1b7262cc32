"""Calibration data: viewpoints for images of the target, detected squares, touches, and their form in the
log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from picktree.world import Array, Intrinsics, Pose, Vector3, event_types


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
