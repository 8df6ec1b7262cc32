"""Actions of the operator during a run: answers and changes of the blackboard, performed and repeated."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ..files.errors import PicktreeError
from ..robot.operator_desk import OperatorQuestion
from ..trees.blackboard_entries import checked_value
from ..trees.mission import Mission
from ..trees.port_types import show
from ..trees.runner import BehaviourTree, TickReport
from ..world.journal import Plain
from ..world.run_events import BlackboardSetEvent
from .execution import Execution
from .observer import Interrupter, ReloadMessage

OPERATOR: Final = "operator"
"""Writer of an entry that the operator changed, where a node's path is otherwise."""
_TIME_TOLERANCE: Final = 1e-6
"""Tolerance of time comparisons, simulated s."""


@dataclass(frozen=True, slots=True)
class EntryChange:
    """Change of a blackboard entry."""

    key: str
    """Full key."""
    value: Plain
    passes: int
    """Number of starts and ends of nodes in the tick before the change; 0: it comes before the tick."""
    node: str = ""
    """Path of the node at which the run stands; empty between two ticks."""


def set_entry(tree: BehaviourTree, change: EntryChange) -> str:
    """Change a blackboard entry and note it in the journal; return what was done, as a sentence."""
    board, key = tree.blackboard, change.key
    previous = board.read(key) if key in board else None
    board.write(key, change.value, OPERATOR)
    before = f"was {show(previous)}" if previous is not None else "had no value"
    message = f"{key} is set to {show(change.value)} by the operator; it {before}"
    tree.root.world.journal.note(
        BlackboardSetEvent(
            message, change.node, key=key, value=change.value, previous=previous, passes=change.passes
        )
    )
    return message


class RecordedOperator(Interrupter):
    """Operator that repeats the answers and the changes of blackboard entries of a log.

    An answer is for the node that asked: when another node asks, or the choices do not contain the answer, it
    gives no answer from then on. A change comes at its tick, after as many starts and ends of nodes; in a
    tick with fewer, after it. A change that the tree of another mission does not accept is left out.
    """

    def __init__(
        self, answers: Iterable[tuple[str, str]] = (), changes: Iterable[tuple[float, EntryChange]] = ()
    ) -> None:
        """`answers`: pairs of the asking node's path and the answer. `changes`: with their times, simulated
        s, in order."""
        self._answers = deque(answers)
        self._changes = deque(changes)
        self._passes = 0
        self._run: Execution | None = None

    def started(self, run: Execution, folder: Path) -> None:
        self._run = run
        if self._changes:
            run.tree.on_start.insert(0, self._pass)
            run.tree.on_end.insert(0, self._pass)

    def answer(self, question: OperatorQuestion) -> str | None:
        if self._answers:
            node, said = self._answers.popleft()
            if node == question.node and said in question.choices:
                return said
            self._answers.clear()
        return None

    def ticked(self, now: float, report: TickReport, items_done: int, items_total: int) -> None:
        """Make the changes that were made after this tick; the log has them in the next one."""
        if self._changes and self._run is not None:
            self._make_due(now + self._run.world.tick)

    def look(self, current: Mission, now: float) -> tuple[ReloadMessage, ...]:
        """Make the changes that are late; called before a tick."""
        self._passes = 0
        self._make_due(now)
        return ()

    def _make_due(self, now: float) -> None:
        """Make the changes before the tick at `now`, simulated s, and those whose place never came."""
        while self._changes:
            time, change = self._changes[0]
            if time > now + _TIME_TOLERANCE or (change.passes > 0 and time > now - _TIME_TOLERANCE):
                break
            self._make(self._changes.popleft()[1])

    def _pass(self, _: str) -> None:
        """Make the changes that came after this start or end of a node."""
        assert self._run is not None
        self._passes += 1
        now = self._run.world.clock.now
        while self._changes:
            time, change = self._changes[0]
            if time > now + _TIME_TOLERANCE or change.passes != self._passes:
                return
            self._make(self._changes.popleft()[1])

    def _make(self, change: EntryChange) -> None:
        assert self._run is not None
        tree = self._run.tree
        try:
            checked_value(tree, change.key, change.value)
        except PicktreeError:
            return
        set_entry(tree, change)
