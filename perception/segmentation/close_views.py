"""Pictures from near: as fine as recognising needs, and what their border cuts off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...world.protocols import Intrinsics, RgbdImage
from .blobs import Pixels

PITCH = 0.002
"""Distance of two pixels on what is seen that recognising was made for, m: finer outlines cost more, and show
what models lack."""


def coarsened(image: RgbdImage) -> RgbdImage:
    """Every so many rows and columns of a picture that was taken from near; the picture itself from afar."""
    known = image.depth[image.depth > 0]
    if not len(known):
        return image
    every = max(1, round(PITCH * image.intrinsics.fx / float(np.median(known))))
    if every == 1:
        return image
    colour, depth = image.colour[::every, ::every].copy(), image.depth[::every, ::every].copy()
    i = image.intrinsics
    h, w = depth.shape
    scaled = Intrinsics(w, h, i.fx / every, i.fy / every, i.cx / every, i.cy / every)
    return replace(image, colour=colour, depth=depth, intrinsics=scaled)


def cut_off(rows: Pixels, columns: Pixels, height: int, width: int) -> bool:
    """Whether these pixels go up to the border of a picture of that size, and may go on beyond."""
    return bool(
        (rows == 0).any()
        or (columns == 0).any()
        or (rows == height - 1).any()
        or (columns == width - 1).any()
    )
