"""Folder of a batch as the studio reads it: its plan, its progress, the jobs behind a figure, its process."""

from __future__ import annotations

import fcntl
import os
import signal
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias, cast

import orjson

from ...files.errors import PicktreeError
from .calls import JsonValue
from .workspace import Workspace

PLAN_FILE: Final = "plan.json"
RESULTS_FILE: Final = "results.sqlite"
LOCK_FILE: Final = "lock"
MAX_JOBS: Final = 2_000
"""Number of jobs that are shown one by one, the first ones of the plan."""
MAX_BATCHES: Final = 500

Behind: TypeAlias = Literal["all", "status", "cause", "root", "place", "form", "colour"]
_JOB: Final = (
    "jobs.job, jobs.number, variant, seed, status, items_sorted, items_total, sim_seconds, look_at, folder"
)
_CONDITIONS: Final[Mapping[Behind, str]] = {
    "all": "1",
    "status": "status = :value",
    "root": "root_cause = :value",
    "cause": "job IN (SELECT job FROM failures WHERE cause = :value)",
    "form": "job IN (SELECT job FROM items WHERE form = :value AND verdict IN ('left', 'misplaced'))",
    "colour": "job IN (SELECT job FROM items WHERE colour = :value AND verdict IN ('left', 'misplaced'))",
    "place": (
        "job IN (SELECT job FROM items WHERE verdict IN ('left', 'misplaced') "
        "AND x >= :x - 1e-9 AND x < :x + :side - 1e-9 AND y >= :y - 1e-9 AND y < :y + :side - 1e-9)"
    ),
}
CELL_SIDE: Final = 0.05
"""Side of a cell of the table in summaries, m."""


def batch_folders(workspace: Workspace) -> list[Path]:
    """Return the batches in the folder and in folders of it, such as `runs`; links are not followed."""
    found: list[Path] = []
    todo = [(workspace.root, 0)]
    while todo and len(found) < MAX_BATCHES:
        folder, depth = todo.pop()
        if (folder / PLAN_FILE).is_file():
            found.append(folder)
            continue
        with suppress(OSError), os.scandir(folder) as entries:
            below = [
                e
                for e in entries
                if depth < 2 and not e.name.startswith(".") and e.is_dir(follow_symlinks=False)
            ]
            todo += [(Path(entry.path), depth + 1) for entry in below]
    return found


class BatchFolder:
    """One batch. Nothing is written into its folder but by the commands that run it."""

    def __init__(self, place: Path) -> None:
        """Take a folder. Raises PicktreeError when it holds no batch."""
        self.place = place
        if not (place / PLAN_FILE).is_file():
            raise PicktreeError(f"{place.name} is no batch: there is no {PLAN_FILE} in it")

    def plan(self) -> Mapping[str, Any]:
        """Return the plan as it is recorded. Raises PicktreeError when it cannot be read."""
        try:
            plan: object = orjson.loads((self.place / PLAN_FILE).read_bytes())
        except (OSError, orjson.JSONDecodeError) as error:
            raise PicktreeError(f"{self.place.name}/{PLAN_FILE} cannot be read: {error}") from None
        if not isinstance(plan, dict):
            raise PicktreeError(f"{self.place.name}/{PLAN_FILE} is no plan of a batch")
        return cast("Mapping[str, Any]", plan)

    def stamp(self) -> tuple[object, ...]:
        """Return what changes when results are recorded, or the process begins or ends."""
        stamps: list[object] = [self.runner()]
        for name in (RESULTS_FILE, f"{RESULTS_FILE}-wal"):
            with suppress(OSError):
                stat = (self.place / name).stat()
                stamps += [stat.st_size, stat.st_mtime_ns]
        return tuple(stamps)

    def runner(self) -> int | None:
        """Return the number of the process that runs the batch; None when none does."""
        try:
            lock = os.open(self.place / LOCK_FILE, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        except OSError:
            return None
        try:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            with suppress(ValueError):
                return int(os.read(lock, 20) or b"0")
            return 0
        finally:
            os.close(lock)
        return None

    def stop(self, *, now: bool) -> None:
        """Let the running jobs finish, or (`now`) break them off. Raises PicktreeError when none runs it."""
        process = self.runner()
        if process is None:
            raise PicktreeError("no process runs this batch")
        if not _is_batch(process):
            raise PicktreeError("the process that runs this batch is ending")
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGTERM if now else signal.SIGINT)

    def progress(self) -> dict[str, JsonValue]:
        """Return counts by status, and the state of each job in the order of the plan."""
        plan = self.plan()
        counts = dict(self._rows("SELECT status, count(*) FROM jobs GROUP BY status"))
        total = sum(counts.values())
        done = total - counts.get("waiting", 0)
        jobs: list[JsonValue] = [
            {"number": number, "label": label, "seed": seed, "status": status}
            for number, label, seed, status in self._rows(
                f"SELECT number, variant, seed, status FROM jobs ORDER BY number LIMIT {MAX_JOBS}"
            )
        ]
        ((seconds,),) = self._rows("SELECT avg(cpu_seconds) FROM jobs WHERE status <> 'waiting'") or [(None,)]
        return {
            "name": plan.get("name", self.place.name),
            "backend": plan.get("backend"),
            "keep": plan.get("keep"),
            "running": self.runner() is not None,
            "total": total,
            "done": done,
            "success": counts.get("success", 0),
            "counts": counts,
            "jobs": jobs,
            "cpu_seconds_a_job": seconds,
        }

    def jobs_behind(self, what: Behind, value: str, label: str) -> list[dict[str, JsonValue]]:
        """Return the jobs that a figure counts; `label`: of one recipe, or of all (empty).

        Raises PicktreeError for a place that is none.
        """
        values: dict[str, object] = {"value": value, "label": label, "side": CELL_SIDE}
        if what == "place":
            try:
                values["x"], values["y"] = map(float, value.split())
            except ValueError:
                raise PicktreeError(f"{value!r} is no place of the table: two numbers, m") from None
        recipe = " AND variant = :label" if label else ""
        rows = self._rows(
            f"SELECT {_JOB} FROM jobs WHERE status <> 'waiting' AND {_CONDITIONS[what]}{recipe} "
            f"ORDER BY status = 'success', number LIMIT {MAX_JOBS}",
            values,
        )
        names = (
            "job",
            "number",
            "label",
            "seed",
            "status",
            "sorted",
            "items",
            "seconds",
            "look_at",
            "folder",
        )
        return [dict(zip(names, row, strict=True)) for row in rows]

    def _rows(self, sql: str, values: Mapping[str, object] | None = None) -> list[tuple[Any, ...]]:
        path = self.place / RESULTS_FILE
        if not path.is_file():
            return []  # it is being made
        try:
            with closing(sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True)) as connection:
                return list(connection.execute(sql, dict(values or {})))
        except sqlite3.Error as error:
            raise PicktreeError(f"{self.place.name}/{RESULTS_FILE} cannot be read: {error}") from None


def _is_batch(process: int) -> bool:
    """Whether a process is a command on batches, as far as the system tells."""
    try:
        words = Path(f"/proc/{process}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return process > 0 and not Path("/proc/self").exists()
    return b"batch" in words


def newest_first(folders: list[Path]) -> Iterator[BatchFolder]:
    """Yield the batches, the one that was written last first."""

    def written(folder: Path) -> float:
        with suppress(OSError):
            return (folder / RESULTS_FILE).stat().st_mtime
        return 0.0

    for folder in sorted(folders, key=written, reverse=True):
        with suppress(PicktreeError):
            yield BatchFolder(folder)
