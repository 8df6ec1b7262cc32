"""Film of a cell: pictures by rays from a fixed viewpoint, ten in a second of the robot's time.

The lamp casts shadows. Without a graphics library a picture takes about 0.1 s of CPU time, and up to 0.7 s
with the fine meshes of a maker's model.
"""

from __future__ import annotations

import importlib
import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .cell_description import CellError
from .plant import Plant
from .ray_camera import Array, RayCaster

FORMATS: Final = {".mp4": ("mp4", "libx264", "yuv420p"), ".gif": ("gif", "gif", "rgb8")}
"""Format, codec and pixels of a film by the end of its name."""
SIZE: Final = (480, 360)
"""Width and height, pixels."""
FOV: Final = math.radians(36.0)
"""Vertical field of view, rad."""
RATE: Final = 10
"""Pictures in a second of the robot's time."""
DISTANCE: Final = 2.1
"""Distance of the viewpoint from what it looks at, m."""
BEARING, ELEVATION = math.radians(40.0), math.radians(28.0)
"""Direction of the viewpoint from there: about the vertical, from the direction in which the arm reaches, and
above the horizon, rad."""
LAMP: Final = np.array([0.9, -1.1, 2.6])
"""Place of the lamp relative to what the viewpoint looks at, m."""
AMBIENT: Final = 0.45
"""Share of a colour in the shadow."""
SHADOW_ALLOWANCE: Final = 4e-3
"""Distance of a surface from the lamp's rays up to which it is lit, m."""
BACKGROUND: Final = np.array([236.0, 240.0, 244.0])
FLOOR: Final = np.array([206.0, 212.0, 216.0])
"""Colours of 0 … 255."""
FAR: Final = 12.0
"""Greatest distance that is drawn, m."""


class Viewpoint:
    """Picture of a plant from a fixed place."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        model = plant.parts.model
        self._caster = RayCaster(model, SIZE, FOV, floor=True)
        self._floor = np.array([geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == 0])
        base, tcp = np.array(plant.cell.robot.base.at), plant.tcp()[0]
        reach = math.atan2(tcp[1] - base[1], tcp[0] - base[0])
        target = 0.4 * base + 0.6 * tcp
        target[2] = base[2] + 0.3 * (tcp[2] - base[2]) + 0.1
        around = reach + BEARING
        level = math.cos(ELEVATION)
        away = np.array([level * math.cos(around), level * math.sin(around), math.sin(ELEVATION)])
        self._position = target + DISTANCE * away
        right = np.cross(-away, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        self._rays = self._caster.directions(np.stack([right, np.cross(-away, right), -away], axis=1))
        self._lamp = target + LAMP

    def picture(self) -> NDArray[np.uint8]:
        """Return the present picture, RGB (h, w, 3)."""
        width, height = SIZE
        hits = self._caster.cast(self._plant.data, self._position, self._rays, FAR)
        hit = hits.geoms >= 0
        points = self._position + self._rays * hits.lengths[:, None]
        colours = np.where(
            np.isin(hits.geoms, self._floor)[:, None], FLOOR, 255.0 * self._caster.colours[hits.geoms]
        )
        light = AMBIENT + (1.0 - AMBIENT) * self._lit(points, hits.normals, hit)
        picture = np.where(hit[:, None], colours * light[:, None], BACKGROUND)
        return picture.reshape(height, width, 3).astype(np.uint8)

    def _lit(self, points: Array, normals: Array, hit: NDArray[np.bool_]) -> Array:
        """Return the share of the lamp's light on each point (n,), 0 in a shadow."""
        lit = np.zeros(len(points))
        towards = points[hit] - self._lamp
        distances = np.linalg.norm(towards, axis=1)
        towards = np.ascontiguousarray(towards / distances[:, None])
        first = self._caster.cast(self._plant.data, self._lamp, towards, 2.0 * FAR)
        free = (first.geoms < 0) | (first.lengths > distances - SHADOW_ALLOWANCE)
        slope = np.clip(-np.einsum("ij,ij->i", normals[hit], towards), 0.0, 1.0)
        lit[hit] = np.where(free, slope, 0.0)
        return lit


class Film:
    """Film of a plant that is written as its time passes."""

    def __init__(self, path: Path, plant: Plant) -> None:
        """Raises CellError for another kind of file, where it cannot be written, and without PyAV."""
        ending = path.suffix.lower()
        if ending not in FORMATS:
            raise CellError(f"{path}: a film is a file that ends in {' or '.join(FORMATS)}")
        try:
            self._av: Any = importlib.import_module("av")
        except ImportError:
            raise CellError("a film needs the package av: pip install 'picktree[video]'") from None
        self._path, self._plant = path, plant
        self._view = Viewpoint(plant)
        kind, codec, pixels = FORMATS[ending]
        try:
            path.touch()  # PyAV opens it with the first picture.
            self._container = self._av.open(str(path), "w", format=kind)
        except OSError as error:
            raise CellError(f"{path}: the film cannot be written: {error.strerror}") from None
        self._stream = self._container.add_stream(codec, rate=RATE)
        self._stream.width, self._stream.height = SIZE
        self._stream.pix_fmt = pixels
        self._count = 0

    def follow(self) -> None:
        """Add the pictures that are due."""
        if self._plant.time * RATE < self._count - 1e-9:
            return
        picture = self._view.picture()
        while self._plant.time * RATE >= self._count - 1e-9:
            frame = self._av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts = self._count
            self._container.mux(self._stream.encode(frame))
            self._count += 1

    def close(self) -> None:
        """Finish the file."""
        self._container.mux(self._stream.encode(None))
        self._container.close()
