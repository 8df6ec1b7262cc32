"""Where a command's answer goes."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import typer

if TYPE_CHECKING:
    from ...files.diagnostics.fault_rendering import Paint


def keep_stdout() -> TextIO:
    """The present stdout, for the answer alone: from now on all else that is written there goes to stderr.

    Done on the file descriptor, because the libraries in C++ print on their own.
    """
    sys.stdout.flush()
    kept = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return kept


def show(text: str, output: Path | None) -> None:
    """Print the text, or write it to that file. Raises PicktreeError when it cannot be written."""
    if output is None:
        sys.stdout.write(text)
        return
    from ...errors import PicktreeError

    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise PicktreeError(f"{output} cannot be written: {(error.strerror or str(error)).lower()}") from None


def program() -> str:
    """What to type to call picktree as it was called now, for commands that are shown to be copied."""
    called = Path(sys.argv[0])
    if called.name == "__main__.py":
        return f"{shlex.quote(sys.executable)} -m picktree"
    found = shutil.which(called.name)
    if found is not None and Path(found).resolve() == called.resolve():
        return called.name
    return shlex.quote(sys.argv[0])


def painter(stream: TextIO) -> Paint:
    """How to colour text for that stream: not at all unless it is a terminal that wants it."""
    if not stream.isatty() or os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return lambda text, role: text
    return lambda text, role: typer.style(text, **_STYLES[role])


_STYLES: Mapping[str, Mapping[str, Any]] = {
    "place": {"bold": True},
    "error": {"fg": "red", "bold": True},
    "warning": {"fg": "yellow", "bold": True},
    "hint": {"fg": "cyan"},
    "margin": {"fg": "blue"},
    "caret": {"fg": "red", "bold": True},
}
