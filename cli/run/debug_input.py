"""Input of the debugger's prompt, from a terminal or from a pipe."""

from __future__ import annotations

import sys
from typing import TextIO

from ..terminal.command_prompt import complete_with, line_reader
from .debugger_prompt import DebugPrompt


def debug_prompt(out: TextIO) -> DebugPrompt:
    prompt = DebugPrompt(line_reader(out), out)
    if sys.stdin.isatty():
        complete_with(prompt)
    return prompt
