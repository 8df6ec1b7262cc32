"""Full-screen replay in a terminal: single keys, and the tick at the cursor, redrawn after each key."""

from __future__ import annotations

import io
import os
import select
import sys
import termios
import tty
from collections.abc import Generator, Mapping
from contextlib import contextmanager

from rich.console import Console
from rich.text import Text

from . import replay_prompt
from .replay_prompt import ReplayPrompt
from .state_text import tree_rows

KEYS: Mapping[str, str] = {
    "right": "step",
    "left": "back",
    "pagedown": "step 20",
    "pageup": "back 20",
    "down": "next",
    "up": "previous",
    "n": "next",
    "p": "previous",
    "f": "failure",
    "F": "failure back",
    "home": "to start",
    "end": "to end",
    "c": "continue",
    "C": "continue back",
    "t": "tree",
    "w": "where",
    "d": "changes",
    "l": "failures",
    "e": "evidence",
    "b": "blackboard",
    "o": "belief",
    "j": "joints",
    "r": "wrench",
    "q": "quit",
}
"""Commands of the keys. `:` begins a line with any command; `?` shows the keys."""
_HINT = "←→ tick  ↑↓ change  f F failure  e evidence  t tree  d changes  b blackboard  : command  ? help"
_ESCAPES: Mapping[bytes, str] = {
    b"[A": "up", b"[B": "down", b"[C": "right", b"[D": "left", b"OA": "up", b"OB": "down", b"OC": "right",
    b"OD": "left", b"[5~": "pageup", b"[6~": "pagedown", b"[H": "home", b"[F": "end", b"[1~": "home",
    b"[4~": "end", b"OH": "home", b"OF": "end",
}  # fmt: skip
_TREE_DIVISOR, _CHANGES_DIVISOR = 3, 5
"""Divisors of the screen's height: at least a third for the tree, two fifths of the rest for changes."""


class Screen:
    """Drawing on the terminal's alternate screen, which leaves the main one unchanged."""

    def __init__(self, prompt: ReplayPrompt) -> None:
        self._prompt = prompt
        self._console = Console(highlight=False)
        self._said: list[str] = []
        self._from = 0
        """Index of the first shown line of a command's output."""

    def run(self) -> None:
        """Run until `quit`, or the end of the input. Ctrl-C raises KeyboardInterrupt."""
        with _other_screen(), _single_keys():
            self._draw()
            while True:
                key = _key()
                if key in (None, "\x04"):
                    return
                line = self._ask() if key in (":", "\n", "\r") else KEYS.get(key or "", "")
                if key == " ":
                    self._draw()
                elif key in ("?", "h"):
                    self._say(_help())
                elif line and self._carry_out(line):
                    return

    def _carry_out(self, line: str) -> bool:
        """Run a command line; return whether the replay ends."""
        before = self._prompt.cursor.number
        with self._prompt.into(io.StringIO()) as said:
            left = self._prompt.carry_out(line)
        moved = self._prompt.cursor.number != before or line.startswith("show")
        if not left:
            self._say([] if moved else said.getvalue().splitlines())
        return left

    def _say(self, lines: list[str]) -> None:
        self._said, self._from = lines, 0
        self._draw()

    def _ask(self) -> str:
        """Read a line that is typed below the tree."""
        with _whole_lines():
            try:
                return input(self._prompt.text).strip()
            except EOFError:
                return ""

    def _draw(self) -> None:
        """Draw the tick at the cursor, and below it a command's output by pages, or else changes and
        belief."""
        cursor, console = self._prompt.cursor, self._console
        width, height = console.size
        most = max(height // _TREE_DIVISOR, 4)
        rows = tree_rows(
            cursor.tree.nodes, replay_prompt.statuses(cursor), most, replay_prompt.changed_paths(cursor)
        )
        room = max(height - len(rows) - 4, 4)
        lines = [Text(line, style="red" if "✗" in line else "") for line in self._below(room)]
        console.file.write("\x1b[H\x1b[2J")
        for line in (
            Text(replay_prompt.place(cursor), style="bold"),
            *rows,
            Text(),
            *lines,
            Text(self._hint(), style="dim"),
        ):
            line.truncate(width, overflow="ellipsis")
            console.print(line, soft_wrap=True)

    def _below(self, room: int) -> list[str]:
        if self._said:
            page = self._said[self._from : self._from + room]
            self._from = self._from + room if self._from + room < len(self._said) else 0
            return page
        cursor = self._prompt.cursor
        news = max(room * 2 // _CHANGES_DIVISOR, 3)
        lines = [*replay_prompt.change_lines(cursor, cursor.changes(self._prompt.since), news), ""]
        return [*lines, *[*replay_prompt.believed_lines(cursor, "")][: max(room - len(lines), 0)]]

    def _hint(self) -> str:
        if not self._from:
            return _HINT
        return f"space: the rest, {len(self._said) - self._from} lines   any key of a movement goes on"


def _help() -> list[str]:
    by_line: dict[str, list[str]] = {}
    for key, line in KEYS.items():
        by_line.setdefault(line, []).append(key)
    keys = [f"{', '.join(ones):<12} {line}" for line, ones in by_line.items()]
    return [*keys, f"{':':<12} a line with any command; `help` lists them", f"{'?':<12} this"]


def _key() -> str | None:
    """Return the pressed key; None at the end of the input, empty for an unknown key."""
    fd = sys.stdin.fileno()
    first = os.read(fd, 1)
    if not first:
        return None
    if first != b"\x1b":
        return first.decode("ascii", "ignore")
    rest = b""
    while len(rest) < 4 and rest not in _ESCAPES and select.select([fd], [], [], 0.05)[0]:
        rest += os.read(fd, 1)
    return _ESCAPES.get(rest, "")


@contextmanager
def _single_keys() -> Generator[None]:
    """Deliver keys at once in the block, without echo."""
    fd = sys.stdin.fileno()
    before = termios.tcgetattr(fd)
    tty.setcbreak(fd, termios.TCSADRAIN)  # not TCSAFLUSH: what was typed ahead is kept
    try:
        yield
    finally:
        termios.tcsetattr(fd, termios.TCSADRAIN, before)


@contextmanager
def _whole_lines() -> Generator[None]:
    """Deliver whole lines with echo in the block; for use within `_single_keys`."""
    fd = sys.stdin.fileno()
    keys = termios.tcgetattr(fd)
    lines = termios.tcgetattr(fd)
    lines[3] |= termios.ICANON | termios.ECHO
    termios.tcsetattr(fd, termios.TCSADRAIN, lines)
    try:
        yield
    finally:
        termios.tcsetattr(fd, termios.TCSADRAIN, keys)


@contextmanager
def _other_screen() -> Generator[None]:
    sys.stdout.write("\x1b[?1049h")
    sys.stdout.flush()
    try:
        yield
    finally:
        sys.stdout.write("\x1b[?1049l")
        sys.stdout.flush()
