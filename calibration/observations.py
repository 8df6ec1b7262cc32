"""What a calibration has to go by: pictures of a target, and touches of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..world.journal import Plain
from ..world.protocols import Intrinsics
from ..world.values import Array, Pose, Vector3
from .tiles import TileSeen

SHOT, TOUCH = "calibration_shot", "calibration_touch"
"""Kinds of the events that a run's record keeps."""


@dataclass(frozen=True, slots=True)
class Shot:
    """One picture of the target."""

    camera: str
    on_hand: bool
    intrinsics: Intrinsics
    tcp: Pose
    """Of the arm at rest, in the world, by encoders and model."""
    believed: Pose
    """Of the optical frame in the TCP's frame, or in the world for a camera that hangs still."""
    tiles: tuple[TileSeen, ...]

    def to_plain(self) -> dict[str, Plain]:
        i = self.intrinsics
        return {
            "camera": self.camera,
            "on_hand": self.on_hand,
            "intrinsics": [i.width, i.height, i.fx, i.fy, i.cx, i.cy],
            "tcp": _plain(self.tcp),
            "believed": _plain(self.believed),
            "tiles": [
                [t.index, *t.pixel, t.depth, *t.depth_pixel, t.depth_sigma, t.area] for t in self.tiles
            ],
        }

    @classmethod
    def from_plain(cls, data: dict[str, Any]) -> Shot:
        width, height, fx, fy, cx, cy = data["intrinsics"]
        return cls(
            data["camera"],
            data["on_hand"],
            Intrinsics(int(width), int(height), fx, fy, cx, cy),
            _pose(data["tcp"]),
            _pose(data["believed"]),
            tuple(
                TileSeen(int(n), (u, v), z, (du, dv), sigma, int(area))
                for n, u, v, z, du, dv, sigma, area in data["tiles"]
            ),
        )


@dataclass(frozen=True, slots=True)
class Touch:
    """The closed fingers at rest against a face of the target."""

    face: Vector3
    """Normal of the face, out of the target, in its frame."""
    tcp: Pose
    """In the world, by encoders and model."""
    force: float
    """With which they press, N."""
    name: str = ""

    def to_plain(self) -> dict[str, Plain]:
        return {"face": list(self.face), "tcp": _plain(self.tcp), "force": self.force, "name": self.name}

    @classmethod
    def from_plain(cls, data: dict[str, Any]) -> Touch:
        x, y, z = data["face"]
        return cls((x, y, z), _pose(data["tcp"]), data["force"], data["name"])


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """All that was seen and touched of one target."""

    shots: tuple[Shot, ...]
    touches: tuple[Touch, ...]
    tips: Array
    """Corners (n, 3) of the closed fingers' pads in the TCP's frame, m."""


def _plain(pose: Pose) -> list[Plain]:
    return [*pose.position, *pose.orientation]


def _pose(numbers: list[float]) -> Pose:
    x, y, z, *turn = numbers
    a, b, c, d = turn
    return Pose((x, y, z), (a, b, c, d))
