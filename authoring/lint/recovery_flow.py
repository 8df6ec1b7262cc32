"""Outcomes of nodes that recover: after which failures a handler runs, and which causes end the node."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count

from ...trees.flow import FAILURE, RUNNING, Recovery
from ...trees.mission import NodeSpec
from ...world.causes import internal
from .failure_reasons import UNREPORTED, FailureReasons, joined
from .flow_walk import FlowWalk
from .outcomes import Failures, FlowState, Outcomes, States, tidy

OTHERS = "*"
"""Pattern of a handler for all causes that are left."""


@dataclass(frozen=True, slots=True)
class Handler:
    """A branch that runs after a failure that the pattern matches; `label` is the handler's key."""

    label: str
    pattern: str
    node: NodeSpec

    @property
    def names_faults(self) -> bool:
        return self.pattern in (internal.ERROR.name, str(internal.ANY))


class RecoveryWalk:
    """One run of the first child after the other, each but the first after a handler."""

    def __init__(self, spec: NodeSpec, flow: Recovery, walk: FlowWalk) -> None:
        assert spec.node is not None
        node = spec.node.declaration
        self._spec, self._flow, self._walk = spec, flow, walk
        runs = walk.number(spec, flow.runs)
        self._runs = None if runs is None else runs + flow.first_is_free
        self._tried = spec.children[0]
        self._resort = next((part for _, part in spec.slots.get(flow.resort, ())), None)
        self._handlers = [
            Handler(label, label, part)
            if slot.of == "cause"
            else Handler(slot.key if slot.arity == "one" else part.name, OTHERS, part)
            for slot in sorted(node.slots, key=lambda slot: slot.of)
            for label, part in spec.slots.get(slot.key, ())
            if part is not self._tried and part is not self._resort
        ]
        self._ends = Outcomes()
        self._used_up = walk.fails(spec, walk.causes.of(node.causes))
        self._fault = walk.fails(spec, 0, walk.causes.matching(str(internal.ANY)))
        self._outputs = walk.keys_of(spec, (port.key for port in node.outputs))

    def outcomes(self, entry: FlowState) -> Outcomes:
        """Return the outcomes of the node."""
        states: States = frozenset((entry.written(self._outputs),))
        seen: States = frozenset()
        for run in count(1):
            cured = tidy(self._run(states, run))
            seen = tidy(seen | states) if run > 1 else seen
            states = cured
            if not states or tidy(seen | states) == seen:
                break
        for handler in self._handlers:
            self._walk.unreached(handler.node, self._why_not(handler))
        if self._resort is not None:
            self._walk.unreached(self._resort, f"{self._tried.name} never fails for good")
        return self._ends.tidied()

    def _why_not(self, handler: Handler) -> str:
        if self._runs == 1:
            return f"{self._tried.name} may run once only, so there is no run after it"
        fails = "never fails" if handler is self._handlers[0] else "never fails with another cause"
        return f"{self._tried.name} {fails}"

    def _run(self, states: States, run: int) -> set[FlowState]:
        """Collect the ends of one run; return the states in which the next begins."""
        flow, cured = self._walk.child(self._tried, states), set[FlowState]()
        self._ends.take(_without_failures(flow))
        left = self._failures(states, flow)
        given_up: list[Failures] = []
        for handler in self._handlers:
            pattern = self._walk.causes.matching(handler.pattern)
            caught, left = _narrowed(left, pattern), _narrowed(left, ~pattern)
            if not caught:
                continue
            if self._runs is None or run < self._runs:
                self._walk.handles(self._spec, handler.label)
                cured |= self._handle(handler, caught)
            # The first run is by itself: after it nothing is used up yet.
            if self._runs is None or self._runs <= 1:
                once = self._runs is not None
                given_up.append(caught if once else _tried(caught))
            elif run > 1:
                given_up.append(_tried(caught))
        for failures in (*given_up, left):
            self._give_up(failures)
        return cured

    def _failures(self, states: States, flow: Outcomes) -> Failures:
        """Return the failures of a run. A condition that does not hold counts as a cause of the node."""
        found: dict[FlowState, FailureReasons] = {}
        for state, reasons in flow.failure.items():
            found[state] = reasons
            if reasons.any & UNREPORTED:
                found[state] = joined((reasons.only(~UNREPORTED), self._used_up))
        if any(handler.names_faults for handler in self._handlers):
            # It may happen in any node, at any time.
            for state in tidy(frozenset((*states, *flow.everywhere))):
                at = state.in_doubt()
                found[at] = joined((found[at], self._fault)) if at in found else self._fault
        return found

    def _handle(self, handler: Handler, caught: Failures) -> set[FlowState]:
        starts, reasons = tidy(caught), joined(caught.values()).tried()
        flow = self._walk.child(handler.node, starts)
        goes_on, fails = set(flow.success), set(flow.failure)
        (fails if self._flow.skipped_handler is FAILURE else goes_on).update(flow.skipped)
        self._ends.add(RUNNING, (*starts, *flow.running, *goes_on))
        self._ends.add(FAILURE, fails, reasons)
        return goes_on

    def _give_up(self, failures: Failures) -> None:
        if self._resort is None or not failures:
            self._ends.fail(failures)
            return
        flow = self._walk.child(self._resort, tidy(failures))
        self._ends.add(RUNNING, flow.running)
        reasons = joined(failures.values()).tried()
        self._ends.add(FAILURE, (*flow.success, *flow.skipped, *flow.failure), reasons)


def _without_failures(flow: Outcomes) -> Outcomes:
    ends = Outcomes()
    ends.success, ends.skipped, ends.running = flow.success, flow.skipped, flow.running
    return ends


def _tried(failures: Failures) -> Failures:
    return {state: reasons.tried() for state, reasons in failures.items()}


def _narrowed(failures: Failures, mask: int) -> Failures:
    """The failures as far as their causes are in the mask."""
    found = Outcomes()
    for state, reasons in failures.items():
        if reasons.any & mask:
            found.add(FAILURE, (state,), reasons.only(mask))
    return found.failure
