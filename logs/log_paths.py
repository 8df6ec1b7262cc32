"""Paths of logs: the file that a LOG argument names."""

from __future__ import annotations

from pathlib import Path

from ..files.errors import PicktreeError
from ..files.file_names import require_utf8
from .recording.rotated_log import part_paths

LOG_NAME = "log.mcap"
RUNS_FOLDER = Path("runs")
BATCH_RESULTS = "results.sqlite"
"""File by which the folder of a batch is told."""


def find_log(where: str | Path) -> Path:
    """Return the log file that LOG names: a file, a run's folder, or `last` in ./runs. Raises
    PicktreeError."""
    if str(where) == "last":
        logs = sorted(RUNS_FOLDER.glob(f"*/{LOG_NAME}"), key=lambda p: (_last_write_time(p), str(p)))
        if not logs:
            raise PicktreeError(
                f"there is no run in {RUNS_FOLDER.absolute()} yet; `picktree run MISSION` makes one"
            )
        return logs[-1]
    path = Path(where)
    require_utf8(path.absolute())
    if path.is_dir():
        inside = path / LOG_NAME
        if inside.is_file():
            return inside
        others = sorted(path.glob("*.mcap"))
        if len(others) == 1:
            return others[0]
        parts = [part.name for part in part_paths(inside).values()]
        there = f"; it holds {', '.join(parts)}, which open by their own names" if parts else ""
        if any(path.glob(f"*/{LOG_NAME}")):
            there = f"; there are runs in it: name one, or let `picktree explain {path}` tell of all"
        if (path / BATCH_RESULTS).is_file():
            there = (
                f"; it is a batch: name one of its jobs, as {path}@seed=0; "
                f"`picktree batch report {path}` tells of all jobs, "
                f"`picktree resim {path}@seed=0` makes a log that was not kept"
            )
        raise PicktreeError(f"{path}: there is no {LOG_NAME} in this folder{there}")
    if not path.exists():
        raise PicktreeError(f"{path}: there is no such log")
    return path


def _last_write_time(log: Path) -> int:
    """Return the time of the last write to a log's last file, ns."""
    return max(path.stat().st_mtime_ns for path in (log, *part_paths(log).values()))
