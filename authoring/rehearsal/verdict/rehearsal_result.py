"""What a rehearsal came to: one value, which `text` and `to_json` render."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ....files.yaml.document import Diagnostic, Mark
from ..stage.trace import Event, FailureHandled, LeafRun
from .coverage import Coverage
from .verdict import ExpectationMiss


@dataclass(frozen=True, slots=True)
class CaseResult:
    """One case: how it ended, and what is otherwise than expected."""

    name: str
    doc: str
    mark: Mark
    status: str
    """The mission's last status."""
    cause: str
    message: str
    ticks: int
    seconds: float
    """Simulated."""
    differences: tuple[ExpectationMiss, ...]
    runs: tuple[LeafRun, ...]
    """Of the leaves, in the order in which they started."""
    handled: tuple[FailureHandled, ...]
    events: tuple[Event, ...]
    unused: tuple[Mark, ...]
    """Answers of the case's own that no leaf has given."""

    @property
    def passed(self) -> bool:
        return not self.differences


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """All cases of a file, or those that were asked for."""

    mission: str
    file: Path
    cases: tuple[CaseResult, ...]
    coverage: Coverage
    complete: bool
    """Whether all cases of the file were rehearsed."""
    warnings: tuple[Diagnostic, ...]
    """Of the cases file: what may be meant otherwise."""
    names: Mapping[str, str]
    """Short names of the nodes by their paths, for people."""

    @property
    def passed(self) -> bool:
        return all(case.passed for case in self.cases)

    @property
    def failed(self) -> tuple[CaseResult, ...]:
        return tuple(case for case in self.cases if not case.passed)
