"""Displays of a running mission, a live tree or plain lines; and the prompt of its operator."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, TextIO

from picktree.session import Interrupter, Observer
from picktree.world import NodeState, TreeNode

from .state_text import NodeRow, status_text, tree_rows

if TYPE_CHECKING:
    from rich.console import Console

    from picktree.logs import RunResult
    from picktree.robot import operator_desk
    from picktree.session import Execution
    from picktree.world import Tick

_REDRAW_PERIOD = 0.1
"""Interval between redraws of the live view, wall s."""
_MAX_SILENCE = 30.0
"""Interval between lines when there are no other events, simulated s."""


class RunDisplay(Observer, AbstractContextManager["RunDisplay"]):
    """Observer of a session that holds the terminal while it is entered."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def aside(self) -> AbstractContextManager[None]:
        """Release the terminal to another user in the block."""
        return nullcontext()


class LinesDisplay(RunDisplay):
    """Display with a line for each finished item and each failed leaf, and one after a long time without."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._leaves: frozenset[str] = frozenset()
        self._progress = ""
        self._said_at = 0.0

    def started(self, run: Execution, folder: Path) -> None:
        self._run = run
        self._progress = run.tally.progress(run.items_total)
        self.edited(run)
        self._line(f"recording to {folder}")

    def edited(self, run: Execution) -> None:
        self._leaves = run.tree.leaves

    def notified(self, now: float, text: str) -> None:
        self._say(now, text)

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        for node in report.nodes:
            if node.cause and node.ticked and node.status == "FAILURE" and node.path in self._leaves:
                self._say(now, f"{node.path}: {node.cause}: {node.message}")
        progress = self._run.tally.progress(items_total)
        if progress != self._progress:
            self._progress = progress
            self._say(now, progress)
        if now - self._said_at >= _MAX_SILENCE:
            self._say(now, f"at {deepest_running(report.nodes)}")

    def _say(self, now: float, text: str) -> None:
        self._said_at = now
        self._line(f"{now:8.2f} s  {text}")

    def _line(self, text: str) -> None:
        print(text, file=self._stream, flush=True)


class LiveDisplay(RunDisplay):
    """Display of the tree with its statuses, redrawn a few times per second, removed at the end."""

    def __init__(self, console: Console) -> None:
        from rich.live import Live

        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._structure: tuple[TreeNode, ...] = ()
        self._began = self._drawn_at = time.monotonic()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.stop()

    def started(self, run: Execution, folder: Path) -> None:
        self._run = run
        self.edited(run)
        self._began = time.monotonic()
        self._live.start()

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        from rich.console import Group
        from rich.text import Text

        wall = time.monotonic()
        if wall - self._drawn_at < _REDRAW_PERIOD:
            return
        self._drawn_at = wall
        elapsed = wall - self._began
        tally = self._run.tally
        footer = (
            f"{tally.progress(items_total)}   simulated {now:.1f} s   "
            f"wall {elapsed:.1f} s   {now / max(elapsed, 1e-9):.1f} × real time"
        )
        figures = tally.operator_figures(now).to_text()
        room = max(self._live.console.height - 5, 5)
        rows = tree_rows(node_states(self._structure, report.nodes), room)
        for row in rows:
            row.truncate(self._live.console.width, overflow="ellipsis")
        self._live.update(Group(*rows, Text(), Text(footer, style="bold"), Text(figures)), refresh=True)

    def edited(self, run: Execution) -> None:
        self._structure = run.tree.structure()

    def notified(self, now: float, text: str) -> None:
        self._live.console.print(f"{now:8.2f} s  {text}", markup=False, soft_wrap=True)

    def finished(self, result: RunResult) -> None:
        self._live.stop()

    @contextmanager
    def aside(self) -> Generator[None]:
        self._live.stop()
        try:
            yield
        finally:
            self._live.start()


def run_display(*, to_stderr: bool = True, lines: bool = False) -> RunDisplay:
    """Return the display of a run. `lines`: no live tree on any terminal, because the user types into it."""
    stream = sys.stderr if to_stderr else sys.stdout
    if lines or not (stream.isatty() or any(map(os.environ.get, _TERMINAL_VARIABLES))):
        return LinesDisplay(stream)
    from rich.console import Console

    console = Console(stderr=to_stderr, highlight=False)
    return LiveDisplay(console) if console.is_terminal else LinesDisplay(stream)


_TERMINAL_VARIABLES = ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE")
"""Environment variables by which rich takes another stream for a terminal."""


def node_states(structure: Sequence[TreeNode], states: Sequence[NodeState]) -> list[NodeRow]:
    """Return the rows of a tree's nodes with their states after a tick."""
    reports = {node.path: (node.status, status_text(node.cause, node.message)) for node in states}
    return [NodeRow(info.path, info.name, info.id, *reports[info.path]) for info in structure]


def deepest_running(nodes: Sequence[NodeState]) -> str:
    """Return the path of the last running node, parents first; "nothing" when none runs."""
    return next((node.path for node in reversed(nodes) if node.status == "RUNNING"), "nothing")


class PersonAtTerminal(Interrupter):
    """Prompt that shows the question and reads the answer, while run and clock wait.

    `read` returns a line and raises EOFError at the end of the input. `aside` is entered during the prompt,
    so that no other display writes to the terminal.
    """

    def __init__(
        self,
        out: TextIO,
        aside: Callable[[], AbstractContextManager[None]],
        read: Callable[[], str] = input,
    ) -> None:
        self._out, self._aside, self._read = out, aside, read

    def answer(self, question: operator_desk.OperatorQuestion) -> str | None:
        """Return the answer; None at the end of the input: the run ends `paused`."""
        with self._aside():
            self._say("", f"Help is wanted: {question.reason}", f"  {question.situation}")
            for number, choice in enumerate(question.choices, 1):
                self._say(f"  {number}  {choice}")
            while True:
                print("(answer) ", end="", file=self._out, flush=True)
                try:
                    line = self._read()
                except EOFError:
                    self._say("")
                    return None
                choice = question.choice(line)
                if choice is not None:
                    return choice
                if line.strip():
                    self._say(
                        f"{line.strip()!r} is not among the answers: write the number of an answer "
                        "or its beginning"
                    )

    def _say(self, *lines: str) -> None:
        for line in lines:
            print(line, file=self._out, flush=True)


def operators(out: TextIO, aside: Callable[[], AbstractContextManager[None]]) -> tuple[PersonAtTerminal, ...]:
    """Return the operator's prompt; empty when stdin is no terminal."""
    return (PersonAtTerminal(out, aside),) if sys.stdin.isatty() else ()
