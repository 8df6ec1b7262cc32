"""RGB-D camera by OpenGL, with MuJoCo's renderer. Its pictures depend on the system's graphics library, so a
run with them has a digest of its own on each machine."""

from __future__ import annotations

import math
import os

import mujoco
import numpy as np

from .cell_description import NO_GL, CameraEntry, CellError
from .cell_faults import CellFaults
from .cell_model import CellModel
from .ray_camera import Array, RayCamera

NEAR, FAR = 0.01, 20.0
"""Distances between which a camera draws, m."""
AMBIENT, DIFFUSE = 0.6, 0.4
"""Shares of a colour without light and from the camera's own lamp."""


class GlCamera(RayCamera):
    """Camera of a cell, drawn by OpenGL; the noise is that of `RayCamera`."""

    def __init__(
        self, camera: CameraEntry, cell: CellModel, faults: CellFaults, seed: int, number: int
    ) -> None:
        """Raises CellError where no graphics library works."""
        super().__init__(camera, cell, faults, seed, number)
        width, height = camera.size
        model = cell.model
        whole = model.vis.global_
        whole.offwidth, whole.offheight = max(whole.offwidth, width), max(whole.offheight, height)
        model.vis.map.znear, model.vis.map.zfar = NEAR / model.stat.extent, FAR / model.stat.extent
        lamp = model.vis.headlight
        lamp.ambient[:], lamp.diffuse[:], lamp.specular[:] = AMBIENT, DIFFUSE, 0.0
        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except (ImportError, AttributeError, OSError, RuntimeError, mujoco.FatalError) as error:
            raise CellError(NO_GL.format(os.environ.get("MUJOCO_GL", ""), error)) from None
        self._free = mujoco.MjvCamera()

    def _seen_by(self, data: mujoco.MjData, position: Array, rotation: Array) -> tuple[Array, Array]:
        renderer = self._renderer
        renderer.update_scene(data, self._free)
        half = NEAR * math.tan(self.entry.fov / 2)
        for eye in renderer.scene.camera:
            eye.pos[:], eye.forward[:], eye.up[:] = position, rotation[:, 2], -rotation[:, 1]
            eye.frustum_center, eye.frustum_width = 0.0, 0.0
            eye.frustum_bottom, eye.frustum_top = -half, half
            eye.frustum_near, eye.frustum_far = NEAR, FAR
        colour = renderer.render().astype(np.float64)
        renderer.enable_depth_rendering()
        depth = renderer.render().astype(np.float64)
        renderer.disable_depth_rendering()
        hit = depth < self.entry.far
        return np.where(hit[:, :, None], colour, 0.0), np.where(hit & (depth >= self.entry.near), depth, 0.0)
