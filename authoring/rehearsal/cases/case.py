"""Cases as values: how the world is, how the leaves answer, what must come of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

from ....files.yaml.document import Document, Location
from .cases_schema import ObjectFile

AnswerStatus: TypeAlias = Literal["SUCCESS", "FAILURE", "SKIPPED", "RUNNING"]
EndStatus: TypeAlias = Literal["SUCCESS", "FAILURE", "SKIPPED", "RUNNING", "IDLE"]

STATUSES: tuple[AnswerStatus, ...] = ("SUCCESS", "FAILURE", "SKIPPED", "RUNNING")
OUTCOMES = ("SUCCESS", "FAILURE", "SKIPPED", "HALTED", "RUNNING")
"""How a leaf's run may have ended, besides the causes."""
ANY_LEAVES = "..."
"""In `order`: any leaves, also none."""
EMPTY_HAND = "empty"

Objects: TypeAlias = Mapping[str, ObjectFile | None]
"""By id; None: not in the belief."""


@dataclass(frozen=True, slots=True)
class Effects:
    """What is otherwise in the world once a leaf has answered."""

    facts: Mapping[str, object] = field(default_factory=dict[str, object])
    objects: Objects = field(default_factory=dict[str, "ObjectFile | None"])
    hand: str | None = None
    """An object's id, EMPTY_HAND, or None: as it follows from the leaf."""


@dataclass(frozen=True, slots=True)
class LeafAnswer:
    """What a leaf does when it is started once; `loc` is where the file says it."""

    loc: Location
    status: AnswerStatus = "SUCCESS"
    cause: str = ""
    ticks: int = 0
    """Ticks RUNNING before it ends."""
    message: str = ""
    outputs: Mapping[str, object] = field(default_factory=dict[str, object])
    then: Effects = field(default_factory=Effects)


@dataclass(frozen=True, slots=True)
class LeafScript:
    """Answers of all leaves that fit the pattern, for one start after the other."""

    loc: Location
    pattern: str
    answers: tuple[LeafAnswer, ...]
    otherwise: LeafAnswer | None = None
    """When the answers are used up; None: the last again."""

    @property
    def everything(self) -> tuple[LeafAnswer, ...]:
        return self.answers if self.otherwise is None else (*self.answers, self.otherwise)


@dataclass(frozen=True, slots=True)
class ExpectedStart:
    """One entry of `order`: the pattern of a leaf, and how its run ended; ANY_LEAVES stands for any."""

    loc: Location
    pattern: str
    outcome: str = ""


@dataclass(frozen=True, slots=True)
class ExpectedHandling:
    """A failure that some node must take up."""

    loc: Location
    cause: str
    by: str = ""
    handler: str = ""
    times: int | None = None


@dataclass(frozen=True, slots=True)
class Expectation:
    """What must come of a case; None and empty: it does not matter."""

    loc: Location
    status: EndStatus | None = None
    cause: str | None = None
    ticks: int | None = None
    order: tuple[ExpectedStart, ...] | None = None
    handled: tuple[ExpectedHandling, ...] = ()
    never: tuple[str, ...] = ()
    facts: Mapping[str, object] = field(default_factory=dict[str, object])
    objects: Objects = field(default_factory=dict[str, "ObjectFile | None"])
    blackboard: Mapping[str, object] = field(default_factory=dict[str, object])


@dataclass(frozen=True, slots=True)
class RehearsalCase:
    """One case. What the file says for all cases is laid under its own already."""

    name: str
    loc: Location
    doc: str
    parameters: Mapping[str, object]
    objects: Objects
    facts: Mapping[str, object]
    scripts: tuple[LeafScript, ...]
    halt_after: int | None
    expect: Expectation


@dataclass(frozen=True, slots=True)
class CaseFile:
    """A cases file, read. `mission` is the file that it names."""

    document: Document
    mission: Path | None
    cases: tuple[RehearsalCase, ...]
