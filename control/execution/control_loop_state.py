"""State of the control loop for checkpoints."""

from __future__ import annotations

from dataclasses import dataclass

from ...world.values import Wrench
from ..safety.safety_monitor import MonitorState


@dataclass(frozen=True, slots=True)
class ControlLoopState:
    """The loop at a quiescent moment, for checkpoints."""

    hold: tuple[float, ...]
    """Commanded configuration, rad."""
    readings: tuple[Wrench, ...]
    tare: tuple[float, ...]
    standing: int
    periods: int
    carried: tuple[float, ...]
    monitor: MonitorState
    stamps: tuple[float, ...] = ()
    """Times of the readings, s; empty in older logs."""
    bias: tuple[float, ...] = ()
    """Of the wrist sensor as it was learnt, (6,), in the tool's axes; empty when it was not."""
    noisy: bool = False
    """Whether the wrist sensor is known never to say the same twice."""
    doubts_wrist: bool = False
    """Whether the joints' efforts speak against what the wrist says."""
