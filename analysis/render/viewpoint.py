"""Viewpoints of images, and their names."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from picktree.files import PicktreeError
from picktree.logs import triangle_meshes
from picktree.world import Array, Vector3


@dataclass(frozen=True, slots=True)
class PictureView:
    """Viewpoint of an image: angles in rad (azimuth about the world's z from +x), lengths in m."""

    target: Vector3 = (0.36, 0.0, 0.27)
    distance: float = 2.65
    azimuth: float = math.radians(-30.0)
    elevation: float = math.radians(25.0)
    fov: float = math.radians(32.0)
    """Vertical field of view, rad."""

    def eye(self) -> Array:
        """Return the position of the camera in the world, (3,), m."""
        flat = math.cos(self.elevation)
        direction = (
            flat * math.cos(self.azimuth),
            flat * math.sin(self.azimuth),
            math.sin(self.elevation),
        )
        return np.array(self.target) + self.distance * np.array(direction)

    def axes(self) -> Array:
        """Return the image's right, down and forward in the world, as rows (3, 3)."""
        forward = triangle_meshes.unit(np.array(self.target) - self.eye())
        right = triangle_meshes.unit(np.cross(forward, [0.0, 0.0, 1.0]))
        return np.stack([right, np.cross(forward, right), forward])

    def focal(self, height: int) -> float:
        """Return the focal length in pixels for an image of that height."""
        return height / 2 / math.tan(self.fov / 2)

    def project(self, points: Array, size: tuple[int, int]) -> Array:
        """Project points (n, 3) in the world to rows (column, row, depth) in pixels and m, (n, 3).

        Pixel centres are at halves. A depth ≤ 0 is behind the camera.
        """
        seen = (points - self.eye()) @ self.axes().T
        scale = self.focal(size[1]) / np.maximum(seen[:, 2], 1e-6)
        centre = np.array(size) / 2
        return np.column_stack([seen[:, :2] * scale[:, None] + centre, seen[:, 2]])


VIEWS: Final = {
    "corner": PictureView(),
    "front": PictureView(target=(0.42, 0.0, 0.22), distance=2.6, azimuth=0.0, elevation=math.radians(24.0)),
    "left": PictureView(azimuth=math.radians(60.0), elevation=math.radians(24.0), distance=2.5),
    "right": PictureView(azimuth=math.radians(-75.0), elevation=math.radians(22.0), distance=2.5),
    "top": PictureView(
        target=(0.4, 0.0, 0.0), distance=3.0, azimuth=math.radians(180.0), elevation=math.radians(89.0)
    ),
    "close": PictureView(target=(0.5, 0.0, 0.1), distance=1.5, elevation=math.radians(32.0)),
}
"""Views by name."""


def parse_view(text: str) -> PictureView:
    """Parse a view: its name, or `AZIMUTH,ELEVATION,DISTANCE` in degrees and m. Raises PicktreeError.

    >>> parse_view("top").elevation > parse_view("-30, 25, 2.4").elevation
    True
    """
    if text in VIEWS:
        return VIEWS[text]
    try:
        azimuth, elevation, distance = (float(word) for word in text.split(","))
    except ValueError:
        raise PicktreeError(
            f"view {text!r}: write {', '.join(VIEWS)}, or AZIMUTH,ELEVATION,DISTANCE "
            "in degrees and metres, as in -30,25,2.4"
        ) from None
    if not (abs(elevation) <= 89 and 0.3 <= distance <= 15 and math.isfinite(azimuth)):
        raise PicktreeError(
            f"view {text!r}: the elevation goes from -89 to 89 degrees, the distance from 0.3 to 15 m"
        )
    return PictureView(azimuth=math.radians(azimuth), elevation=math.radians(elevation), distance=distance)


def parse_size(text: str) -> tuple[int, int]:
    """Parse width and height in pixels. Raises PicktreeError.

    >>> parse_size("960x600")
    (960, 600)
    """
    try:
        width, height = (int(word) for word in text.lower().replace("×", "x").split("x"))
    except ValueError:
        raise PicktreeError(f"size {text!r}: write WIDTHxHEIGHT in pixels, as in 960x600") from None
    if not (64 <= width <= 4096 and 64 <= height <= 4096):
        raise PicktreeError(f"size {text!r}: each side goes from 64 to 4096 pixels")
    return width, height
