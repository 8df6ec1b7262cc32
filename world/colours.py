"""Named colours: for scene files, the simulation, and perception."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TypeAlias

Rgb: TypeAlias = tuple[float, float, float]
"""Red, green, blue in 0 … 1."""

ITEM_COLOURS: Mapping[str, Rgb] = MappingProxyType(
    {
        "red": (0.85, 0.10, 0.10),
        "orange": (0.95, 0.45, 0.05),
        "yellow": (0.95, 0.85, 0.10),
        "green": (0.10, 0.65, 0.15),
        "cyan": (0.05, 0.75, 0.80),
        "blue": (0.10, 0.25, 0.85),
        "purple": (0.55, 0.15, 0.75),
    }
)
"""Saturated and at least 25° of hue apart, so that a camera can distinguish them."""

PLAIN_COLOURS: Mapping[str, Rgb] = MappingProxyType(
    {
        "white": (0.90, 0.90, 0.90),
        "light_grey": (0.75, 0.75, 0.75),
        "grey": (0.55, 0.55, 0.55),
        "dark_grey": (0.30, 0.30, 0.30),
        "black": (0.08, 0.08, 0.08),
    }
)
"""Unsaturated colours of fixtures, bins and the robot; perception distinguishes them from items by
saturation."""

COLOURS: Mapping[str, Rgb] = MappingProxyType({**ITEM_COLOURS, **PLAIN_COLOURS})

TRUTH_COLOUR: Rgb = (208 / 255, 0.0, 138 / 255)
"""Colour of the ground truth on pages, in pictures and in viewers: no item, fixture or mark has it."""
