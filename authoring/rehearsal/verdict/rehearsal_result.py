"""Result of a rehearsal as a value, which `to_text` and `to_json` render."""

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
    """Result of one case: its end, and its differences from the expectation."""

    name: str
    doc: str
    mark: Mark
    status: str
    """Last status of the mission."""
    cause: str
    message: str
    ticks: int
    seconds: float
    """Simulated time, s."""
    differences: tuple[ExpectationMiss, ...]
    runs: tuple[LeafRun, ...]
    """Runs of the leaves, in the order of their starts."""
    handled: tuple[FailureHandled, ...]
    events: tuple[Event, ...]
    unused: tuple[Mark, ...]
    """Answers of the case itself that no leaf has used."""

    @property
    def passed(self) -> bool:
        return not self.differences


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """Results of all cases of a file, or of the selected ones."""

    mission: str
    file: Path
    cases: tuple[CaseResult, ...]
    coverage: Coverage
    complete: bool
    """Whether all cases of the file were rehearsed."""
    warnings: tuple[Diagnostic, ...]
    """Warnings about the cases file."""
    names: Mapping[str, str]
    """Short names of the nodes for display, by path."""

    @property
    def passed(self) -> bool:
        return all(case.passed for case in self.cases)

    @property
    def failed(self) -> tuple[CaseResult, ...]:
        return tuple(case for case in self.cases if not case.passed)
