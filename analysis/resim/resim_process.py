"""The other process: runs a recorded run again and says how that compares.

It reads one order from stdin and writes lines of JSON to stdout: where it is, and in the end the answer.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from pydantic import TypeAdapter

from ...errors import PicktreeError
from ...files.diagnostics.fault_rendering import fault_lines
from ...files.yaml.document import FileError
from ...logs.run_result import RunResult
from ...session.arithmetic_probe import arithmetic
from ...session.resume.recorded_recipe import Recorded
from ...session.session import Session
from ...trees.running.runner import NodeInfo, TickReport
from ..run import Run
from .changes import Changes, apply
from .resim_comparison import Comparison, Difference

_EVERY = 0.2
"""Wall seconds between two words of where it is."""


@dataclass(frozen=True)
class Order:
    log: Path
    changes: Changes
    until: float | None
    """Simulated s; None: to the end of the record."""
    out: Path | None
    """Folder for the run's folder; None: its log is not kept."""


@dataclass(frozen=True)
class Answer:
    """One line: `at` while it goes on, `error` when the input is bad, else the comparison."""

    at: float | None = None
    """Simulated s."""
    error: str = ""
    ticks: int = 0
    digest: str = ""
    exact: bool = True
    difference: Difference | None = None
    trees: Difference | None = None
    result: str = ""
    """The run's result as JSON text."""
    told: tuple[str, ...] = field(default_factory=tuple[str, ...])
    """What was changed."""
    warnings: str = ""
    """Of the checker, about another mission."""
    arithmetic: Mapping[str, str] = field(default_factory=dict[str, str])
    """The arithmetic of the process, as `Arithmetic.words`."""


ORDER = TypeAdapter(Order)
ANSWER = TypeAdapter(Answer)


class _Progress:
    """A watcher that says where the run is."""

    def __init__(self, say: Callable[[Answer], None]) -> None:
        self._say = say
        self._said = 0.0

    def started(self, structure: tuple[NodeInfo, ...], folder: Path) -> None: ...
    def edited(self, structure: tuple[NodeInfo, ...]) -> None: ...
    def told(self, now: float, text: str) -> None: ...
    def finished(self, result: RunResult) -> None: ...

    def ticked(self, now: float, report: TickReport, items_done: int, items_total: int) -> None:
        wall = time.monotonic()
        if wall - self._said >= _EVERY:
            self._said = wall
            self._say(Answer(at=now))


def carry_out(order: Order, say: Callable[[Answer], None]) -> Answer:
    """Raises PicktreeError for what cannot be run again."""
    with (
        Run(order.log) as run,
        Recorded(run) as recorded,
        tempfile.TemporaryDirectory(prefix="picktree-") as away,
    ):
        changed = apply(order.changes, recorded.recipe())
        recipe = changed.recipe
        comparison = Comparison(run, order.until, order.changes.settings if order.changes else None)
        limit = recipe.limit if comparison.until is None else min(recipe.limit, comparison.until)
        edits = None if order.changes.mission else recorded.edits()
        session = Session(
            replace(recipe, limit=limit),
            _Progress(say),
            out=order.out or Path(away),
            revisions=edits,
            tap=comparison.take,
            operator=recorded.answers(),
        )
        if not order.changes:
            comparison.on_difference = session.stop
        result = session.run()
        comparison.finish()
        return Answer(
            ticks=comparison.ticks,
            digest=comparison.digest,
            exact=comparison.exact,
            difference=comparison.difference,
            trees=comparison.trees,
            result=result.to_json_text(),
            told=changed.told,
            warnings=fault_lines(changed.warnings) if changed.warnings else "",
            arithmetic=arithmetic().words(),
        )


def main() -> int:
    # The libraries in C++ print on their own: stdout is for the answers alone.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)

    def say(answer: Answer) -> None:
        answers.write(ANSWER.dump_json(answer).decode() + "\n")
        answers.flush()

    try:
        say(carry_out(ORDER.validate_json(sys.stdin.buffer.read()), say))
    except FileError as error:
        say(Answer(error=fault_lines(error.faults)))
    except PicktreeError as error:
        say(Answer(error=str(error)))
    except (KeyboardInterrupt, BrokenPipeError):
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
