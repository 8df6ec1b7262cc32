"""RGB-D camera by rays: depth and body of each pixel from MuJoCo's collision queries, without a graphics
library.

Pictures are the same on every processor. A colour is shaded by the angle between surface and light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from .cell_description import CameraEntry
from .cell_faults import CellFaults
from .cell_model import FLOOR_GROUP, SEEN_GROUPS, CellModel

LIGHT = np.array([0.25, -0.15, 1.0]) / math.hypot(0.25, 0.15, 1.0)
"""Direction towards the light, in the world."""
AMBIENT_SHARE = 0.6
"""Share of a colour that a surface has without light."""
EDGE_STEP = 0.01
"""Least difference of depth between neighbouring pixels at an edge, m."""
MIN_DEPTH_DEVIATION = 2e-4
"""Least standard deviation of a depth with noise, m."""
COLOUR_ERROR = 4
"""Greatest error of a colour channel, of 255."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Hits:
    """Surfaces that the rays of a picture meet, in the order of its pixels."""

    geoms: NDArray[np.int32]
    """Number of the geom (n,); -1: none."""
    lengths: Array
    """Length of the ray (n,), m; negative: no hit."""
    normals: Array
    """Normal of the surface (n, 3), in the world, towards the viewer."""


class RayCaster:
    """Rays of a pinhole camera, one through each pixel."""

    def __init__(self, model: mujoco.MjModel, size: tuple[int, int], fov: float, *, floor: bool) -> None:
        """`size`: width and height, pixels. `fov`: vertical field of view, rad. `floor`: draw it."""
        self._model = model
        width, height = size
        self.focal = height / 2 / math.tan(fov / 2)
        self.centre = (width / 2 - 0.5, height / 2 - 0.5)
        rows, columns = np.mgrid[:height, :width]
        rays = np.stack(
            [
                (columns - self.centre[0]) / self.focal,
                (rows - self.centre[1]) / self.focal,
                np.ones((height, width)),
            ],
            axis=2,
        ).reshape(-1, 3)
        lengths = np.linalg.norm(rays, axis=1)
        self._rays = rays / lengths[:, None]
        self.along = 1.0 / lengths
        """Share of a ray's length along the optical axis (n,)."""
        self._seen = np.zeros(6, np.uint8)
        self._seen[list(SEEN_GROUPS)] = 1
        self._seen[FLOOR_GROUP] = floor
        self.colours = _colours(model)
        """Colour (geoms, 3) of each geom, 0 … 1."""

    def directions(self, rotation: Array) -> Array:
        """Return the rays (n, 3) in the world; `rotation` (3, 3): of the optical frame."""
        return np.ascontiguousarray(self._rays @ rotation.T)

    def cast(self, data: mujoco.MjData, position: Array, directions: Array, cutoff: float) -> Hits:
        """Return what rays from a point meet within `cutoff` m."""
        count = len(directions)
        geoms, lengths, normals = np.empty(count, np.int32), np.empty(count), np.empty(3 * count)
        mujoco.mj_multiRay(
            self._model,
            data,
            position,
            directions.ravel(),
            self._seen,
            True,
            -1,
            geoms,
            lengths,
            normals,
            count,
            cutoff,
        )
        normals = normals.reshape(count, 3)
        # The triangles of a mesh may be wound either way.
        behind = np.einsum("ij,ij->i", normals, directions) > 0.0
        normals[behind] *= -1.0
        return Hits(geoms, lengths, normals)


class RayCamera:
    """Camera of a cell."""

    def __init__(
        self, camera: CameraEntry, cell: CellModel, faults: CellFaults, seed: int, number: int
    ) -> None:
        self.entry = camera
        self._faults = faults
        self._rng = np.random.default_rng([seed, 3, number])
        self._caster = RayCaster(cell.model, camera.size, camera.fov, floor=False)
        self.focal, self.centre = self._caster.focal, self._caster.centre

    def capture(
        self, data: mujoco.MjData, tcp: tuple[Array, Array]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]] | None:
        """Return colour (h, w, 3) and depth (h, w), m, 0: unknown; None when the picture is lost.

        `tcp`: position (3,) and rotation (3, 3) of the TCP in the world.
        """
        lost = self._rng.random() < self._faults.dropped_pictures
        if lost:
            return None
        colour, depth = self._seen_by(data, *self._frame(tcp))
        return self._noisy_colour(colour), self._noisy_depth(depth)

    def _frame(self, tcp: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return position and rotation of the optical frame in the world."""
        frame = self.entry.frame
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, np.array(frame.wxyz))
        position, rotation = np.array(frame.at), turn.reshape(3, 3)
        if self.entry.on_hand:
            return tcp[0] + tcp[1] @ position, tcp[1] @ rotation
        return position, rotation

    def _seen_by(self, data: mujoco.MjData, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Return colour (h, w, 3), 0 … 255, and depth (h, w), m, without noise."""
        width, height = self.entry.size
        caster = self._caster
        hits = caster.cast(data, position, caster.directions(rotation), 2.0 * self.entry.far)
        depth = hits.lengths * caster.along
        hit = (hits.geoms >= 0) & (depth < self.entry.far)
        shade = AMBIENT_SHARE + (1.0 - AMBIENT_SHARE) * np.clip(hits.normals @ LIGHT, 0.0, 1.0)
        colour = np.where(hit[:, None], caster.colours[hits.geoms] * shade[:, None] * 255.0, 0.0)
        depth = np.where(hit & (depth >= self.entry.near), depth, 0.0)
        return colour.reshape(height, width, 3), depth.reshape(height, width)

    def _noisy_colour(self, colour: Array) -> NDArray[np.uint8]:
        errors = self._rng.integers(-COLOUR_ERROR, COLOUR_ERROR + 1, colour.shape)
        return np.clip(colour + errors, 0, 255).astype(np.uint8)

    def _noisy_depth(self, depth: Array) -> NDArray[np.float32]:
        """Return a depth with the noise of the camera and the cell's faults."""
        rng, faults, known = self._rng, self._faults, depth > 0.0
        deviation = self.entry.depth_noise / 0.49 * depth**2
        if self.entry.depth_noise > 0.0:
            deviation = np.maximum(deviation, MIN_DEPTH_DEVIATION)
        noisy = depth + rng.standard_normal(depth.shape) * deviation
        edge = _edges(depth)
        noisy[edge & (rng.random(depth.shape) < self.entry.edge_dropout)] = 0.0
        if faults.flying_pixels > 0.0:
            flying = edge & (rng.random(depth.shape) < faults.flying_pixels)
            noisy[flying] += rng.uniform(-0.03, 0.03, int(flying.sum()))
        if faults.depth_ripple > 0.0:
            rows, columns = np.mgrid[: depth.shape[0], : depth.shape[1]]
            noisy += faults.depth_ripple * np.sin(columns / 17.0) * np.sin(rows / 13.0)
        if faults.depth_holes > 0.0:
            height, width = depth.shape
            blobs = rng.random((-(-height // 4), -(-width // 4))) < faults.depth_holes
            noisy[np.kron(blobs, np.ones((4, 4), bool))[:height, :width]] = 0.0
        if faults.depth_edges > 0.0:
            near = _widened(_widened(edge))
            noisy[near & (rng.random(depth.shape) < faults.depth_edges)] = 0.0
        return np.where(known, np.maximum(noisy, 0.0), 0.0).astype(np.float32)


def _colours(model: mujoco.MjModel) -> Array:
    """Return the colour (geoms, 3) of each geom, 0 … 1: of its material, if it has one."""
    colours = model.geom_rgba[:, :3].astype(np.float64)
    material = model.geom_matid
    colours[material >= 0] = model.mat_rgba[material[material >= 0], :3]
    return colours


def _edges(depth: Array) -> NDArray[np.bool_]:
    """Return the pixels (h, w) beside a step of depth."""
    edge = np.zeros(depth.shape, bool)
    rows = np.abs(np.diff(depth, axis=0)) > EDGE_STEP
    edge[1:] |= rows
    edge[:-1] |= rows
    columns = np.abs(np.diff(depth, axis=1)) > EDGE_STEP
    edge[:, 1:] |= columns
    edge[:, :-1] |= columns
    return edge


def _widened(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the mask with its four-neighbours."""
    wide = mask.copy()
    wide[1:] |= mask[:-1]
    wide[:-1] |= mask[1:]
    wide[:, 1:] |= mask[:, :-1]
    wide[:, :-1] |= mask[:, 1:]
    return wide
