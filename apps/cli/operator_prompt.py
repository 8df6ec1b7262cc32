"""Prompt of the operator at the terminal, when a mission asks for help."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TextIO

from picktree.robot import operator_desk
from picktree.session import Interrupter


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
                    said = self._read()
                except EOFError:
                    self._say("")
                    return None
                choice = question.choice(said)
                if choice is not None:
                    return choice
                if said.strip():
                    self._say(f"{said.strip()!r} is none of them: write a number or the beginning of one")

    def _say(self, *lines: str) -> None:
        for line in lines:
            print(line, file=self._out, flush=True)


def operators(out: TextIO, aside: Callable[[], AbstractContextManager[None]]) -> tuple[PersonAtTerminal, ...]:
    """Return the operator's prompt; empty when stdin is no terminal."""
    return (PersonAtTerminal(out, aside),) if sys.stdin.isatty() else ()
