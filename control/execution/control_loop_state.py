"""State of the control loop for checkpoints."""

from __future__ import annotations

from dataclasses import dataclass

from ...world.values import Wrench
from ..safety.safety_monitor import MonitorState


@dataclass(frozen=True, slots=True)
class ControlLoopState:
    """State of the control loop at rest, for checkpoints."""

    hold: tuple[float, ...]
    """Commanded configuration (n,), rad."""
    readings: tuple[Wrench, ...]
    tare: tuple[float, ...]
    standing: int
    periods: int
    carried: tuple[float, ...]
    monitor: MonitorState
    stamps: tuple[float, ...] = ()
    """Times of the readings, s; empty in older logs."""
    bias: tuple[float, ...] = ()
    """Learnt bias (6,) of the wrist sensor, N and Nm, TCP axes; empty: none was learnt."""
    noisy: bool = False
    """Whether the wrist sensor is known to be noisy: it never repeats a reading."""
    doubts_wrist: bool = False
    """Whether the joints' efforts contradict the wrist reading."""
