"""Installation of picktree on a machine, compared so that no job runs with other code or libraries."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Final

from ...files.shipped_files import ROOT
from ...session.environment import hashes, sources, versions
from ...trees.loading.registry import GROUP

_WORKER_FOLDERS: Final = ("batch", "analysis/explain", "analysis/resim")
"""Folders with code that workers run but runs do not, and that `sources` therefore lacks."""
_NON_WORKER_FILE: Final = "batch/report.py"
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
