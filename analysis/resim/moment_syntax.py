"""A moment of a run as people type it: the number of a tick, or a time."""

from __future__ import annotations

import re
from typing import Final

from ...errors import PicktreeError
from ..run import Run

_TIME: Final = re.compile(r"(\d+(?:\.\d*)?|\.\d+)\s*(s|ms|min)")
_UNITS: Final = {"s": 1.0, "ms": 1e-3, "min": 60.0}


def parse_tick(text: str, run: Run, option: str) -> int:
    """`412` is the tick of that number, `20.6 s` the last tick at that simulated time or before.

    `option` names it in errors. Raises PicktreeError for anything else, and beyond the end of the log.
    """
    times = run.ticks.times
    if not times:
        raise PicktreeError(f"{run.path}: the log holds no tick")
    written = text.strip()
    over = f"{option} {written}: the log ends with tick {len(times) - 1}, at {times[-1]:.2f} s"
    if written.isdecimal():
        if int(written) >= len(times):
            raise PicktreeError(over)
        return int(written)
    match = _TIME.fullmatch(written)
    if match is None:
        raise PicktreeError(f"{option} {written}: write the number of a tick, as 412, or a time, as 20.6s")
    seconds = float(match[1]) * _UNITS[match[2]]
    if seconds > times[-1] + 1e-6:
        raise PicktreeError(over)
    if seconds < times[0] - 1e-6:
        raise PicktreeError(f"{option} {written}: the log begins at {times[0]:.2f} s")
    return run.ticks.number_at(seconds)
