"""Coverage of a mission's text by cases: nodes, branches of recovery and choice, both results of
conditions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from ....files.marks import Mark
from ....trees.declaration import POSTCONDITIONS
from ....world.causes import all_causes, matches
from ..stage.mission_staging import StubbedMission
from ..stage.node_roles import NodeRole
from ..stage.trace import Trace

PointKind: TypeAlias = Literal["node", "branch", "expression", "answer"]


@dataclass(frozen=True, slots=True)
class CoveragePoint:
    """Part of a mission that a case can reach. `node`: path in the tree of the file that `mark` is in."""

    kind: PointKind
    mark: Mark
    node: str
    missed: str
    """Message when no case reaches the point: `never starts`."""
    reached: bool


@dataclass(frozen=True, slots=True)
class CauseRaised:
    """Cause that a leaf declares, and whether some case makes it fail so."""

    mark: Mark
    node: str
    cause: str
    raised: bool


@dataclass(frozen=True, slots=True)
class Coverage:
    """All points in the order of the mission's text. Causes are counted apart: no mission needs them all."""

    points: tuple[CoveragePoint, ...]
    causes: tuple[CauseRaised, ...]

    @property
    def missed(self) -> tuple[CoveragePoint, ...]:
        return tuple(point for point in self.points if not point.reached)

    @property
    def full(self) -> bool:
        return not self.missed

    @property
    def reached(self) -> int:
        return len(self.points) - len(self.missed)

    @property
    def percent(self) -> int:
        """Share of reached points, %, rounded down, so that 100 means all."""
        return 100 * self.reached // len(self.points) if self.points else 100


@dataclass(slots=True)
class CoverageRecord:
    """Coverage of the cases so far, by paths in the file's trees; expressions record their own results."""

    started: set[str] = field(default_factory=set[str])
    raised: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
    answered: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])

    def take(self, staging: StubbedMission, trace: Trace) -> None:
        """Add the coverage of one case."""
        texts = staging.texts
        self.started |= {texts[path] for path in trace.started if path in texts}
        self.raised |= {(texts[path], cause) for path, cause in trace.raised if path in texts}
        self.answered |= {(texts[run.path], run.outcome) for run in trace.runs}


def coverage(staging: StubbedMission, reached: CoverageRecord) -> Coverage:
    """Return the coverage of all points; trees that are never called do not count."""
    roles = {role.text: role for role in staging.roles.all}
    points = [point for role in roles.values() for point in _points(staging, reached, role)]
    causes = [cause for role in roles.values() if role.played for cause in _causes(reached, role)]
    return Coverage(tuple(sorted(points, key=lambda p: p.mark)), tuple(causes))


def _points(staging: StubbedMission, reached: CoverageRecord, role: NodeRole) -> Iterator[CoveragePoint]:
    mark, text = role.spec.mark, role.text
    missed = f"'{role.branch}' is never used" if role.branch else "never starts"
    yield CoveragePoint("branch" if role.branch else "node", mark, text, missed, text in reached.started)
    if role.played and role.spec.node is not None and role.spec.node.kind == "condition":
        for answer in ("SUCCESS", "FAILURE"):
            yield CoveragePoint("answer", mark, text, f"never {answer}", (text, answer) in reached.answered)
    for key, expression in staging.expressions.get(text, {}).items():
        name = key.split()[0]
        place = role.spec.places.get(name, mark)
        if name in POSTCONDITIONS:
            yield CoveragePoint("expression", place, text, f"'{name}' never runs", bool(expression.seen))
        elif expression.names:
            for answer in (True, False):
                missed = f"'{key}: {expression}' is never {str(answer).lower()}"
                yield CoveragePoint("expression", place, text, missed, answer in expression.seen)


def _causes(reached: CoverageRecord, role: NodeRole) -> Iterator[CauseRaised]:
    declared = [str(cause) for cause in role.causes]
    for cause in all_causes():
        if any(matches(pattern, cause) for pattern in declared):
            raised = (role.text, cause.name) in reached.raised
            yield CauseRaised(role.spec.mark, role.text, cause.name, raised)
