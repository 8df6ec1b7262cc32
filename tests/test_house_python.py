"""The package as Python meets it."""

from __future__ import annotations

import subprocess
import sys

import pytest

import picktree


def test_import_alone_loads_nothing_else_of_picktree() -> None:
    program = "import sys, picktree; print(sorted(n for n in sys.modules if n.startswith('picktree')))"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    own = ["picktree", "picktree.files", "picktree.files.arithmetic", "picktree.files.errors"]
    assert ran.stdout == f"{own}\n"


def test_unknown_name() -> None:
    with pytest.raises(AttributeError, match=r"^module 'picktree' has no attribute 'rum'$"):
        _ = picktree.rum  # type: ignore[attr-defined]
