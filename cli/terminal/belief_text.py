"""Line of text for a believed object, of a running mission or of a log."""

from __future__ import annotations

from typing import Protocol

from ...world.values import Pose


class BelievedLike(Protocol):
    @property
    def id(self) -> str: ...
    @property
    def kind(self) -> str: ...
    @property
    def colour(self) -> str: ...
    @property
    def role(self) -> str: ...
    @property
    def place(self) -> str: ...
    @property
    def attached(self) -> bool: ...
    @property
    def pose(self) -> Pose: ...
    @property
    def last_seen(self) -> float: ...
    @property
    def confidence(self) -> float: ...


def belief_line(o: BelievedLike, now: float) -> str:
    """Return the line; `now`: simulated time, s."""
    x, y, z = o.pose.position
    place = "in the hand" if o.attached else o.place or "somewhere"
    seen = f"seen {now - o.last_seen:.1f} s ago, confidence {o.confidence:.2f}"
    return f"{o.id}: {o.colour} {o.kind}, {o.role}, {place}, at ({x:.3f}, {y:.3f}, {z:.3f}) m, {seen}"
