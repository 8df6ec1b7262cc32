"""A Rerun recording being written: what is so always, at a time, or as a column over many times."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

TIMELINE = "sim_time"
"""Simulated seconds."""


class Sheet:
    """Everything goes straight to the file. Raises OSError when the disk refuses to open it."""

    def __init__(self, path: Path, name: str, blueprint: rrb.Blueprint) -> None:
        path.open("wb").close()  # the library's own error says nothing of the reason
        self._recording = rr.RecordingStream("picktree", recording_id=name, send_properties=False)
        self._recording.set_log_time_enabled(False)
        self._recording.set_log_tick_enabled(False)
        self._recording.save(path, default_blueprint=blueprint)
        self._recording.send_recording_name(name)

    def always(self, entity: str, *what: rr.AsComponents) -> None:
        for one in what:
            self._recording.log(entity, one, static=True)

    def at(self, time: float, entity: str, what: rr.AsComponents) -> None:
        self._recording.set_time(TIMELINE, duration=time)
        self._recording.log(entity, what)

    def column(self, entity: str, times: Sequence[float], columns: Iterable[rr.ComponentColumn]) -> None:
        if times:
            self._recording.send_columns(
                entity, indexes=[rr.TimeColumn(TIMELINE, duration=times)], columns=columns
            )

    def close(self) -> None:
        self._recording.flush()
        self._recording.disconnect()
