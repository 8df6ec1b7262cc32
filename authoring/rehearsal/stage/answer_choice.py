"""Choice of a leaf's answer at its start."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ....files.node_patterns import node_matches
from ....files.yaml.document import Location
from ..cases.case import LeafAnswer, LeafScript


@dataclass(slots=True)
class _Turns:
    script: LeafScript
    given: int = 0


class ScriptedAnswers:
    """Answers by start count of each pattern; the first pattern that matches a node counts."""

    def __init__(self, scripts: Iterable[LeafScript]) -> None:
        self._turns = [_Turns(script) for script in scripts]

    def answer(self, path: str) -> LeafAnswer | None:
        """Return the next answer of the leaf at that path; None when the case gives none."""
        turns = next((t for t in self._turns if node_matches(t.script.pattern, path)), None)
        if turns is None or not turns.script.answers:
            return None
        number, turns.given = turns.given, turns.given + 1
        if number < len(turns.script.answers):
            return turns.script.answers[number]
        return turns.script.otherwise or turns.script.answers[-1]

    def unused(self) -> tuple[Location, ...]:
        """Return the places of answers that no leaf has used."""
        return tuple(
            answer.loc
            for turns in self._turns
            for number, answer in enumerate(turns.script.everything)
            if number >= turns.given
        )
