"""Whoever looks on while a mission runs."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

from ..cell.operator_desk import OperatorQuestion, OperatorRequests
from ..errors import PicktreeError
from ..logs.run_result import RunResult
from ..trees.running.runner import NodeInfo, TickReport
from ..world.journal import Journal, JournalEvent, Plain


class Operator(Protocol):
    """Answers questions; simulated time stands still meanwhile."""

    def answer(self, question: OperatorQuestion) -> str | None:
        """One of the question's choices; None when there is nobody who says: the run ends `paused`."""
        ...


class PresetAnswers:
    """Answers that were given before anybody asked, one for each question; then whoever comes after."""

    def __init__(self, answers: Iterable[str], after: Operator | None = None) -> None:
        self._left = deque(answers)
        self._after = after

    def answer(self, question: OperatorQuestion) -> str | None:
        """Raises PicktreeError for an answer that the question does not know."""
        if not self._left:
            return self._after.answer(question) if self._after else None
        said = self._left.popleft()
        choice = question.choice(said)
        if choice is None:
            known = ", ".join(question.choices)
            raise PicktreeError(f"--answer {said}: {question.node} asks, and takes one of these: {known}")
        return choice


class RecordedAnswers:
    """Answers that a log holds, each to the node that asked; where another asks now, or takes no such answer,
    whoever comes after is asked, from then on."""

    def __init__(self, answers: Iterable[tuple[str, str]], after: Operator | None = None) -> None:
        """`answers`: path of who asked, and what was answered."""
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
    data: dict[str, Plain] = {"question": question.reason, "answer": answer}
    journal.note(JournalEvent("operator_answer", f"the answer is: {answer}", question.node, data))
    return True


class SessionWatcher(Protocol):
    """Whoever looks on; nothing that it does changes the run."""

    def started(self, structure: tuple[NodeInfo, ...], folder: Path) -> None: ...
    def ticked(self, now: float, report: TickReport, items_done: int, items_total: int) -> None: ...
    def edited(self, structure: tuple[NodeInfo, ...]) -> None:
        """From the next tick on the tree is that of an edited mission."""
        ...

    def told(self, now: float, text: str) -> None:
        """Something that is no part of the run, as that an edit is refused."""
        ...

    def finished(self, result: RunResult) -> None: ...
