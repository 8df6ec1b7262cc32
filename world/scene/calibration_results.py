"""Calibration results: believed poses of cameras and tool, and the coloured squares of targets."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..shapes import Box
from ..values import Array, Pose, Vector3

TILE_COLOURS = ("red", "yellow", "blue", "purple", "green", "cyan")
"""Colours of the squares, row by row. All differ, so that each square is identified by itself and the
target's orientation is unambiguous."""
TILE_COLUMNS, TILE_ROWS = 3, 2
TILE_EDGE_SHARE = 0.75
"""Edge of a square over that of its cell. The grey between squares, and to the block's edges, lets a
camera separate them."""
TILE_HEIGHT = 0.00005
"""Height of the squares, which are printed on, over the block's top, m: a camera that looks from the side
sees no edge of theirs."""
MIN_TARGET_SIZE = (0.06, 0.04, 0.02)
"""Minimum size of a target along x, y, z, m: fingers must reach five sides, and a camera must separate the
squares."""


@dataclass(frozen=True, slots=True)
class TargetTile:
    """A coloured square on the top of a target, with its edges along the target's x and y."""

    colour: str
    centre: Vector3
    """Centre in the target's frame, on the face that is seen, m. That frame is the frame of the target's
    box."""
    edge: float
    """m"""

    def corners(self) -> Array:
        """(4, 3), in order around it, in the target's frame, m."""
        half = self.edge / 2
        around = np.array([(1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0)], dtype=np.float64)
        return around * half + np.array(self.centre)


def tiles_on(size: Vector3) -> tuple[TargetTile, ...]:
    """The squares of a target of `size` (x, y, z) m: in three columns along x and two rows along y."""
    x, y, z = size
    cell = (x / TILE_COLUMNS, y / TILE_ROWS)
    edge = TILE_EDGE_SHARE * min(cell)
    found: list[TargetTile] = []
    for n, colour in enumerate(TILE_COLOURS):
        row, column = divmod(n, TILE_COLUMNS)
        across, along = column - (TILE_COLUMNS - 1) / 2, (TILE_ROWS - 1) / 2 - row
        found.append(TargetTile(colour, (across * cell[0], along * cell[1], z / 2 + TILE_HEIGHT), edge))
    return tuple(found)


def tile_body(tile: TargetTile, thickness: float) -> tuple[Box, Pose]:
    """The square as a body for whoever draws it, in the target's frame: half of it stands out, m."""
    x, y, z = tile.centre
    return Box((tile.edge, tile.edge, thickness)), Pose((x, y, z - TILE_HEIGHT))


@dataclass(frozen=True, slots=True)
class SceneCalibration:
    """Corrections of a scene's belief. They move what is believed, never what is true."""

    cameras: tuple[tuple[str, Pose], ...] = ()
    """Name, and the optical frame in the world, or in the corrected TCP's frame for a camera on the hand."""
    tcp: Pose = field(default_factory=Pose)
    """The corrected TCP in the frame of the one that the robot file states: the whole hand sits off by it."""
    date: str = ""
    by: str = ""
    """Short description of the calibration's source."""
