"""Where the commands of the debugger come from: a terminal, or what is piped into stdin."""

from __future__ import annotations

import sys
from typing import TextIO

from .debug import DebugPrompt


def debug_prompt(out: TextIO) -> DebugPrompt:
    """A prompt at the terminal, with completion and history, or of what is piped into stdin."""
    if sys.stdin.isatty():
        prompt = DebugPrompt(input, out)
        _complete_with(prompt)
        return prompt

    def read(text: str) -> str:
        line = sys.stdin.readline()
        if not line:
            raise EOFError
        # So that what comes out reads as a conversation.
        print(f"{text}{line.rstrip()}", file=out, flush=True)
        return line

    return DebugPrompt(read, out)


def _complete_with(prompt: DebugPrompt) -> None:
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
