"""Ways over a surface on which something is searched, and when what moves there stands."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator


class Standing:
    """Whether something has changed little for a while."""

    def __init__(self, time: float, little: float) -> None:
        self._time, self._little = time, little
        self._recent: deque[tuple[float, float]] = deque()

    def since(self, now: float, value: float) -> bool:
        """`value` at the time `now`, s: whether all values of the last while are this near to each other."""
        recent = self._recent
        recent.append((now, value))
        while now - recent[0][0] > self._time:
            recent.popleft()
        if now - recent[0][0] < 0.9 * self._time:
            return False
        values = [v for _, v in recent]
        return max(values) - min(values) < self._little


def spiral(pitch: float, radius: float, step: float) -> Iterator[tuple[float, float]]:
    """Points of an Archimedean spiral out to a radius, `step` m apart along it."""
    rise, angle = pitch / (2 * math.pi), 0.0
    while rise * angle <= radius:
        r = rise * angle
        yield r * math.cos(angle), r * math.sin(angle)
        angle += step / math.hypot(r, rise)


def grid(spacing: float, radius: float) -> Iterator[tuple[float, float]]:
    """The middle, then rings around it within the radius, so many that no point of it is further than about
    0.6 of the spacing from one of them."""
    yield 0.0, 0.0
    beyond = radius - 0.5 * spacing
    rings = math.ceil(max(0.0, beyond) / spacing)
    for ring in range(1, rings + 1):
        at = ring * (beyond + 0.15 * spacing) / rings
        for k in range(6 * ring):
            angle = math.pi * k / (3 * ring)
            yield at * math.cos(angle), at * math.sin(angle)
