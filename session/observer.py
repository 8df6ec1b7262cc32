"""Observers of a running session, and interrupters: operators, editors of the mission, requests to stop.

The pace against the wall clock is an observer, too.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from picktree.files import PicktreeError
from picktree.world import Journal, event_types

if TYPE_CHECKING:  # The displays of the command line are observers and must be loaded at once.
    from pathlib import Path

    from picktree.logs import RunResult, Topic
    from picktree.robot import operator_desk
    from picktree.trees import Mission
    from picktree.world import Tick

    from .execution import Execution


class Observer:
    """Observer of a run. It only reads, so that a run is the same with and without it.

    A subclass overrides the methods that it needs; those of this class do nothing. An exception ends the run
    like any other: KeyboardInterrupt interrupts it.
    """

    def started(self, run: Execution, folder: Path) -> None:
        """Called once before the first tick. `folder` is the run's folder."""

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        """Called after a tick was recorded; `now` is simulated s. Simulated time is stopped during the
        call."""

    def edited(self, run: Execution) -> None:
        """Called when an edited mission has taken over: its tree is ticked from the next tick on."""

    def notified(self, now: float, text: str) -> None:
        """Called with a message that is no part of the run, such as the refusal of an edit."""

    def recorded(self, topic: Topic, at: int, data: bytes, in_digest: bool) -> None:
        """Called with every message of the log after it is written; `at` is simulated ns.

        `in_digest`: the message is part of the run's digest.
        """

    def finished(self, result: RunResult) -> None:
        """Called once with the result, after the log is finished."""


@dataclass(frozen=True, slots=True)
class ReloadMessage:
    """Message about an edit for the user; `refused`: the edit is not taken over."""

    text: str
    refused: bool = False


class Interrupter(Observer):
    """Observer that may also change or end the run: it answers questions, edits the mission, or stops."""

    pending: Mission | None = None
    """Other version of the mission. The session takes it over when the run is quiescent, and sets None."""

    def look(self, current: Mission, now: float) -> tuple[ReloadMessage, ...]:
        """Return messages for the user about edits of the mission. Called before each tick; `now` is
        simulated s."""
        return ()

    def answer(self, question: operator_desk.OperatorQuestion) -> str | None:
        """Return one of the question's choices; None: no answer.

        Without an answer the next interrupter is asked, and the run ends `paused` after the last. Simulated
        time is stopped during a question.
        """
        return None

    def halts(self) -> bool:
        """Whether the run is interrupted after the present tick, with the tree halted and the arm at rest."""
        return False

    def stops(self) -> bool:
        """Whether the run ends after the present tick, as by an interrupt."""
        return False


class PresetAnswers(Interrupter):
    """Operator with answers that were given in advance, one for each question."""

    def __init__(self, answers: Iterable[str]) -> None:
        self._left = deque(answers)

    def answer(self, question: operator_desk.OperatorQuestion) -> str | None:
        """Return the next answer. Raises PicktreeError for one that is not among the question's choices."""
        if not self._left:
            return None
        text = self._left.popleft()
        choice = question.choice(text)
        if choice is None:
            known = ", ".join(question.choices)
            raise PicktreeError(f"--answer {text}: {question.node} asks, and takes one of these: {known}")
        return choice


def answer_pending(
    desk: operator_desk.OperatorRequests, journal: Journal, operators: Sequence[Interrupter]
) -> bool:
    """Have the operators answer the pending question in turn. False when it stays without an answer.

    Simulated time is stopped until an operator answers.
    """
    question = desk.pending
    if question is None:
        return True
    answers = (operator.answer(question) for operator in operators)
    answer = next((each for each in answers if each is not None), None)
    if answer is None:
        return False
    desk.answer(answer)
    message = f"the answer is: {answer}"
    journal.note(
        event_types.OperatorAnswerEvent(message, question.node, question=question.reason, answer=answer)
    )
    return True


_MAX_CATCH_UP = 0.5
"""Maximum delay that is caught up after a slow tick, wall s; the rest of a longer one is not caught up."""


class WallClockPacer(Observer):
    """Observer that limits simulated time to `factor` times the wall clock by waiting after each tick.

    It counts the gaps between ticks at which a robot's watchdog would brake. The run itself is not affected.
    """

    def __init__(
        self,
        factor: float,
        watchdog: float = math.inf,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """`factor` is above 0: simulated seconds per wall second. `watchdog`: time after which a moving arm
        that nobody attends to brakes, simulated s."""
        self._factor = factor
        self._watchdog = watchdog
        self._clock, self._sleep = clock, sleep
        self._due: float | None = None
        self._before = 0.0
        self._last = 0.0
        self._gaps: list[float] = []

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        wall = self._clock()
        if self._due is None:
            self._due, self._before, self._last = wall, now, wall
        if wall - self._last > self._watchdog / self._factor:
            self._gaps.append(wall - self._last)
        self._last = wall
        self._due = max(self._due + (now - self._before) / self._factor, wall - _MAX_CATCH_UP)
        self._before = now
        if self._due > wall:
            self._sleep(self._due - wall)

    @property
    def lateness(self) -> str:
        """Sentence about the gaps between ticks; empty when the watchdog would have seen none."""
        if not self._gaps:
            return ""
        limit, longest = self._watchdog / self._factor, max(self._gaps)
        times = "once" if len(self._gaps) == 1 else f"{len(self._gaps)} times"
        return (
            f"pace: {times} the next tick came after more than {limit * 1000:.0f} ms of wall time "
            f"(at most {longest * 1000:.0f} ms): the watchdog of a robot would have braked the arm"
        )
