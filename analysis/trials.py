"""Trials of a root cause: continuations of a run with their outcomes in coarse words, and the verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, TypeAlias

from picktree.analysis.explain import GOAL, Fact, failure_fact
from picktree.logs import RunRecord, RunResult
from picktree.session import Execution, Interrupter, Session
from picktree.simulation import rests, score
from picktree.world import Tick

VARIANTS: Final = (1, 2, 3)
"""Stream variants of the continuations, the same with and without the cause."""
OFTEN: Final = 2
"""Number of continuations with the cause in which the outcome must come again."""
SETTLED: Final = 1.0
"""Time for which the items must rest at their places before a continuation is ended, simulated s."""

Verdict: TypeAlias = Literal["proven", "refuted", "not decided"]


def verdict_of(before: Sequence[bool], after: Sequence[bool], *, void: bool = False) -> Verdict:
    """Return the verdict on a cause.

    before, after: whether the outcome is there, in each continuation with the cause and without it. They are
    as few as decide. void: the removal of an event has changed nothing, so it has shown nothing.
    """
    if sum(before) >= OFTEN and len(after) == len(VARIANTS) and not any(after):
        return "proven"
    as_often = sum(after) * len(before) >= sum(before) * len(after)
    if any(before) and any(after) and as_often and min(len(before), len(after)) >= OFTEN and not void:
        return "refuted"
    return "not decided"


@dataclass(frozen=True, slots=True)
class Trial:
    """One continuation."""

    variant: int
    facts: frozenset[Fact]
    """Outcomes: items that are not where they belong, the missed goal, failures."""
    end: float
    """End of the continuation, simulated s."""
    digest: str
    cpu_seconds: float


class SettledItems(Interrupter):
    """Interrupter that ends a continuation when the asked items rest where they belong."""

    def __init__(self, items: frozenset[str], after: float, progress: Callable[[float], None]) -> None:
        """Wait for the true `items`; without any, the continuation is not ended early.

        `after`: time before which the cause may still have an effect, simulated s. Until then an item may be
        taken out of its bin.
        """
        self._items, self._after, self._progress = items, after, progress
        self._since: float | None = None
        self._over = False
        self._run: Execution | None = None

    def started(self, run: Execution, folder: Path) -> None:
        self._run = run

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        self._progress(now)
        if not self._items or self._run is None or self._run.stage is None:
            return
        if now < self._after or not self._settled():
            self._since = None
            return
        self._since = now if self._since is None else self._since
        self._over = now >= self._since + SETTLED

    def stops(self) -> bool:
        return self._over

    def _settled(self) -> bool:
        assert self._run is not None and self._run.stage is not None
        truth = self._run.stage.simulation.truth()
        scored = score(truth, self._run.recipe.scene).items
        both = [(body, item) for body, item in zip(truth, scored, strict=True) if item.id in self._items]
        return bool(both) and all(item.is_in_place and rests(body) for body, item in both)


def outcomes(session: Session, result: RunResult) -> dict[Fact, float]:
    """Return the outcomes of a session that has ended, with the costs of its failures, simulated s.

    They are the items that are not where they belong, the missed goal, and the failures of its log.
    """
    facts: dict[Fact, float] = {} if result.status == "success" else {GOAL: 0.0}
    assert session.execution.stage is not None
    truth = session.execution.stage.simulation.truth()
    scored = score(truth, session.execution.recipe.scene).items
    facts |= {f"item {item.id}": 0.0 for item in scored if not item.is_in_place}
    with RunRecord(result.folder) as run:
        recovery = run.account.recovery
        for failure in run.account.failures:
            source = failure.source
            if failure.decided.fate == "done_instead":
                continue
            fact = failure_fact(source.cause, source.id, source.item)
            number = recovery.of_failure(source.cause, source.end, source.origin or source.path)
            cost = recovery.episodes[number].seconds if number is not None else 0.0
            facts[fact] = max(facts.get(fact, 0.0), cost)
    return facts


def joint_verdict(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the verdict on a cause by those on its outcomes: it has caused one, none, or this is open."""
    found = set(verdicts)
    return "proven" if "proven" in found else "refuted" if found == {"refuted"} else "not decided"


def has_fact(trials: Sequence[Trial], fact: Fact) -> list[bool]:
    return [fact in trial.facts for trial in trials]
