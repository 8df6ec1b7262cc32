"""Run index: one row for each run below a folder, from the logs' summaries; filters and deletion of runs.

Rows are kept in the disk cache by the size and time of their logs, so that a second look at many runs opens
the new logs only.
"""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from picktree.files import (
    FLOAT,
    INT,
    TEXT,
    Expression,
    PicktreeError,
    ValueType,
    check_types,
    disk_cache,
    expression_syntax,
    file_system,
    list_of,
)
from picktree.logs.mcap import is_written

from .episode_counts import by_cause
from .log_files import LOG_NAME, part_paths
from .operator_figures import duration_text
from .run_log import RunLog
from .run_result import RunResult

STATUSES: Final = (
    "success", "incomplete", "failure", "timeout", "paused", "interrupted", "stopped", "running", "killed",
    "unknown", "unreadable",
)  # fmt: skip
"""Statuses of a row. The first seven are those of a result; a log without one is `running` or `killed`, or
`unknown` when another program has left out its result."""

COLUMNS: Final[Mapping[str, tuple[ValueType, str]]] = {
    "status": (ValueType("text", choices=STATUSES), f"one of {', '.join(STATUSES)}"),
    "mission": (TEXT, "name of the mission"),
    "scene": (TEXT, "name of the scene"),
    "robot": (TEXT, "name of the robot"),
    "backend": (TEXT, "physics, kinematic or robot"),
    "seed": (INT, "seed of everything random"),
    "sorted": (INT, "number of items at their destination"),
    "total": (INT, "number of items with a destination"),
    "misplaced": (INT, "number of items at a wrong place"),
    "held": (INT, "number of grasps that held the item"),
    "seconds": (FLOAT, "simulated time, s"),
    "units_an_hour": (FLOAT, "items at their destination in a simulated hour"),
    "first_pass": (FLOAT, "first-pass yield, 0 … 1"),
    "mtbf": (FLOAT, "mean time between failures, simulated s; absent without a failure"),
    "mtbf_a": (FLOAT, "mean time between failures or assists, simulated s; absent without both"),
    "assists": (INT, "number of actions of a person"),
    "lost": (FLOAT, "simulated time lost by failures, s"),
    "cause": (
        TEXT,
        "cause of the failures that lost most time, outcome done_instead left out; empty without failures",
    ),
    "causes": (list_of(TEXT), "all causes of failures, the one that lost most time first"),
    "age": (FLOAT, "time since the last write to the log, days"),
    "folder": (TEXT, "path of the run's folder or log, relative to the listed folder"),
}
"""Names of a filter, with their types and meanings."""

_DAY: Final = 86400.0
_RUN_FOLDER_NAME: Final = re.compile(r".+-\d+-\d{8}-\d{6}(-\d+)?")
"""Name of a folder that a session has made: mission, seed, date and time."""
_LATER_PART: Final = re.compile(r"(.+)-\d{4,}")


@dataclass(frozen=True, slots=True)
class RunRow:
    """Row of one run. None: the log has no result, or lacks the value."""

    folder: str
    """Path of the run's folder, or of a log that is not alone in its folder, below the listed folder."""
    log: str
    """Path of the log below the listed folder."""
    written: float
    """Time of the last write to the log, s since 1970."""
    size: int
    """Size of the log in all its files, bytes."""
    status: str
    mission: str = ""
    scene: str = ""
    robot: str = ""
    backend: str = ""
    seed: int | None = None
    sorted: int | None = None
    total: int | None = None
    misplaced: int | None = None
    held: int | None = None
    seconds: float | None = None
    units_an_hour: float | None = None
    first_pass: float | None = None
    mtbf: float | None = None
    mtbf_a: float | None = None
    assists: int | None = None
    lost: float | None = None
    cause: str = ""
    causes: tuple[str, ...] = ()
    message: str = ""
    """Sentence on why the tree failed, or why the log cannot be read."""

    def to_json(self) -> dict[str, object]:
        return asdict(self)

    def names(self, now: float, wanted: Iterable[str] = COLUMNS) -> dict[str, object]:
        """Return the values of columns for a filter; `now`: s since 1970."""
        return {
            name: (now - self.written) / _DAY if name == "age" else getattr(self, name) for name in wanted
        }


@dataclass(frozen=True, slots=True)
class RunFilter:
    """Condition on rows, in the expression language of missions with the names of `COLUMNS`."""

    expression: Expression

    @classmethod
    def parse(cls, text: str) -> RunFilter:
        """Parse a filter. Raises PicktreeError for an unknown name, a wrong type or bad syntax."""
        try:
            expression = Expression.parse(text)
            check_types(expression, {name: kind for name, (kind, _) in COLUMNS.items()}, {})
        except expression_syntax.ExpressionError as error:
            raise PicktreeError(f"--where {text!r}: {error}, at character {error.offset + 1}") from None
        return cls(expression)

    def __call__(self, row: RunRow, now: float | None = None) -> bool:
        """Whether the row meets the condition. A comparison with a value that the row lacks is not met."""
        now = time.time() if now is None else now
        try:
            return bool(self.expression.evaluate(row.names(now, self.expression.names)))
        except expression_syntax.ExpressionError:  # types are checked: the value is null
            return False


class RunIndex:
    """Index of the runs below a folder. It remembers rows of logs that have not changed since."""

    def __init__(self, folder: Path) -> None:
        """Take a folder of runs, or one above it. Raises PicktreeError when it is no folder."""
        if not folder.is_dir():
            raise PicktreeError(f"{folder}: no such folder; `picktree runs` lists the runs below a folder")
        self.folder = folder
        self._known: dict[str, RunRow] | None = None

    def rows(self) -> Iterator[RunRow]:
        """Yield the present row of each run, the run written last first."""
        before = self._cached() if self._known is None else self._known
        self._known = known = dict[str, RunRow]()
        fresh = 0
        try:
            for log, (written, size) in _found(self.folder):
                row = before.get(log)
                if row is None or (row.written, row.size) != (written, size) or row.status == "running":
                    row = self._row(log, written, size, row)
                    fresh += 1
                known[row.log] = row
                yield row
        finally:
            for log, row in before.items() if len(known) < len(before) else ():
                if (self.folder / log).exists():  # the caller has seen enough
                    known.setdefault(log, row)
            if fresh or len(known) != len(before):
                self._keep()

    def select(self, where: RunFilter | None) -> Iterator[RunRow]:
        """Yield the rows that meet the condition; None: all."""
        now = time.time()
        return (row for row in self.rows() if where is None or where(row, now))

    def row(self, log: str) -> RunRow:
        """Return the present row of one log. Raises PicktreeError when it is gone."""
        paths = (self.folder / log, *part_paths(self.folder / log).values())
        try:
            stamps = [path.stat() for path in paths]
        except OSError as error:
            raise PicktreeError(
                f"{paths[0]} cannot be read: {(error.strerror or str(error)).lower()}"
            ) from None
        return self._row(
            log, max(each.st_mtime for each in stamps), sum(each.st_size for each in stamps), None
        )

    def delete(self, row: RunRow) -> None:
        """Delete a run: its folder, or a log with its further files when other things are there, too.

        Other things are there in a folder that no run has made. Raises PicktreeError for a run in progress or
        of a batch, and when the disk refuses.
        """
        log = self.folder / row.log
        if is_written(log):
            raise PicktreeError(f"{log.parent}: the run is in progress; halt it first")
        batch = next((up for up in log.parents if (up / "results.sqlite").exists()), None)
        if batch is not None:
            raise PicktreeError(f"{log.parent}: the run belongs to the batch {batch}, whose results name it")
        try:
            if row.folder != row.log and _RUN_FOLDER_NAME.fullmatch(log.parent.name):
                shutil.rmtree(log.parent)
                return
            for path in (log, *part_paths(log).values()):
                path.unlink()
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise PicktreeError(f"{log} cannot be deleted: {reason}") from None

    def _row(self, log: str, written: float, size: int, before: RunRow | None) -> RunRow:
        """Return the row of a log. During the run, values that were read once stay."""
        if not file_system.is_utf8(log):
            message = f"{file_system.shown(log)}: the name is not UTF-8; rename it"
            return RunRow(
                file_system.shown(Path(log).parent),
                file_system.shown(log),
                written,
                size,
                "unreadable",
                message=message,
            )
        path = self.folder / log
        in_progress = is_written(path)
        if in_progress and before is not None and before.status == "running":
            return replace(before, written=written, size=size)
        where = str(Path(log).parent) if path.name == LOG_NAME and log != LOG_NAME else log
        row = RunRow(where, log, written, size, "running" if in_progress else "killed")
        try:
            with RunLog(path) as read:
                return _filled(row, read)
        except PicktreeError as error:
            return replace(row, message=str(error)) if in_progress else replace(
                row, status="unreadable", message=str(error)
            )  # fmt: skip

    @property
    def _key(self) -> tuple[str, ...]:
        return (str(self.folder.resolve()),)

    @property
    def _makers(self) -> tuple[Path, ...]:
        here = Path(__file__).parent
        names = ("run_index", "run_result", "episode_counts", "operator_figures", "rates")
        return tuple(here / f"{name}.py" for name in names)

    def _cached(self) -> dict[str, RunRow]:
        data = disk_cache.kept("runs", self._key, self._makers)
        try:
            rows = [] if data is None else _ROWS.validate_json(data)
        except ValidationError:
            rows = []
        return {row.log: row for row in rows}

    def _keep(self) -> None:
        data = _ROWS.dump_json(list((self._known or {}).values()))
        disk_cache.keep("runs", self._key, self._makers, data)


_ROWS: Final = TypeAdapter(list[RunRow])


def logs_below(folder: Path) -> tuple[Path, ...]:
    """Return the logs in a folder and those below it, further files of rotated logs left out."""
    return tuple(sorted(folder / log for log, _ in _found(folder)))


def _found(folder: Path) -> list[tuple[str, tuple[float, int]]]:
    """Return the logs below a folder with the time of their last write (s) and their size, newest first.

    Links are not followed, and pipes and devices are left out.
    """
    found: list[tuple[str, tuple[float, int]]] = []
    todo = [(os.fspath(folder), "")]
    while todo:
        place, prefix = todo.pop()
        logs: dict[str, tuple[float, int]] = {}
        with suppress(OSError), os.scandir(place) as entries:  # gone, or not ours to read
            for entry in entries:
                with suppress(OSError):
                    if entry.is_dir(follow_symlinks=False):
                        todo.append((entry.path, f"{prefix}{entry.name}/"))
                    elif entry.name.endswith(".mcap") and entry.is_file(follow_symlinks=False):
                        state = entry.stat()
                        logs[entry.name[:-5]] = (state.st_mtime, state.st_size)
        found += [(f"{prefix}{name}.mcap", stamp) for name, stamp in _joined(logs).items()]
    return sorted(found, key=lambda each: (-each[1][0], each[0]))


def _joined(logs: Mapping[str, tuple[float, int]]) -> dict[str, tuple[float, int]]:
    """Return the logs of a folder, with a rotated log's further files counted to its first."""
    joined = dict(logs)
    for name in logs:
        part = _LATER_PART.fullmatch(name)
        if part is not None and part[1] in logs:
            written, size = joined.pop(name)
            first = joined[part[1]]
            joined[part[1]] = (max(first[0], written), first[1] + size)
    return joined


def _filled(row: RunRow, log: RunLog) -> RunRow:
    """Return the row with the log's values of its run and its result. Raises PicktreeError."""
    run = log.run
    row = replace(
        row, mission=run.mission, scene=run.scene, robot=run.robot, backend=run.backend, seed=run.seed
    )
    text = log.result.get("json")
    if text is None:
        row = replace(row, status="unknown") if row.status == "killed" and log.lacks_result else row
        return replace(row, seconds=None if row.status == "running" else round(log.end, 3))
    result = RunResult.from_json_text(text, log.path)
    causes = _causes(result)
    instead = {each.cause for each in by_cause(result.cures or ()) if not each.total.to_cure}
    return replace(
        row,
        status=result.status,
        sorted=result.items.sorted,
        total=result.items.total,
        misplaced=result.items.misplaced,
        held=result.picks.held,
        seconds=round(result.sim_seconds, 3),
        lost=None if result.cures is None else round(sum(each.seconds for each in result.cures), 3),
        causes=causes,
        cause=next((cause for cause in causes if cause not in instead), ""),
        message=result.message,
        **_figures(result),
    )


def _figures(result: RunResult) -> dict[str, Any]:
    figures = result.operator_figures
    if figures is None:
        return {}
    values = {
        "units_an_hour": figures.units_an_hour.value,
        "first_pass": figures.first_pass_yield.share,
        "mtbf": figures.mtbf.value,
        "mtbf_a": figures.mtbf_a.value,
    }
    rounded = {name: None if value is None else round(value, 3) for name, value in values.items()}
    return {**rounded, "assists": figures.total.assisted}


def _causes(result: RunResult) -> tuple[str, ...]:
    lost = (each.cause for each in by_cause(result.cures or ()))
    often = sorted(result.failures, key=lambda cause: (-result.failures[cause], cause))
    return tuple(dict.fromkeys((*lost, *often)))


_HEADS: Final = (
    "written",
    "status",
    "sorted",
    "units/h",
    "MTBF",
    "lost s",
    "seed",
    "mission",
    "cause",
    "folder",
)
_WIDTHS: Final = (16, 11, 9, 7, 8, 8, 6, 22, 24, 0)


def heading() -> str:
    """Return the heading of `line`."""
    return _columns(_HEADS)


def line(row: RunRow) -> str:
    """Return a row as a line for a terminal."""
    when = time.strftime("%Y-%m-%d %H:%M", time.localtime(row.written))
    done = "" if row.sorted is None else f"{row.sorted} of {row.total}"
    lost = "" if row.lost is None else f"{row.lost:.1f}"
    seed = "" if row.seed is None else str(row.seed)
    hourly = "" if row.units_an_hour is None else f"{row.units_an_hour:.0f}"
    between = "" if row.mtbf is None else duration_text(row.mtbf)
    return _columns((when, row.status, done, hourly, between, lost, seed, row.mission, row.cause, row.folder))


def _columns(cells: Iterable[str]) -> str:
    numbers = ("units/h", "MTBF", "lost s", "seed")
    padded = (
        f"{cell:>{width}}" if head in numbers else f"{cell:<{width}}"
        for cell, width, head in zip(cells, _WIDTHS, _HEADS, strict=True)
    )
    return "  ".join(padded).rstrip()
