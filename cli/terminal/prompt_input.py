"""Where the lines of a prompt come from: a terminal, with completion and history, or what is piped in."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TextIO

from .command_prompt import Prompt


def line_reader(out: TextIO) -> Callable[[str], str]:
    """Reads from stdin. What is piped in is shown behind the prompt, so that it reads as a conversation."""
    if sys.stdin.isatty():
        return input

    def read(text: str) -> str:
        line = sys.stdin.readline()
        if not line:
            raise EOFError
        print(f"{text}{line.rstrip()}", file=out, flush=True)
        return line

    return read


def complete_with(prompt: Prompt) -> None:
    """Let Tab complete the lines that are typed for this prompt."""
    try:
        import readline
    except ImportError:  # Python may be built without it
        return
    found: list[str] = []

    def complete(word: str, state: int) -> str | None:
        if state == 0:
            found[:] = prompt.completions(readline.get_line_buffer()[: readline.get_endidx()])
        return found[state] if state < len(found) else None

    readline.set_completer_delims(" ")
    readline.set_completer(complete)
    readline.parse_and_bind("tab: complete")
