"""Programs and packages that some tests need. Where one is missing, its tests are skipped.

The last line before pytest's own says how many, and what brings them back: see `left_out`.
"""

from __future__ import annotations

import importlib.util
import re
import shutil
import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import pytest


@dataclass(frozen=True)
class Need:
    name: str
    present: bool
    remedy: str
    """Command that brings it."""

    @property
    def reason(self) -> str:
        return f"{self.name} is missing: {self.remedy}"

    def require(self) -> None:
        """Skip the test that calls this, or whose fixture calls it."""
        if not self.present:
            pytest.skip(self.reason)


def needs(need: Need) -> pytest.MarkDecorator:
    """Return the mark of a test that is left out where that is missing."""
    return pytest.mark.skipif(not need.present, reason=need.reason)


def _is_found(program: str) -> bool:
    return shutil.which(program) is not None


CHROMIUM_PROGRAM = shutil.which("chromium") or shutil.which("google-chrome")
CHROMIUM = Need("chromium", CHROMIUM_PROGRAM is not None, "apt-get install chromium")
NODE = Need("node", _is_found("node"), "apt-get install nodejs npm && make packages")
MAKE = Need("make", _is_found("make"), "apt-get install make")
RERUN_PROGRAM = shutil.which("rerun") or shutil.which("rerun", path=str(Path(sys.executable).parent))
RERUN = Need("rerun", RERUN_PROGRAM is not None, "make dev")
PANDAS = Need("pandas", importlib.util.find_spec("pandas") is not None, "make dev")
RAY = Need("ray", importlib.util.find_spec("ray") is not None, "make dev")


def packages(room: str) -> Need:
    """Return the need of node and of the npm packages of tests/ROOM/node. npm writes the file last."""
    if not NODE.present:
        return NODE
    whole = Path(__file__).parent / room / "node" / "node_modules" / ".package-lock.json"
    return Need("npm packages", whole.is_file(), "make packages")


_REASON = re.compile(r"(?:Skipped: )?(.+) is missing: (.+)", re.DOTALL)


def left_out(reasons: Iterable[str]) -> str:
    """Return one line about the tests that were skipped for these reasons; empty when none needs anything."""
    counts = Counter(found.groups() for reason in reasons if (found := _REASON.fullmatch(reason)))
    parts = [
        f"{count} {'test that needs' if count == 1 else 'tests that need'} {name} ({remedy})"
        for (name, remedy), count in counts.most_common()
    ]
    return f"Left out: {', '.join(parts)}" if parts else ""
