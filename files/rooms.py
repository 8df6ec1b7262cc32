"""The folder of the installed package, and its top-level packages (rooms)."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent
"""Folder of the package `picktree`. In a checkout it contains tests, examples and documents, too."""


@cache
def rooms() -> tuple[str, ...]:
    """Names of the top-level packages, sorted. Only they have an `__init__.py`: tests and examples have
    none."""
    return tuple(sorted(file.parent.name for file in ROOT.glob("*/__init__.py")))
