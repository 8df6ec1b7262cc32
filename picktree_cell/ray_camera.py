"""RGB-D camera by rays: depth and body of each pixel from MuJoCo's collision queries, without a graphics
library.

Pictures are the same on every processor. A colour is shaded by the angle between surface and light.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from .cell_description import CameraEntry
from .cell_faults import CellFaults
from .cell_model import UNSEEN_GROUP, CellModel

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


class RayCamera:
    """Camera of a cell."""

    def __init__(
        self, camera: CameraEntry, cell: CellModel, faults: CellFaults, seed: int, number: int
    ) -> None:
        self.entry = camera
        self._cell, self._faults = cell, faults
        self._rng = np.random.default_rng([seed, 3, number])
        width, height = camera.size
        self.focal = height / 2 / math.tan(camera.fov / 2)
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
        self._along = 1.0 / lengths
        """Share of a ray's length along the optical axis."""
        self._seen = np.ones(6, np.uint8)
        self._seen[UNSEEN_GROUP] = 0
        model = cell.model
        self._colours = model.geom_rgba[:, :3].astype(np.float64)

    def capture(
        self, data: mujoco.MjData, tcp: tuple[NDArray[np.float64], NDArray[np.float64]]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]] | None:
        """Return colour (h, w, 3) and depth (h, w), m, 0: unknown; None when the picture is lost.

        `tcp`: position (3,) and rotation (3, 3) of the TCP in the world.
        """
        lost = self._rng.random() < self._faults.dropped_pictures
        if lost:
            return None
        colour, depth = self._seen_by(data, *self._frame(tcp))
        return self._noisy_colour(colour), self._noisy_depth(depth)

    def _frame(
        self, tcp: tuple[NDArray[np.float64], NDArray[np.float64]]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return position and rotation of the optical frame in the world."""
        frame = self.entry.frame
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, np.array(frame.wxyz))
        position, rotation = np.array(frame.at), turn.reshape(3, 3)
        if self.entry.on_hand:
            return tcp[0] + tcp[1] @ position, tcp[1] @ rotation
        return position, rotation

    def _seen_by(
        self, data: mujoco.MjData, position: NDArray[np.float64], rotation: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        width, height = self.entry.size
        count = width * height
        rays = self._rays @ rotation.T
        bodies, reach, normals = np.empty(count, np.int32), np.empty(count), np.empty(3 * count)
        mujoco.mj_multiRay(
            self._cell.model,
            data,
            position,
            np.ascontiguousarray(rays).ravel(),
            self._seen,
            True,
            -1,
            bodies,
            reach,
            normals,
            count,
            2.0 * self.entry.far,
        )
        depth = reach * self._along
        hit = (bodies >= 0) & (depth < self.entry.far)
        normals = normals.reshape(count, 3)
        shade = AMBIENT_SHARE + (1.0 - AMBIENT_SHARE) * np.clip(normals @ LIGHT, 0.0, 1.0)
        colour = np.where(hit[:, None], self._colours[bodies] * shade[:, None] * 255.0, 0.0)
        depth = np.where(hit & (depth >= self.entry.near), depth, 0.0)
        return colour.reshape(height, width, 3), depth.reshape(height, width)

    def _noisy_colour(self, colour: NDArray[np.float64]) -> NDArray[np.uint8]:
        errors = self._rng.integers(-COLOUR_ERROR, COLOUR_ERROR + 1, colour.shape)
        return np.clip(colour + errors, 0, 255).astype(np.uint8)

    def _noisy_depth(self, depth: NDArray[np.float64]) -> NDArray[np.float32]:
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


def _edges(depth: NDArray[np.float64]) -> NDArray[np.bool_]:
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
