"""A camera that shows colours as others."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ...world.colours import ITEM_COLOURS, Rgb
from ...world.values import Array

SATURATED, DARK = 0.4, 0.08
"""What is less saturated, or darker, than this has no colour."""


def shown(picture: NDArray[np.uint8], others: Mapping[str, str]) -> NDArray[np.uint8]:
    """The picture (h, w, 3) with everything in a colour that is a key of `others` in the other one, as bright
    and with as much grey in it as it was."""
    if not others:
        return picture
    low, high = picture.min(axis=2).astype(np.float64), picture.max(axis=2).astype(np.float64)
    spread = high - low
    coloured = (spread > SATURATED * high) & (high > 255 * DARK)
    names = list(ITEM_COLOURS)
    known = np.array([colorsys.rgb_to_hsv(*rgb)[0] for rgb in ITEM_COLOURS.values()])
    rows, columns = np.nonzero(coloured)
    pixels = picture[rows, columns].astype(np.float64)
    apart = np.abs((_hue(pixels)[:, None] - known + 0.5) % 1.0 - 0.5)
    nearest = apart.argmin(axis=1)
    changed: Array = picture.astype(np.float64)
    for name, other in others.items():
        of = nearest == names.index(name)
        at = rows[of], columns[of]
        base, reach = low[at][:, None], spread[at][:, None]
        pure = _pure(ITEM_COLOURS[other])
        changed[at] = base + reach * pure
    return changed.round().clip(0, 255).astype(np.uint8)


def _hue(pixels: Array) -> Array:
    """Of coloured pixels (n, 3): (n,), in turns."""
    high, low = pixels.max(axis=1), pixels.min(axis=1)
    spread = np.maximum(high - low, 1e-9)
    red, green, blue = pixels[:, 0], pixels[:, 1], pixels[:, 2]
    sixths: Array = (red - green) / spread + 4.0
    sixths = np.where(high == green, (blue - red) / spread + 2.0, sixths)
    sixths = np.where(high == red, ((green - blue) / spread) % 6.0, sixths)
    return sixths / 6.0


def _pure(colour: Rgb) -> Array:
    """The colour without its grey, (3,) in 0 … 1."""
    rgb = np.array(colour)
    return np.asarray((rgb - rgb.min()) / (rgb.max() - rgb.min()), np.float64)
