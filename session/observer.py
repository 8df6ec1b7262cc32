"""Whoever looks on while a mission runs."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from ..logs.run_result import RunResult
from ..trees.running.runner import NodeInfo, TickReport


class Watcher(Protocol):
    """Whoever looks on; nothing that it does changes the run."""

    def started(self, structure: tuple[NodeInfo, ...], folder: Path) -> None: ...
    def ticked(self, now: float, report: TickReport, items_done: int, items_total: int) -> None: ...
    def edited(self, structure: tuple[NodeInfo, ...]) -> None:
        """From the next tick on the tree is that of an edited mission."""
        ...

    def told(self, now: float, text: str) -> None:
        """Something that is no part of the run, as that an edit is refused."""
        ...

    def finished(self, result: RunResult) -> None: ...
