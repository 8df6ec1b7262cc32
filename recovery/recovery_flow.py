"""How recovery may go: after which failures what is run, and with which causes it fails for good."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING

from ..trees.flow import (
    UNREPORTED,
    FailureReasons,
    Failures,
    FlowState,
    NodeOutcomes,
    OutcomeCollector,
    States,
    joined,
    tidy,
)
from ..world.causes import internal, tree

if TYPE_CHECKING:
    from ..trees.flow.flow_walk import FlowAnalysis
    from ..trees.mission import NodeSpec


OUTPUTS = ("attempt", "cause", "message", "failed")
"""What a node that cures failures tells those below; written when it starts."""


@dataclass(frozen=True, slots=True)
class CureStep:
    """What is run after a failure that the pattern matches."""

    label: str
    pattern: str
    node: NodeSpec


@dataclass(frozen=True, slots=True)
class RecoverySpec:
    """A node of the text that cures failures. `runs`: how often `tried` may run; None: it is not known."""

    tried: NodeSpec
    cures: tuple[CureStep, ...]
    resort: NodeSpec | None
    runs: float | None
    skipped_cure_fails: bool = False

    def flow(self, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        return _Rounds(self, spec, walk).flow(entry)


class _Rounds:
    """One run of `tried` after the other, each but the first after a cure."""

    def __init__(self, recovery: RecoverySpec, spec: NodeSpec, walk: FlowAnalysis) -> None:
        self._recovery, self._spec, self._walk = recovery, spec, walk
        self._ends = OutcomeCollector()
        self._used_up = walk.fails(spec, walk.causes.of((tree.ATTEMPTS,)))
        self._fault = walk.fails(spec, 0, walk.causes.matching(str(internal.ANY)))
        self._outputs = walk.keys_of(spec, OUTPUTS)
        self._cured: set[FlowState] = set()

    def flow(self, entry: FlowState) -> NodeOutcomes:
        states: States = frozenset((entry.written(self._outputs),))
        seen: States = frozenset()
        for run in count(1):
            self._run(states, run)
            seen = tidy(seen | states) if run > 1 else seen
            states = tidy(self._cured)
            self._cured = set()
            if not states or tidy(seen | states) == seen:
                break
        for cure in self._recovery.cures:
            self._walk.unreached(cure.node, self._why_not(cure))
        if self._recovery.resort is not None:
            self._walk.unreached(self._recovery.resort, f"{self._recovery.tried.name} never fails for good")
        return self._ends.flow()

    def _why_not(self, cure: CureStep) -> str:
        if self._recovery.runs == 1:
            return f"{self._recovery.tried.name} may run once only, so there is no run after it"
        fails = "never fails" if cure is self._recovery.cures[0] else "never fails with another cause"
        return f"{self._recovery.tried.name} {fails}"

    def _run(self, states: States, run: int) -> None:
        ends, recovery, runs = self._ends, self._recovery, self._recovery.runs
        flow = self._walk.child(recovery.tried, states)
        ends.succeed(flow.success)
        ends.skip(flow.skipped)
        ends.run(flow.running)
        # The first run is by itself: after it nothing is used up yet.
        used_up = run > 1 or runs is None or runs <= 1
        given_up: list[Failures] = []
        left = {state: self._reported(reasons) for state, reasons in flow.failure.items()}
        if any(_names_faults(cure) for cure in recovery.cures):
            # Whoever names it wants it handled; it may happen in any node, at any time.
            for state in tidy(frozenset((*states, *flow.everywhere))):
                at = state.in_doubt()
                left[at] = joined((left[at], self._fault)) if at in left else self._fault
        for cure in recovery.cures:
            pattern = self._walk.causes.matching(cure.pattern)
            caught, left = _narrowed(left, pattern), _narrowed(left, ~pattern)
            if not caught:
                continue
            if runs is None or run < runs:
                self._walk.handles(self._spec, cure.label)
                self._cure(cure, caught)
            if used_up:
                once = runs is not None and runs <= 1
                given_up.append(caught if once else {s: reasons.tried() for s, reasons in caught.items()})
        for failures in (*given_up, left):
            self._give_up(failures)

    def _reported(self, reasons: FailureReasons) -> FailureReasons:
        """A condition that does not hold counts as tree.attempts."""
        if not reasons.any & UNREPORTED:
            return reasons
        return joined((reasons.only(~UNREPORTED), self._used_up))

    def _cure(self, cure: CureStep, caught: Failures) -> None:
        starts, reasons = tidy(caught), joined(caught.values()).tried()
        self._ends.run(starts)
        flow = self._walk.child(cure.node, starts)
        self._ends.run(flow.running)
        goes_on, fails = set(flow.success), set(flow.failure)
        (fails if self._recovery.skipped_cure_fails else goes_on).update(flow.skipped)
        self._cured |= goes_on
        self._ends.run(goes_on)
        self._ends.fail(dict.fromkeys(fails, reasons))

    def _give_up(self, failures: Failures) -> None:
        if self._recovery.resort is None or not failures:
            self._ends.fail(failures)
            return
        flow = self._walk.child(self._recovery.resort, tidy(failures))
        self._ends.run(flow.running)
        reasons = joined(failures.values()).tried()
        self._ends.fail(dict.fromkeys((*flow.success, *flow.skipped, *flow.failure), reasons))


def _names_faults(cure: CureStep) -> bool:
    return cure.pattern in (internal.ERROR.name, str(internal.ANY))


def _narrowed(failures: Failures, mask: int) -> Failures:
    """The failures as far as their causes are in the mask."""
    found: dict[FlowState, FailureReasons] = {}
    for state, reasons in failures.items():
        if not reasons.any & mask:
            continue
        left = reasons.only(mask)
        at = state if left.loud else state.in_doubt()
        found[at] = joined((found[at], left)) if at in found else left
    return found
