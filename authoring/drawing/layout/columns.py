"""Frames on a page: in the order of the file, each at the foot of the column that is shortest so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from .graphviz_layout import Spot

GAP: Final = 28
_SHAPE: Final = 1.5
"""Width through height of a page that a screen shows well."""


@dataclass(frozen=True, slots=True)
class Page:
    spots: tuple[Spot, ...]
    width: int
    height: int


def page(sizes: Sequence[tuple[int, int]]) -> Page:
    """The page whose shape is nearest to that of a screen, of those with one column, two, and so on."""
    pages = [_in_columns(sizes, count) for count in range(1, len(sizes) + 1)]
    return min(pages, key=lambda p: max(p.width / p.height / _SHAPE, p.height * _SHAPE / p.width))


def _in_columns(sizes: Sequence[tuple[int, int]], count: int) -> Page:
    columns: list[list[int]] = [[] for _ in range(count)]
    depths = [0] * count
    tops: list[int] = []
    for index, (_, height) in enumerate(sizes):
        shortest = depths.index(min(depths))
        columns[shortest].append(index)
        tops.append(depths[shortest])
        depths[shortest] += height + GAP
    widths = [max((sizes[index][0] for index in column), default=0) for column in columns]
    lefts = {
        index: sum(widths[:number]) + GAP * number
        for number, column in enumerate(columns)
        for index in column
    }
    spots = tuple(Spot(lefts[index], tops[index]) for index in range(len(sizes)))
    return Page(spots, sum(widths) + GAP * (count - 1), max(depths) - GAP)
