"""Which named colour a pixel has: saturated pixels go to the nearest hue, grey ones to none."""

from __future__ import annotations

import colorsys

import cv2
import numpy as np
from numpy.typing import NDArray

from ...world.colours import ITEM_COLOURS

SATURATED = 128
"""Of 255: items are more saturated than this, fixtures and robot less."""
BRIGHT = 24
"""Of 255: below it a hue means nothing."""

NAMES: tuple[str, ...] = ("", *ITEM_COLOURS)
"""Name of each label; label 0 is no colour."""


def _table() -> NDArray[np.uint8]:
    known = np.array([colorsys.rgb_to_hsv(*rgb)[0] for rgb in ITEM_COLOURS.values()])
    hues = np.arange(256)[:, None] / 255.0
    apart = np.abs((hues - known + 0.5) % 1.0 - 0.5)
    return (apart.argmin(axis=1) + 1).astype(np.uint8)


_LABEL_OF_HUE = _table()


def labels(colour: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Index into NAMES for each pixel (h, w) of an RGB picture (h, w, 3)."""
    hsv = np.asarray(cv2.cvtColor(colour, cv2.COLOR_RGB2HSV_FULL), dtype=np.uint8)
    coloured = (hsv[:, :, 1] > SATURATED) & (hsv[:, :, 2] > BRIGHT)
    return np.where(coloured, _LABEL_OF_HUE[hsv[:, :, 0]], 0).astype(np.uint8)


def label_of(name: str) -> int:
    """Label of a named colour; 0 for one that perception does not tell (grey, unknown)."""
    return NAMES.index(name) if name in ITEM_COLOURS else 0
