"""Observers of a running session: watchers of its progress, and operators who answer its questions."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

from ..cell.operator_desk import OperatorQuestion, OperatorRequests
from ..errors import PicktreeError
from ..logs.run_result import RunResult
from ..trees.running.runner import NodeInfo, TickReport
from ..world.events.run_events import OperatorAnswerEvent
from ..world.journal import Journal


class Operator(Protocol):
    """Source of answers to a run's questions. Simulated time stands still during a question."""

    def answer(self, question: OperatorQuestion) -> str | None:
        """Return one of the question's choices; None when there is no answer, and the run ends `paused`."""
        ...


class PresetAnswers:
    """Operator with answers that were given in advance, one for each question; then `after` answers."""

    def __init__(self, answers: Iterable[str], after: Operator | None = None) -> None:
        self._left = deque(answers)
        self._after = after

    def answer(self, question: OperatorQuestion) -> str | None:
        """Return the next answer. Raises PicktreeError for one that is not among the question's choices."""
        if not self._left:
            return self._after.answer(question) if self._after else None
        said = self._left.popleft()
        choice = question.choice(said)
        if choice is None:
            known = ", ".join(question.choices)
            raise PicktreeError(f"--answer {said}: {question.node} asks, and takes one of these: {known}")
        return choice


class RecordedAnswers:
    """Operator with the answers of a log, each for the node that asked.

    When another node asks, or the choices do not contain the answer, `after` answers from then on.
    """

    def __init__(self, answers: Iterable[tuple[str, str]], after: Operator | None = None) -> None:
        """Take pairs of the asking node's path and the answer."""
        self._left = deque(answers)
        self._after = after

    def answer(self, question: OperatorQuestion) -> str | None:
        if self._left:
            node, said = self._left.popleft()
            if node == question.node and said in question.choices:
                return said
            self._left.clear()
        return self._after.answer(question) if self._after else None


def answer_pending(desk: OperatorRequests, journal: Journal, operator: Operator | None) -> bool:
    """Have the operator answer the pending question. False when it stays without an answer.

    Simulated time stands still while a person thinks.
    """
    question = desk.pending
    if question is None:
        return True
    answer = operator.answer(question) if operator else None
    if answer is None:
        return False
    desk.answer(answer)
    message = f"the answer is: {answer}"
    journal.note(OperatorAnswerEvent(message, question.node, question=question.reason, answer=answer))
    return True


class SessionWatcher(Protocol):
    """Watcher of a run's progress. It cannot change the run."""

    def started(self, structure: tuple[NodeInfo, ...], folder: Path) -> None: ...
    def ticked(self, now: float, report: TickReport, items_done: int, items_total: int) -> None: ...
    def edited(self, structure: tuple[NodeInfo, ...]) -> None:
        """Receive the tree of an edited mission, which is ticked from the next tick on."""
        ...

    def told(self, now: float, text: str) -> None:
        """Receive a message that is no part of the run, such as the refusal of an edit."""
        ...

    def finished(self, result: RunResult) -> None: ...
