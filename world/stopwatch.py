"""Wall time by part of the work: for the record and the reader's curiosity only, never for a decision."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager


class Stopwatch:
    """Adds up wall seconds by name. Parts may nest: the inner one's time is not counted for the outer."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}
        self._running: list[str] = []
        self._since = 0.0

    @contextmanager
    def measure(self, part: str) -> Generator[None]:
        """Count the time in here for `part`."""
        self._switch()
        self._running.append(part)
        try:
            yield
        finally:
            self._switch()
            self._running.pop()

    def move(self, seconds: float, part: str) -> None:
        """Count that many seconds of the part now measured for `part` instead. This suits short and
        frequent work, such as a physics step."""
        self._seconds[part] = self._seconds.get(part, 0.0) + seconds
        if self._running:
            self._since += seconds

    def seconds(self) -> Mapping[str, float]:
        """Wall seconds so far, by part; a copy."""
        return dict(self._seconds)

    def _switch(self) -> None:
        now = time.perf_counter()
        if self._running:
            part = self._running[-1]
            self._seconds[part] = self._seconds.get(part, 0.0) + now - self._since
        self._since = now
