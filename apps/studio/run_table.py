"""Table of all runs of the folder, kept up to date while somebody looks: filtered, sorted, in windows."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ...files.errors import PicktreeError
from ...logs.log_paths import RUNS_FOLDER
from ...logs.run_index import RunFilter, RunIndex, RunRow
from .workspace import Workspace

SORTS: Final[Mapping[str, Callable[[RunRow], Any]]] = {
    "written": lambda row: row.written,
    "status": lambda row: row.status,
    "mission": lambda row: row.mission.lower() or None,
    "scene": lambda row: row.scene.lower() or None,
    "seed": lambda row: row.seed,
    "sorted": lambda row: None if row.sorted is None or not row.total else row.sorted / row.total,
    "lost": lambda row: row.lost,
    "seconds": lambda row: row.seconds,
    "cause": lambda row: row.cause or None,
    "folder": lambda row: row.folder,
}
"""Columns to sort by; rows without a value come last."""

_FIRST_SHOWN: Final = 0.2
"""Interval at which a first look at many runs is shown while it goes on, wall s. It grows by a tenth."""
_MIN_PERIOD: Final = 1.0
_SHARE: Final = 20
"""Wall time between two looks, as a multiple of the time that a look takes."""


@dataclass(frozen=True, slots=True)
class Query:
    """Question to the table. `where`: condition as of `picktree runs --where`; `text`: words to be found."""

    where: str = ""
    text: str = ""
    sort: str = "written"
    descending: bool = True


@dataclass(frozen=True, slots=True)
class Snapshot:
    """State of the table at one moment."""

    version: int
    rows: tuple[RunRow, ...]
    complete: bool
    """Whether all logs have been looked at once."""


class RunTable:
    """Rows of all runs. `look` is repeated while there are watchers."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._index: RunIndex | None = None
        self._lock = threading.Lock()
        self.snapshot = Snapshot(0, (), False)
        self._words: dict[int, tuple[RunRow, str]] = {}
        self._answers: dict[Query, tuple[int, tuple[RunRow, ...]]] = {}
        self._watchers = 0
        self._looking: asyncio.Task[None] | None = None
        self.problem = ""
        """Sentence on why the runs cannot be listed; empty when they can."""

    @property
    def folder(self) -> Path:
        """Folder whose runs are listed: `runs` below the studio's folder, or that folder without one."""
        below = self._workspace.root / RUNS_FOLDER
        if below.is_symlink() or below.is_dir():
            return self._workspace.resolve(str(RUNS_FOLDER))
        return self._workspace.root

    def run_id(self, row: RunRow) -> str:
        """Return the identity of a run in the page: its path below the studio's folder."""
        index = self._index
        return row.folder if index is None else self._workspace.relative(index.folder / row.folder)

    def enter(self) -> None:
        """Count a watcher; with the first one, begin to look."""
        self._watchers += 1
        if self._looking is None or self._looking.done():
            self._looking = asyncio.get_running_loop().create_task(self._look_again())

    def leave(self) -> None:
        """Count a watcher less."""
        self._watchers -= 1

    async def close(self) -> None:
        """Stop looking."""
        if self._looking is not None:
            self._looking.cancel()
            with suppress(asyncio.CancelledError):
                await self._looking

    async def _look_again(self) -> None:
        while self._watchers:
            began = time.monotonic()
            await asyncio.to_thread(self.look)
            spent = time.monotonic() - began
            await asyncio.sleep(max(_MIN_PERIOD, _SHARE * spent))

    def look(self) -> None:
        """Look at all runs once. While the first look goes on, the rows found so far are shown."""
        with self._lock:
            try:
                folder = self.folder
                if self._index is None or self._index.folder != folder:
                    self._index = RunIndex(folder)
            except PicktreeError as error:
                self.problem = str(error)
                self._show((), complete=True)
                return
            self.problem = ""
            rows: list[RunRow] = []
            shown = time.monotonic()
            pause = _FIRST_SHOWN
            for row in self._index.rows():
                if not rows:  # what is in the cache has been read by now
                    shown = time.monotonic()
                rows.append(row)
                self._text(row)
                if not self.snapshot.complete and time.monotonic() - shown > pause:
                    shown, pause = time.monotonic(), 1.1 * pause
                    self._show(tuple(rows), complete=False)
            self._show(tuple(rows), complete=True)

    def _show(self, rows: tuple[RunRow, ...], *, complete: bool) -> None:
        before = self.snapshot
        if rows != before.rows or complete != before.complete:
            self.snapshot = Snapshot(before.version + 1, rows, complete)

    def select(self, query: Query) -> tuple[RunRow, ...]:
        """Return the rows that a query finds, sorted. Raises PicktreeError for a bad condition or column."""
        snapshot = self.snapshot
        found = self._answers.get(query)
        if found is not None and found[0] == snapshot.version:
            return found[1]
        if query.sort not in SORTS:
            raise PicktreeError(f"there is no column {query.sort!r}; sort by {', '.join(SORTS)}")
        rows: Sequence[RunRow] = snapshot.rows
        words = query.text.lower().split()
        if words:
            rows = [row for row in rows if all(word in self._text(row) for word in words)]
        if query.where.strip():
            condition, now = RunFilter.parse(query.where), time.time()
            rows = [row for row in rows if condition(row, now)]
        key = SORTS[query.sort]
        keyed = [(key(row), row) for row in rows]
        known = sorted((each for each in keyed if each[0] is not None), key=_first, reverse=query.descending)
        answer = tuple(row for _, row in (*known, *(each for each in keyed if each[0] is None)))
        if len(self._answers) > 50:
            self._answers.clear()
        self._answers[query] = (snapshot.version, answer)
        return answer

    def _text(self, row: RunRow) -> str:
        known = self._words.get(id(row))
        if known is None or known[0] is not row:
            parts = (row.status, row.mission, row.scene, row.robot, row.backend, row.folder, *row.causes)
            known = (row, " ".join((*parts, f"seed {row.seed}")).lower())
            if len(self._words) > 4 * len(self.snapshot.rows) + 20_000:
                self._words.clear()
            self._words[id(row)] = known
        return known[1]


def _first(pair: tuple[Any, RunRow]) -> Any:
    return pair[0]
