"""Where a command's answer goes."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from pathlib import Path
from typing import TextIO


def keep_stdout() -> TextIO:
    """The present stdout, for the answer alone: from now on all else that is written there goes to stderr.

    Done on the file descriptor, because the libraries in C++ print on their own.
    """
    sys.stdout.flush()
    kept = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return kept


def program() -> str:
    """What to type to call picktree as it was called now, for commands that are shown to be copied."""
    called = Path(sys.argv[0])
    if called.name == "__main__.py":
        return f"{shlex.quote(sys.executable)} -m picktree"
    found = shutil.which(called.name)
    if found is not None and Path(found).resolve() == called.resolve():
        return called.name
    return shlex.quote(sys.argv[0])
