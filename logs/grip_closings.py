"""Closings of the fingers, as a run tells them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from .run_log import At
from .schema.records import Event


@dataclass(frozen=True, slots=True)
class Pick:
    """One closing of the fingers on an object, as the robot felt it."""

    time: float
    """Simulated s."""
    object: str
    """Id of the believed object."""
    held: bool
    node: str
    """Path of the node that closed them."""
    candidate: str = ""
    """The grasp that was chosen."""
    width: float = float("nan")
    """Opening after closing, m."""
    load: float = float("nan")
    """Weight at the wrist after lifting, N."""


def picks_of(events: Iterable[At[Event]]) -> tuple[Pick, ...]:
    """Those among the events of a run."""
    return tuple(_pick(at) for at in events if at.record.kind == "pick")


def _pick(at: At[Event]) -> Pick:
    data = at.record.data
    width, load = (
        float(value) if isinstance(value := data.get(name), (int, float)) else float("nan")
        for name in ("width", "load")
    )
    return Pick(
        at.time,
        str(data["object"]),
        bool(data["held"]),
        at.record.node,
        str(data.get("candidate", "")),
        width,
        load,
    )
