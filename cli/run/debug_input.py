"""The debugger's prompt, at a terminal or of what is piped into stdin."""

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
