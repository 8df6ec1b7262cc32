"""The scene in motion: the robot, what is believed and what is true, for the panel that shows it in 3-D."""

from __future__ import annotations

from ..run import Run
from .packing import Section


def pack_stage(run: Run) -> Section:
    return Section("stage", {"objects": len(run.ticks)})
