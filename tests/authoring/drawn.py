"""The picture of `shift.yaml`, and rectangles in it, each `x, y, width, height`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import TypeAlias

from picktree.authoring import chart_of_file
from picktree.authoring.mission_chart import Chart

SHIFT = Path(__file__).parent / "shift.yaml"
Rect: TypeAlias = Sequence[float]


@cache
def shift() -> Chart:
    return chart_of_file(SHIFT)


def overlaps(rects: Sequence[Rect]) -> list[tuple[Rect, Rect]]:
    """Return the pairs that lie on each other."""
    return [(a, b) for a, b in combinations(rects, 2) if not (_is_before(a, b) or _is_before(b, a))]


def outside(frame: Rect, rects: Sequence[Rect]) -> list[Rect]:
    """Return those that do not lie in a frame."""
    x, y, width, height = frame
    return [r for r in rects if r[0] < x or r[1] < y or r[0] + r[2] > x + width or r[1] + r[3] > y + height]


def _is_before(a: Rect, b: Rect) -> bool:
    return a[0] + a[2] <= b[0] or a[1] + a[3] <= b[1]
