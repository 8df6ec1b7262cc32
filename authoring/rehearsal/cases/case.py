"""Cases as values: state of the world, answers of the leaves, and expectations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

from ....files.marks import Location
from ....files.yaml.document import Document
from .cases_schema import ObjectFile

AnswerStatus: TypeAlias = Literal["SUCCESS", "FAILURE", "SKIPPED", "RUNNING"]
EndStatus: TypeAlias = Literal["SUCCESS", "FAILURE", "SKIPPED", "RUNNING", "IDLE"]

STATUSES: tuple[AnswerStatus, ...] = ("SUCCESS", "FAILURE", "SKIPPED", "RUNNING")
OUTCOMES = ("SUCCESS", "FAILURE", "SKIPPED", "HALTED", "RUNNING")
"""Possible ends of a leaf's run, besides the causes."""
ANY_LEAVES = "..."
"""Entry of `order` for any number of leaves, also none."""
EMPTY_HAND = "empty"

Objects: TypeAlias = Mapping[str, ObjectFile | None]
"""Objects by id; None: not in the belief."""


@dataclass(frozen=True, slots=True)
class Effects:
    """Changes of the world after a leaf's answer."""

    facts: Mapping[str, object] = field(default_factory=dict[str, object])
    objects: Objects = field(default_factory=dict[str, "ObjectFile | None"])
    hand: str | None = None
    """Id of an object, or EMPTY_HAND; None: as the leaf's declaration implies."""


@dataclass(frozen=True, slots=True)
class LeafAnswer:
    """Answer of a leaf to one start; `loc` is its place in the file."""

    loc: Location
    status: AnswerStatus = "SUCCESS"
    cause: str = ""
    ticks: int = 0
    """Number of ticks RUNNING before the end."""
    message: str = ""
    outputs: Mapping[str, object] = field(default_factory=dict[str, object])
    then: Effects = field(default_factory=Effects)


@dataclass(frozen=True, slots=True)
class LeafScript:
    """Answers of all leaves that match the pattern, one start after the other."""

    loc: Location
    pattern: str
    answers: tuple[LeafAnswer, ...]
    otherwise: LeafAnswer | None = None
    """Answer when the others are used up; None: the last one repeats."""

    @property
    def everything(self) -> tuple[LeafAnswer, ...]:
        return self.answers if self.otherwise is None else (*self.answers, self.otherwise)


@dataclass(frozen=True, slots=True)
class ExpectedStart:
    """One entry of `order`: pattern of a leaf, and end of its run; ANY_LEAVES matches any leaves."""

    loc: Location
    pattern: str
    outcome: str = ""


@dataclass(frozen=True, slots=True)
class ExpectedHandling:
    """Failure that a node must handle."""

    loc: Location
    cause: str
    by: str = ""
    handler: str = ""
    times: int | None = None


@dataclass(frozen=True, slots=True)
class Expectation:
    """Expected result of a case; None or empty: any."""

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
    """One case, merged with the settings for all cases of the file."""

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
    """Content of a cases file. `mission` is the file that it names."""

    document: Document
    mission: Path | None
    cases: tuple[RehearsalCase, ...]
