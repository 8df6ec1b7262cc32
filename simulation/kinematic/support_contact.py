"""Upon what the finger tips and a held item have come down, without physics."""

from __future__ import annotations

from collections.abc import Iterable

FRESH = 0.005
"""Depth up to which a foot counts as standing upon a top where it is not known from where it came, m."""
LEVEL = 5e-4
"""A foot that was no more than this below a top came from above, m."""


class Feet:
    """Remembers upon which tops each foot has come down: a finger tip, or the bottom of what is held.

    A foot stands upon a body that it has entered from above, until it leaves the outline. What it entered
    from the side, as fingers do that open next to something, gives way sideways and pushes nothing up.
    """

    def __init__(self) -> None:
        self._height: dict[str, float] = {}
        self._upon: dict[str, frozenset[str]] = {}

    def forget(self, *feet: str) -> None:
        """These feet (default: all) are far from everything, or were put somewhere else."""
        for foot in feet or tuple(self._height):
            self._height.pop(foot, None)
            self._upon.pop(foot, None)

    def top(self, foot: str, height: float, tops: Iterable[tuple[str, float]]) -> float | None:
        """The highest of `tops` (names and heights at the foot, m) that carries the foot or is below it."""
        before, upon = self._height.get(foot), self._upon.get(foot, frozenset[str]())
        entered = height + FRESH if before is None else before + LEVEL
        carrying = {name: top for name, top in tops if top <= max(height, entered) or name in upon}
        self._height[foot] = height
        self._upon[foot] = frozenset(name for name, top in carrying.items() if top > height)
        return max(carrying.values(), default=None)
