"""Whether something is in the hand: the opening tells held from empty, the load on the wrist tells what."""

from __future__ import annotations

from dataclasses import dataclass

from ...world.values import GRAVITY

EMPTY_WIDTH = 0.002
"""Fingers that are closer than this hold nothing, m."""
LEAST_LOAD = 0.012 * GRAVITY
"""Weight of 12 g: the least load that counts as held, N."""
GONE = 0.5
"""Share of the load that must be gone after a release."""


@dataclass(frozen=True, slots=True)
class Hold:
    """What the hand feels: opening in m, load in N since the last tare."""

    width: float
    load: float | None

    @property
    def empty(self) -> bool:
        """The fingers met."""
        return self.width <= EMPTY_WIDTH

    @property
    def loaded(self) -> bool:
        """The wrist carries something; taken as true when the load was not measured."""
        return self.load is None or self.load >= LEAST_LOAD

    @property
    def held(self) -> bool:
        return not self.empty and self.loaded

    def __str__(self) -> str:
        """`opening 40.2 mm, load 1.18 N`, without a minus before a zero."""
        return f"opening {self.width * 1000:.1f} mm, load {round(self.load or 0.0, 2) + 0.0:.2f} N"


def released(before: float, after: float) -> bool:
    """Whether the load on the wrist, N, says that the fingers have let go."""
    return before - after >= GONE * before
