"""RunRecord: one run, read from its log."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Self

from ..errors import PicktreeError
from .run_log import At, RunLog
from .run_result import RunResult
from .schema import topics
from .schema.records import Event, RunInfo, Tree


class RunRecord:
    """One run, read from its log: also a run that was cut off.

    `where` is a log file, a run's folder, or `last`. Times are simulated seconds. Everything is read on the
    first request, and then kept. Use it as a context manager, or `close` it.

    Raises PicktreeError when `where` is no log, or the file is damaged.
    """

    def __init__(self, where: str | Path) -> None:
        self.log = RunLog(where)
        """The file below, record by record."""
        self.path = self.log.path
        self.recovered = self.log.recovered
        """A sentence when the file had not been finished, else empty."""
        self.info: RunInfo = self.log.run
        """What the run was started with: mission, scene, seed, parameters, versions."""

    def close(self) -> None:
        self.log.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def end(self) -> float:
        """Time of the last message."""
        return self.log.end

    @cached_property
    def result(self) -> RunResult | None:
        """Result of the run; None when it was killed, or ended by a fault."""
        words = self.log.result
        return RunResult.from_json_text(words["json"], self.path) if "json" in words else None

    @cached_property
    def trees(self) -> tuple[At[Tree], ...]:
        """Trees with the time of their first tick; several when the mission was edited under the run."""
        return tuple(self.log.trees())

    def tree_at(self, time: float) -> Tree:
        """Return the tree that was ticked at `time`."""
        trees = self.trees
        if not trees:
            raise PicktreeError(f"{self.path}: the log has no message on {topics.TREE.name}")
        return next((at.record for at in reversed(trees) if at.time <= time + 1e-9), trees[0].record)

    @cached_property
    def events(self) -> tuple[At[Event], ...]:
        """Journal entries: `item_done`, `pick`, `fault`, `recovery`, `belief`, `checkpoint`, …"""
        return tuple(self.log.events())
