"""Questions to the operator: one pending question, and its answer once the operator has given one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from picktree.world import Plain

GO_ON: Final = "go on"
SET_ASIDE: Final = "set aside"
GIVE_UP: Final = "give up"


@dataclass(frozen=True, slots=True)
class OperatorQuestion:
    """Question to the operator, with the situation of the asking node."""

    node: str
    """Path of the node that asks."""
    reason: str
    choices: tuple[str, ...]
    """Possible answers; at least one."""
    object: str = ""
    """Object that the question is about; empty: none in particular."""
    situation: str = ""
    """Summary of the robot's belief, in one sentence."""

    def to_json(self) -> dict[str, Plain]:
        return {**asdict(self), "choices": list(self.choices)}

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> OperatorQuestion:
        """Return the question that `to_json` has written. Raises KeyError or TypeError for other data."""
        choices = tuple(str(choice) for choice in record["choices"])
        return cls(record["node"], record["reason"], choices, record["object"], record["situation"])

    def choice(self, text: str) -> str | None:
        """Return the choice for a text: its number from 1 on, its name, or an unambiguous beginning of it.
        None without such a choice.

        >>> OperatorQuestion("Main/Ask", "it is stuck", ("continue", "give up")).choice("GIVE")
        'give up'
        >>> OperatorQuestion("Main/Ask", "it is stuck", ("continue", "give up")).choice("2")
        'give up'
        """
        wanted = " ".join(text.split()).casefold()
        if not wanted:
            return None
        same = [choice for choice in self.choices if choice.casefold() == wanted]
        if same:
            return same[0]
        if wanted.isdecimal() and 1 <= int(wanted) <= len(self.choices):
            return self.choices[int(wanted) - 1]
        begun = [choice for choice in self.choices if choice.casefold().startswith(wanted)]
        return begun[0] if len(begun) == 1 else None


class OperatorRequests:
    """Slot for one question to the operator and its answer. A node puts a question here and polls for the
    answer in later ticks. The program that runs the mission looks here after each tick and adds the answer.

    It is no part of a checkpoint: who waits for an answer asks again after it.
    """

    def __init__(self) -> None:
        self._question: OperatorQuestion | None = None
        self._answer: str | None = None

    @property
    def pending(self) -> OperatorQuestion | None:
        """Question that waits for an answer; None without one."""
        return self._question if self._answer is None else None

    @property
    def answered(self) -> bool:
        """Whether there is an answer that no node has taken yet."""
        return self._answer is not None

    def ask(self, question: OperatorQuestion) -> None:
        """Put a question; it replaces an earlier one."""
        self._question, self._answer = question, None

    def answer(self, choice: str) -> None:
        """Answer the pending question with one of its choices. Raises ValueError for any other answer."""
        if self._question is None or choice not in self._question.choices:
            raise ValueError(f"nobody waits for the answer {choice!r}")
        self._answer = choice

    def waits(self, node: str) -> bool:
        """Whether this node's question is here, answered or not."""
        return self._question is not None and self._question.node == node

    def take(self, node: str) -> str | None:
        """Return the answer to this node's question and clear both; None while there is no answer."""
        if not self.waits(node) or self._answer is None:
            return None
        answer = self._answer
        self._question = self._answer = None
        return answer

    def withdraw(self, node: str) -> None:
        """Remove the question of this node, if it is here."""
        if self.waits(node):
            self._question = self._answer = None
