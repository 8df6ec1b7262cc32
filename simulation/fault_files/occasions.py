"""When something goes wrong: at a time, or as a node starts; once or again and again; surely or by chance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True, slots=True)
class AtTime:
    """At this simulated time, s; with `every` again each time so many seconds have passed."""

    time: float
    every: float | None = None
    probability: float = 1.0
    """That it happens at all, at each of its occasions; drawn from a stream of its own."""


@dataclass(frozen=True, slots=True)
class AtNode:
    """`delay` s after the node that fits `pattern` has started for the `start`-th time (from 1); with `each`
    at every start from that one on."""

    pattern: str
    start: int = 1
    delay: float = 0.0
    each: bool = False
    probability: float = 1.0
    """That it happens at all, at each of its occasions; drawn from a stream of its own."""


When: TypeAlias = AtTime | AtNode
