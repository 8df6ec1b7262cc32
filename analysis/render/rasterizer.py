"""Rasterisation: the visible surface at each sample of an image, by OpenCV's software rasteriser.

It needs neither a display nor a GPU. A surface is given by its depth and its *mark*: three channels with the
normal, the first one also with the number of the colour.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.logs import triangle_meshes
from picktree.world import Array

Picture: TypeAlias = NDArray[np.uint8]
Floats: TypeAlias = NDArray[np.float32]

FAR_PLANE = 20.0
"""Depth where nothing is visible, m."""
NEAR_PLANE = 0.1
_COLOUR_STEP = 4.0
"""Step between two colours' numbers in the first channel: wider than a normal's component, -1 … 1."""


class Palette:
    """Colours by number; 0 is nothing, 1 is the ground."""

    def __init__(self) -> None:
        self._numbers: dict[tuple[int, ...], int] = {(-1,): 0, (-2,): 1}

    def numbers(self, colours: Array) -> NDArray[np.int64]:
        """Return a number for each colour (n, 3), new ones for new colours."""
        found, where = np.unique(np.round(colours * 255).astype(np.int64), axis=0, return_inverse=True)
        known = [self._numbers.setdefault(tuple(c), len(self._numbers)) for c in found.tolist()]
        return np.array(known, np.int64)[where.ravel()]

    def table(self) -> Floats:
        """Return the colours (n, 3) by number, 0 … 1."""
        rows = [(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), *list(self._numbers)[2:]]
        return (np.array(rows) / 255.0).astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class RasterModel:
    """Mesh prepared for drawing: three rows for each triangle.

    Positions and normals (3n, 3) are in its own frame; numbers of colours are (3n,).
    """

    positions: Floats
    normals: Floats
    numbers: Floats

    @classmethod
    def of(cls, mesh: triangle_meshes.Mesh, palette: Palette) -> RasterModel:
        numbers = palette.numbers(mesh.colours) if len(mesh.faces) else np.zeros(0)
        return cls(
            mesh.vertices[mesh.faces].reshape(-1, 3).astype(np.float32),
            mesh.normals.reshape(-1, 3).astype(np.float32),
            numbers.repeat(3).astype(np.float32),
        )


@dataclass(frozen=True, slots=True, eq=False)
class TriangleCorners:
    """Corners of triangles in the camera's frame: positions (3n, 3) in right, down, forward, and marks."""

    positions: Floats
    marks: Floats

    def with_(self, more: TriangleCorners) -> TriangleCorners:
        return TriangleCorners(
            np.concatenate([self.positions, more.positions]), np.concatenate([self.marks, more.marks])
        )


def place_models(models: Iterable[tuple[RasterModel, Array, Array]]) -> TriangleCorners:
    """Return the corners of all models, each with rotation (3, 3) and position (3,) of its frame in the
    camera's."""
    positions: list[Floats] = []
    marks: list[Floats] = []
    for model, rotation, place in models:
        turn = rotation.T.astype(np.float32)
        positions.append(model.positions @ turn + place.astype(np.float32))
        mark = model.normals @ turn
        mark[:, 0] += model.numbers * np.float32(_COLOUR_STEP)
        marks.append(mark)
    if not positions:
        return TriangleCorners(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32))
    return TriangleCorners(np.concatenate(positions), np.concatenate(marks))


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """Visible surface at each sample: depth (h, w) in m, marks (h, w, 3)."""

    depth: Floats
    marks: Floats

    @classmethod
    def none(cls, width: int, height: int) -> Surfaces:
        return cls(np.full((height, width), FAR_PLANE, np.float32), np.zeros((height, width, 3), np.float32))

    def copy(self) -> Surfaces:
        return Surfaces(self.depth.copy(), self.marks.copy())

    def draw(self, corners: TriangleCorners, fov: float) -> None:
        """Draw the triangles where they are nearer than the present surface. `fov` is vertical, rad."""
        if len(corners.positions):
            cv2.triangleRasterize(
                corners.positions,
                _triangles(corners),
                corners.marks,
                self.marks,
                self.depth,
                _OPENCV_FROM_CAMERA,
                fov,
                NEAR_PLANE,
                FAR_PLANE,
                _RASTERIZE_SETTINGS,
            )


def draw_depth(
    corners: TriangleCorners, depth: Floats, from_camera: Array, fov: float, between: tuple[float, float]
) -> None:
    """Draw depth alone, `between` two depths in m, as seen by another camera.

    `from_camera` (4, 4) transforms into that camera's right, down, forward.
    """
    if len(corners.positions):
        world = (_OPENCV_FROM_CAMERA.astype(np.float64) @ from_camera).astype(np.float32)
        cv2.triangleRasterizeDepth(
            corners.positions, _triangles(corners), depth, world, fov, *between, _RASTERIZE_SETTINGS
        )


def unpack_marks(marks: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return numbers of colours (n,) and normals (3, n) of marks (n, 3)."""
    normals = np.ascontiguousarray(marks.T)
    number = np.rint(normals[0] * np.float32(1 / _COLOUR_STEP))
    normals[0] -= number * np.float32(_COLOUR_STEP)
    return number.astype(np.intp), normals


def _triangles(corners: TriangleCorners) -> NDArray[np.int32]:
    return np.arange(len(corners.positions), dtype=np.int32).reshape(-1, 3)


_OPENCV_FROM_CAMERA = np.diag(np.array([1.0, -1.0, -1.0, 1.0], np.float32))
"""Transformation from right, down, forward to OpenCV's right, up, backward."""
_RASTERIZE_SETTINGS = (
    cv2.TriangleRasterizeSettings()
    .setShadingType(cv2.RASTERIZE_SHADING_SHADED)
    .setCullingMode(cv2.RASTERIZE_CULLING_NONE)
)
