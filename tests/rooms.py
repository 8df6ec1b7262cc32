"""picktree's packages as pyproject.toml lists them, for tests that read its sources."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGES: list[str] = PROJECT["tool"]["setuptools"]["packages"]
ROOMS = sorted({package.split(".")[1] for package in PACKAGES if "." in package})
"""Top-level packages."""


def modules(*, but: tuple[str, ...] = ()) -> list[Path]:
    """Return the modules of all rooms but these and of the top folder, sorted by path."""
    assert set(but) <= set(ROOMS), "a room that is left out exists no more"
    found = [file for room in ROOMS if room not in but for file in (ROOT / room).rglob("*.py")]
    found += ROOT.glob("*.py")
    # A scan that reads nothing finds nothing wrong.
    assert len(found) > 300
    assert {
        ROOT / "trees/node.py",
        ROOT / "skills/grasp.py",
        ROOT / "control/execution/control_loop.py",
    } <= set(found)
    return sorted(found)
