"""Files made of a run by commands, explanation and report, kept while its log stays the same."""

from __future__ import annotations

import asyncio
import hashlib
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from ... import __version__
from ...files.errors import PicktreeError
from ...logs.recording.rotated_log import part_paths
from .command_answer import command_answer

MAX_KEPT: Final = 400_000_000
"""Size of all kept files, bytes. Beyond it those that were used longest ago are deleted."""
PATIENCE: Final = 900.0
"""Longest time that a command may take, wall s."""
_AT_ONCE: Final = 2
"""Number of commands that make such files at once."""


class MadeFiles:
    """Folder of made files, by what they were made from. It may be deleted at any time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._making: dict[Path, asyncio.Task[None]] = {}
        self._slots = asyncio.Semaphore(_AT_ONCE)

    def place(self, log: Path, kind: str) -> Path:
        """Return where the file of a kind (`report.html`, `explain.json`) of a log is, as the log is now.

        Raises PicktreeError when the log is gone.
        """
        try:
            stamps = [path.stat() for path in (log, *part_paths(log).values())]
        except OSError as error:
            raise PicktreeError(f"{log} cannot be read: {(error.strerror or str(error)).lower()}") from None
        parts = [__version__, str(log), *(f"{each.st_size} {each.st_mtime_ns}" for each in stamps)]
        name = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]
        return self._folder / f"{name}-{kind}"

    async def made(self, log: Path, kind: str, command: Sequence[str]) -> Path:
        """Return the file, made by a command of picktree when it is not there. `{}` in it is the file.

        A command that writes to stdout, and names no `{}`, has its stdout put into the file. Raises
        PicktreeError with what the command said when it failed.
        """
        place = self.place(log, kind)
        if not place.exists():
            task = self._making.get(place)
            if task is None:
                task = asyncio.get_running_loop().create_task(self._make(place, command))
                self._making[place] = task
                task.add_done_callback(lambda _: self._making.pop(place, None))
            await asyncio.shield(task)
        with suppress(OSError):
            os.utime(place)
        return place

    async def _make(self, place: Path, command: Sequence[str]) -> None:
        self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        beside = place.with_name(f"making-{os.getpid()}-{place.name}")
        words = [word.replace("{}", str(beside)) for word in command]
        try:
            async with self._slots:
                out = await command_answer(words, PATIENCE)
        except PicktreeError:
            beside.unlink(missing_ok=True)
            raise
        if words == list(command):
            beside.write_bytes(out)
        beside.replace(place)
        self._delete_old()

    def _delete_old(self) -> None:
        files = [(file, file.stat()) for file in self._folder.iterdir()]
        files.sort(key=lambda each: each[1].st_mtime, reverse=True)
        total = 0
        for file, stamp in files:
            total += stamp.st_size
            if total > MAX_KEPT:
                file.unlink(missing_ok=True)

    async def close(self) -> None:
        """Stop what is being made."""
        tasks = list(self._making.values())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
