"""picktree replay"""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer


def replay(
    log: Annotated[str, typer.Argument(metavar="LOG", help="Log file, a run's folder, or `last`.")],
    at: Annotated[float, typer.Option(metavar="TIME", min=0.0, help="Where to begin, simulated s.")] = 0.0,
) -> None:
    """Step through a run: tree, belief, what changed. With keys at a terminal; else commands from stdin."""
    from ...analysis.replay.cursor import Cursor
    from ...analysis.run import Run
    from ..terminal.command_prompt import complete_with, line_reader
    from .replay_prompt import ReplayPrompt

    with Run(log) as run:
        if run.recovered:
            print(run.recovered, file=sys.stderr)
        prompt = ReplayPrompt(Cursor(run, at), line_reader(sys.stdout), sys.stdout)
        if prompt.cursor.course.derived:
            print("a log of format 1: beginnings and ends are derived from the statuses", file=sys.stderr)
        if not sys.stdin.isatty():
            prompt.show_here()
            prompt.converse()
            return
        complete_with(prompt)
        if sys.stdout.isatty() and os.environ.get("TERM", "dumb") != "dumb" and os.name == "posix":
            from .replay_screen import Screen

            Screen(prompt).run()
        else:
            prompt.show_here()
            prompt.converse()
