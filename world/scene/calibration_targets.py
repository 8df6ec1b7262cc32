"""Calibration targets: a block whose top carries squares of different colours, at known places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..shapes import Box
from ..values import Array, Pose, Vector3

COLOURS = ("red", "yellow", "blue", "purple", "green", "cyan")
"""Of the squares, row by row. All differ, so that each square is known by itself and a target that is turned
by half a turn is not taken for one that is not."""
COLUMNS, ROWS = 3, 2
FILLED = 0.75
"""Edge of a square over that of its cell: so much grey is left between squares, and to the block's edges,
that a camera does not mix them up."""
PROUD = 0.00005
"""Height of the squares, which are printed on, over the block's top, m: a camera that looks from the side
sees no edge of theirs."""
SMALLEST = (0.06, 0.04, 0.02)
"""Of a target along x, y, z, m: what fingers can touch from five sides, and a camera can tell apart."""


@dataclass(frozen=True, slots=True)
class Tile:
    """A coloured square on the top of a target, with its edges along the target's x and y."""

    colour: str
    centre: Vector3
    """In the target's frame, which is that of its box: on the face that is seen, m."""
    edge: float
    """m"""

    def corners(self) -> Array:
        """(4, 3), in order around it, in the target's frame, m."""
        half = self.edge / 2
        around = np.array([(1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0)], dtype=np.float64)
        return around * half + np.array(self.centre)


def tiles_on(size: Vector3) -> tuple[Tile, ...]:
    """The squares of a target of `size` (x, y, z) m: in three columns along x and two rows along y."""
    x, y, z = size
    cell = (x / COLUMNS, y / ROWS)
    edge = FILLED * min(cell)
    found: list[Tile] = []
    for n, colour in enumerate(COLOURS):
        row, column = divmod(n, COLUMNS)
        across, along = column - (COLUMNS - 1) / 2, (ROWS - 1) / 2 - row
        found.append(Tile(colour, (across * cell[0], along * cell[1], z / 2 + PROUD), edge))
    return tuple(found)


def sticker(tile: Tile, thickness: float) -> tuple[Box, Pose]:
    """The square as a body for whoever draws it, in the target's frame: half of it stands out, m."""
    x, y, z = tile.centre
    return Box((tile.edge, tile.edge, thickness)), Pose((x, y, z - PROUD))
