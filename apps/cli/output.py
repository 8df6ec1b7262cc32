"""Output of a command's answer."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TextIO

import typer

if TYPE_CHECKING:
    from picktree.files import Diagnostic, Paint


def keep_stdout() -> TextIO:
    """Return the present stdout for the answer alone; all other output goes to stderr from now on.

    The file descriptor is redirected, because libraries in C++ print directly.
    """
    sys.stdout.flush()
    kept = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return kept


def print_answer(answer: TextIO | None, text: Callable[[], str], json_text: Callable[[], str]) -> None:
    """Print the text; with an `answer`, the stdout that `keep_stdout` kept, the JSON."""
    if answer is None:
        print(text())
        return
    with answer:
        answer.write(json_text())


def print_warnings(found: Sequence[Diagnostic]) -> None:
    """Print the lines of warnings on stderr."""
    if found:
        from picktree.files import fault_lines

        print(fault_lines(found, painter(sys.stderr)), file=sys.stderr)


def json_text(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, indent=2) + "\n"


def end_with(good: bool, status: str = "") -> None:
    """End the command with exit code 130 for an interrupted run, with 1 when the answer is no."""
    if status == "interrupted":
        raise typer.Exit(130)
    if not good:
        raise typer.Exit(1)


class StatusLine:
    """Line on the terminal of stderr that is overwritten; nothing elsewhere.

    With `PICKTREE_STATUS` in the environment it is written into a file, too, for a program that reads it.
    """

    def __init__(self) -> None:
        self.on = sys.stderr.isatty() or bool(os.environ.get("PICKTREE_STATUS"))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.say("")

    def say(self, text: str) -> None:
        if self.on:
            print(f"\r\x1b[2K{text}", end="", file=sys.stderr, flush=True)


def require_place(output: Path | None) -> None:
    """Raise PicktreeError when a file cannot be created there, before a long run that would end without
    it."""
    from picktree.files import PicktreeError

    if output is not None and output.is_dir():
        raise PicktreeError(f"{output} is a folder; name a file in it")
    if output is not None and not output.absolute().parent.is_dir():
        raise PicktreeError(f"{output} cannot be written: there is no folder {output.absolute().parent}")


def show(text: str, output: Path | None) -> None:
    """Print the text, or write it to a file. Raises PicktreeError when it cannot be written."""
    if output is None:
        sys.stdout.write(text)
        return
    from picktree.files import PicktreeError

    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise PicktreeError(f"{output} cannot be written: {(error.strerror or str(error)).lower()}") from None


def program() -> str:
    """Return the shell command with which picktree was called, for commands to copy."""
    called = Path(sys.argv[0])
    if called.name == "__main__.py":
        return f"{shlex.quote(sys.executable)} -m picktree"
    found = shutil.which(called.name)
    if found is not None and Path(found).resolve() == called.resolve():
        return called.name
    return shlex.quote(sys.argv[0])


def painter(stream: TextIO) -> Paint:
    """Return a function that colours text for the stream; without colours where it is no terminal."""
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
