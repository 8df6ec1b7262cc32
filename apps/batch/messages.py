"""Messages between a batch and its driver, the process that communicates with Ray; installations compared."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Final, Literal, TypeAlias

from ...files.shipped_files import ROOT
from ...session.environment import hashes, sources, versions
from ...trees.loading.plugin_import import GROUP
from .executor import Event, JobOrder

_WORKER_FOLDERS: Final = ("apps/batch", "analysis/explain", "analysis/resim")
"""Folders with code that workers run but runs do not, and that `sources` therefore lacks."""
_NON_WORKER_FILE: Final = "apps/batch/report.py"
"""File within those that no worker needs."""


@dataclass(frozen=True, slots=True)
class Installation:
    """Versions and sources, equal on two machines that give the same rows for the same job, as far as
    known."""

    versions: Mapping[str, str]
    """Versions of the libraries, of installed plug-ins, and of Python."""
    sources: Mapping[str, str]
    """Start of the SHA-256 of each file of picktree, by path."""


def installed() -> Installation:
    """Return the installation of this machine."""
    plugins = {entry.dist.name: entry.dist.version for entry in entry_points(group=GROUP) if entry.dist}
    of_workers = (
        file
        for folder in _WORKER_FOLDERS
        for file in sorted((ROOT / folder).rglob("*.py"))
        if file != ROOT / _NON_WORKER_FILE
    )
    python = "{}.{}".format(*sys.version_info)
    glibc = os.confstr("CS_GNU_LIBC_VERSION") or ""
    return Installation(
        {"python": python, "glibc": glibc.removeprefix("glibc "), **versions(), **plugins},
        {**sources(), **hashes(of_workers)},
    )


def difference(here: Installation, there: Installation) -> str:
    """Return the difference that keeps jobs from running there; empty when there is none."""
    names = sorted({*here.versions, *there.versions})
    others = [
        f"{name} {there.versions.get(name, 'missing')}, here {here.versions.get(name, 'missing')}"
        for name in names
        if here.versions.get(name) != there.versions.get(name)
    ]
    if others:
        return f"it has {'; '.join(others)}"
    files = sorted(
        name for name in {*here.sources, *there.sources} if here.sources.get(name) != there.sources.get(name)
    )
    if files:
        return f"its picktree is another: {', '.join(files[:3])}{' and more' if len(files) > 3 else ''}"
    return ""


@dataclass(frozen=True, slots=True)
class ClusterSettings:
    """First message of the batch."""

    address: str | None
    """Address of a running cluster; None: start one on this machine, and stop it at the end."""
    workers: int | None
    """Maximum number of concurrent workers; None: one for each CPU of the cluster."""
    folder: Path
    """Folder for this process alone."""
    output: Path
    """File with the output of this process."""
    here: Installation
    """Installation of the batch's machine."""


@dataclass(frozen=True, slots=True)
class Task:
    """Order for the driver."""

    order: JobOrder
    token: str
    """Content of the file `TOKEN` in the order's folder."""


@dataclass(frozen=True, slots=True)
class WorkerCount:
    """Present number of workers, with those that are about to start."""

    count: int


@dataclass(frozen=True, slots=True)
class ClusterRefusal:
    """Reason why the cluster cannot be used; the batch ends."""

    reason: str


STOP: Final = "stop"
"""Message to break off all running orders."""
TOKEN: Final = ".from-the-batch"
"""File in an order's folder: a worker that can remove it shares the folder with the batch."""
Said: TypeAlias = Task | Literal["stop"]
"""Message of the batch after its settings; the end of the connection shows that the batch is gone."""
News: TypeAlias = WorkerCount | ClusterRefusal | Event
"""Message to the batch."""
