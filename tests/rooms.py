"""picktree's packages as pyproject.toml lists them, for tests that read its sources."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LISTED: list[str] = PROJECT["tool"]["setuptools"]["packages"]
PACKAGES = [package for package in LISTED if package.split(".")[0] == "picktree"]
ROOMS = sorted({package.split(".")[1] for package in PACKAGES if "." in package})
"""Top-level packages."""


def modules(*, but: tuple[str, ...] = ()) -> list[Path]:
    """Return the modules of all rooms but these rooms or parts (`apps/cli`) and of the top folder, sorted by
    path."""
    left_out = [ROOT / name for name in but]
    assert all(folder.is_dir() for folder in left_out), "a room that is left out exists no more"
    found = [file for room in ROOMS for file in (ROOT / room).rglob("*.py")]
    found = [file for file in found if not any(folder in file.parents for folder in left_out)]
    found += ROOT.glob("*.py")
    # A scan that reads nothing finds nothing wrong.
    assert len(found) > 300
    assert {
        ROOT / "trees/node.py",
        ROOT / "skills/grasp.py",
        ROOT / "robot/control/control_loop.py",
    } <= set(found)
    return sorted(found)
