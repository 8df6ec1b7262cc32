"""How recovery may go: after which failures what is run, and with which causes it fails for good."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING

from ..trees.flow import UNREPORTED, Ends, Flow, Reasons, State, States, joined, tidy
from ..world.causes import tree

if TYPE_CHECKING:
    from ..trees.flow.walk import Walk
    from ..trees.mission import NodeSpec


@dataclass(frozen=True, slots=True)
class Cure:
    """What is run after a failure that the pattern matches."""

    label: str
    pattern: str
    node: NodeSpec


@dataclass(frozen=True, slots=True)
class Recovery:
    """A node of the text that cures failures. `runs`: how often `tried` may run; None: it is not known."""

    tried: NodeSpec
    cures: tuple[Cure, ...]
    resort: NodeSpec | None
    runs: float | None
    skipped_cure_fails: bool = False

    def flow(self, spec: NodeSpec, entry: State, walk: Walk) -> Flow:
        return _Rounds(self, spec, walk).flow(entry)


class _Rounds:
    """One run of `tried` after the other, each but the first after a cure."""

    def __init__(self, recovery: Recovery, spec: NodeSpec, walk: Walk) -> None:
        self._recovery, self._spec, self._walk = recovery, spec, walk
        self._ends = Ends()
        self._used_up = walk.fails(spec, walk.causes.of((tree.ATTEMPTS,)))
        self._cured: set[State] = set()

    def flow(self, entry: State) -> Flow:
        states: States = frozenset((entry,))
        seen: States = frozenset()
        for run in count(1):
            self._run(states, run)
            # The first run is by itself: after it nothing is used up yet.
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

    def _why_not(self, cure: Cure) -> str:
        if self._recovery.runs == 1:
            return f"{self._recovery.tried.name} may run once only, so there is no run after it"
        return f"{self._recovery.tried.name} never fails with what it is for"

    def _run(self, states: States, run: int) -> None:
        ends, runs = self._ends, self._recovery.runs
        flow = self._walk.child(self._recovery.tried, states)
        ends.succeed(flow.success)
        ends.skip(flow.skipped)
        ends.run(flow.running)
        more = runs is None or run < runs
        used_up = run > 1 or runs is None or runs <= 1
        for state, reasons in flow.failure.items():
            left = self._reported(reasons)
            for cure in self._recovery.cures:
                pattern = self._walk.causes.matching(cure.pattern)
                caught, left = left.only(pattern), left.only(~pattern)
                if not caught.any:
                    continue
                at = state if caught.loud else state.in_doubt()
                if more:
                    self._walk.handles(self._spec, cure.label)
                    self._cure(cure, at, caught.tried())
                if used_up:
                    self._give_up(at, caught if runs is not None and runs <= 1 else caught.tried())
            if left.any:
                self._give_up(state if left.loud else state.in_doubt(), left)

    def _reported(self, reasons: Reasons) -> Reasons:
        """A condition that does not hold counts as tree.attempts."""
        if not reasons.any & UNREPORTED:
            return reasons
        return joined((reasons.only(~UNREPORTED), self._used_up))

    def _cure(self, cure: Cure, state: State, caught: Reasons) -> None:
        self._ends.run((state,))
        flow = self._walk.child(cure.node, (state,))
        self._ends.run(flow.running)
        self._goes_on(flow.success)
        if self._recovery.skipped_cure_fails:
            for after in flow.skipped:
                self._ends.fail_at(after, caught)
        else:
            self._goes_on(flow.skipped)
        for after in flow.failure:
            self._ends.fail_at(after, caught)

    def _goes_on(self, states: Iterable[State]) -> None:
        self._cured |= set(states)
        self._ends.run(states)

    def _give_up(self, state: State, reasons: Reasons) -> None:
        if self._recovery.resort is None:
            self._ends.fail_at(state, reasons)
            return
        flow = self._walk.child(self._recovery.resort, (state,))
        self._ends.run(flow.running)
        for after in (*flow.success, *flow.skipped, *flow.failure):
            self._ends.fail_at(after, reasons.tried())
