"""Processes of this machine, for tests that ask whether all have gone."""

from __future__ import annotations

from pathlib import Path

from picktree.apps.batch.job_process import children


def below(pid: int) -> set[int]:
    """The process, its children, their children, and so on."""
    return {pid}.union(*(below(child) for child in children(pid)))


def alive(pids: set[int]) -> set[int]:
    """Those that still run; one that has ended and was not asked for its exit code does not."""
    return {pid for pid in pids if _state(pid) not in ("", "Z")}


def name(pid: int) -> str:
    """Of the program; empty when it has ended."""
    try:
        return Path(f"/proc/{pid}/comm").read_text().strip()
    except OSError:
        return ""


def _state(pid: int) -> str:
    """A letter, which follows the name, which may hold anything."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][:1]
    except OSError:
        return ""
