"""Confidence in root causes: the share of right ones among the like in development situations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from picktree.world import matches

from .confidence_fit import FITTED
from .explanation import Confidence

LIKELY_RATE = 0.92
"""Share of right causes from which on such a cause is likely."""
MIN_CASES = 5
"""Number of development situations below which a rate says nothing."""
KINDS: Final[Mapping[str, tuple[str, ...]]] = {
    "device": ("camera.*", "wrist.*", "joint.*", "arm.*", "gripper.*", "planner.*", "hand.*"),
    "item": ("item.*", "grasp.*", "heap.*", "perception.*"),
    "mission": ("mission.*", "tree.*", "goal.*", "skill.*", "run.*", "internal.*"),
}
"""Kinds of causes, by patterns; all others are of the kind `place`."""


def kind_of(cause: str) -> str:
    """Return the kind of a cause: device, item, mission or place."""
    found = (kind for kind, patterns in KINDS.items() if any(matches(each, cause) for each in patterns))
    return next(found, "place")


def fitted_rate(cause: str, *, doubtful: bool, truth: bool) -> float | None:
    """Return the share of right ones among such causes; None without enough situations.

    doubtful: a prediction does not hold, a rival is near, or the evidence itself leaves doubt.
    """
    right, number = FITTED.get((kind_of(cause), doubtful, truth), (0, 0))
    return right / number if number >= MIN_CASES else None


def stated(rate: float | None) -> Confidence:
    """Return the word for a rate."""
    return "likely" if rate is not None and rate >= LIKELY_RATE else "possible"
