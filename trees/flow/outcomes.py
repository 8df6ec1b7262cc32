"""In which ways a node may end, and gathering them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from .failure_reasons import UNREPORTED, FailureReasons, joined
from .flow_state import (
    BETWEEN,
    LIMIT,
    NONE,
    NOTHING,
    SHARED,
    ConcurrentEffect,
    FlowState,
    States,
    merged,
    tidy,
)

if TYPE_CHECKING:
    from ..mission import NodeSpec
    from .flow_walk import FlowAnalysis


Failures: TypeAlias = Mapping[FlowState, FailureReasons]
"""States in which a node may have failed, and for which reasons."""


@dataclass(frozen=True, slots=True)
class NodeOutcomes:
    """The ends of a node that started in one state. `running`: where it may be between two ticks."""

    success: States
    failure: Failures
    skipped: States
    running: States
    missing: int = 0
    """Inputs of the sub-tree that were read although nothing had surely written them, as bits of keys."""

    @property
    def everywhere(self) -> States:
        """Every state that it may leave behind, halted or ended."""
        return frozenset((*self.success, *self.skipped, *self.failure, *self.running))

    def effect(self, entry: FlowState) -> ConcurrentEffect:
        """What it may have done to the state in which it started."""
        maybe = hand = 0
        for state in self.everywhere:
            maybe |= state.maybe
            hand |= state.hand
        return ConcurrentEffect(maybe & ~entry.maybe, hand & ~entry.hand & ~SHARED)

    def alone(self) -> NodeOutcomes:
        """The same after what went on beside it has ended."""
        failed = OutcomeCollector()
        for state, reasons in self.failure.items():
            failed.fail_at(state.alone(), reasons)
        success, skipped, running = (
            frozenset(state.alone() for state in states)
            for states in (self.success, self.skipped, self.running)
        )
        return NodeOutcomes(success, failed.flow().failure, skipped, running, self.missing)


NEVER = NodeOutcomes(NONE, {}, NONE, NONE)
"""Of a node that does not start."""


class OutcomeCollector:
    """Gathers the ends of one node."""

    __slots__ = ("_failure", "_running", "_skipped", "_success")

    def __init__(self) -> None:
        self._success: set[FlowState] = set()
        self._skipped: set[FlowState] = set()
        self._running: set[FlowState] = set()
        self._failure: dict[FlowState, FailureReasons] = {}

    def succeed(self, states: Iterable[FlowState]) -> None:
        self._success.update(states)

    def skip(self, states: Iterable[FlowState]) -> None:
        self._skipped.update(states)

    def run(self, states: Iterable[FlowState]) -> None:
        self._running.update(states)

    def fail(self, failures: Failures) -> None:
        for state, reasons in failures.items():
            self.fail_at(state, reasons)

    def fail_at(self, state: FlowState, reasons: FailureReasons) -> None:
        """Failure in that state. Without a reason it is none; with quiet ones only it is doubtful."""
        if not reasons.loud:
            if not reasons.quiet:
                return
            state = state.in_doubt()
        known = self._failure.get(state)
        self._failure[state] = reasons if known is None else joined((known, reasons))

    def take(self, flow: NodeOutcomes) -> None:
        """All ends of a child as one's own."""
        self._success.update(flow.success)
        self._skipped.update(flow.skipped)
        self._running.update(flow.running)
        self.fail(flow.failure)

    def flow(self) -> NodeOutcomes:
        return NodeOutcomes(
            tidy(frozenset(self._success)),
            tidy_failures(self._failure),
            tidy(frozenset(self._skipped)),
            tidy(frozenset(self._running), BETWEEN),
        )


def tidy_failures(failures: Failures) -> Failures:
    """Merged where there are too many states; by the hand first, as `tidy`."""
    if len(failures) <= LIMIT:
        return failures
    groups: dict[tuple[int, bool], list[FlowState]] = {}
    for state in failures:
        groups.setdefault((state.hand, state.doubtful), []).append(state)
    if len(groups) > LIMIT:
        groups.clear()
        for state in failures:
            groups.setdefault((0, state.doubtful), []).append(state)
    return {merged(group): joined(failures[state] for state in group) for group in groups.values()}


@dataclass(frozen=True, slots=True)
class TrialOutcomes:
    """After one more child: `skipped`: all so far were; `failed`: for which reasons those so far failed."""

    success: States
    running: States
    skipped: States
    failed: Failures


def try_next(
    part: NodeSpec,
    skipped: States,
    failed: Failures,
    walk: FlowAnalysis,
    meanwhile: ConcurrentEffect = NOTHING,
) -> TrialOutcomes:
    """Try the child where all before it were skipped, and where one failed."""
    first = walk.child(part, skipped, meanwhile)
    success, running, after = set(first.success), set(first.running), OutcomeCollector()
    after.fail(first.failure)
    for state, before in failed.items():
        flow = walk.child(part, (state,), meanwhile)
        success |= flow.success
        running |= flow.running
        for passed in flow.skipped:
            after.fail_at(passed, before)
        for end, now in flow.failure.items():
            after.fail_at(end, decisive(before, now))
    return TrialOutcomes(tidy(success), tidy(running), first.skipped, after.flow().failure)


def decisive(before: FailureReasons, now: FailureReasons) -> FailureReasons:
    """The reasons of the last child that gives any. What follows a reported failure is an attempt to cure it,
    and what comes out of that attempt was not left without one."""
    cured = before.loud != 0 and before.loud & UNREPORTED == 0
    reported = now.only(~UNREPORTED)
    parts = [reported.tried() if cured else reported] if reported.any else []
    if now.loud & UNREPORTED:
        parts.append(before.tried() if cured else before)
    return joined(parts)
