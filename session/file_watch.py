"""Noticing that files of a mission were edited while it runs."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Protocol

PERIOD = 0.25
"""Wall seconds between two looks at the files."""
_SETTLED = 1_000_000_000
"""Age of a file, ns, from which an unchanged stamp means an unchanged content."""


class Edits(Protocol):
    """Where a watched run hears of edits; it asks at every tick."""

    def watch(self, files: Iterable[Path]) -> None:
        """From now on these files, as they are now; some may not be there."""
        ...

    def found(self) -> bool:
        """Whether one of them is another than when they were last watched, or found to be edited."""
        ...


class FileEdits:
    """Looks at the files on the disk, a few times a second of the wall clock.

    An edit counts when two looks have seen the same: an editor that is still writing is not interrupted.
    """

    def __init__(self, period: float = PERIOD, wall: Callable[[], float] = time.monotonic) -> None:
        self._period, self._wall = period, wall
        self._files: tuple[Path, ...] = ()
        self._known: dict[Path, str] = {}
        self._seen: dict[Path, str] | None = None
        self._looked_at = -period
        self._stamps: dict[Path, tuple[tuple[int, int, int], str]] = {}

    def watch(self, files: Iterable[Path]) -> None:
        self._files = tuple(dict.fromkeys(files))
        self._known, self._seen = self._look(), None

    def found(self) -> bool:
        now = self._wall()
        if now - self._looked_at < self._period:
            return False
        self._looked_at = now
        seen = self._look()
        if seen == self._known or seen != self._seen:
            self._seen = seen
            return False
        self._known, self._seen = seen, None
        return True

    def _look(self) -> dict[Path, str]:
        return {file: self._fingerprint(file) for file in self._files}

    def _fingerprint(self, file: Path) -> str:
        """Of the content; empty when it cannot be read. The content is read when the file's stamp is new."""
        try:
            stat = file.stat()
            stamp = (stat.st_mtime_ns, stat.st_size, stat.st_ino)
            known = self._stamps.get(file)
            if known is not None and known[0] == stamp:
                return known[1]
            fingerprint = hashlib.sha256(file.read_bytes()).hexdigest()
        except (OSError, ValueError):
            self._stamps.pop(file, None)
            return ""
        if abs(time.time_ns() - stat.st_mtime_ns) > _SETTLED:
            self._stamps[file] = (stamp, fingerprint)
        return fingerprint
