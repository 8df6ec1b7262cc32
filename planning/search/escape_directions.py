"""Directions in which an escape path may lead."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

Direction: TypeAlias = Literal["out", "back", "up", "inwards", "left", "right", "outwards", "down"]
"""`out`: where the depths shrink fastest; `back`: against the tool; `inwards`, `outwards`: towards the axis
of the base and away from it; `left`, `right`: about that axis."""
DIRECTIONS: tuple[Direction, ...] = get_args(Direction)
