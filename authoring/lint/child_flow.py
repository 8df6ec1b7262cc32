"""Outcomes of nodes that tick their children one after the other, by choice, in turn, in loops or once."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import inf
from typing import cast

from ...files.expressions.expression import Expression
from ...trees.controls.branches import is_case
from ...trees.flow import (
    AGAIN,
    FAILURE,
    IDLE,
    NEXT,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Branch,
    ChildFlow,
    Choice,
    Lead,
    Loop,
    Once,
    Turns,
)
from ...trees.mission import NodeSpec
from ...trees.status import NodeStatus
from ...trees.values.port_types import show
from ...trees.values.references import Constant
from .failure_reasons import NO_REPORT, UNREPORTED, FailureReasons, joined
from .flow_walk import FlowWalk
from .outcomes import NOTHING, Failures, FlowState, Outcomes, States, decisive, tidy


@dataclass
class _Pass:
    """One pass over the children; `over`: where it comes past the last of them."""

    over: Outcomes
    running: set[FlowState] = field(default_factory=set[FlowState])
    again: set[FlowState] = field(default_factory=set[FlowState])
    """States in which the next pass begins."""


class ChildWalk:
    """Walk over the children of one node that starts in one state."""

    def __init__(self, spec: NodeSpec, flow: ChildFlow, walk: FlowWalk) -> None:
        assert spec.node is not None
        self._spec, self._flow, self._walk = spec, flow, walk
        self._node = spec.node.declaration
        self._ends = Outcomes()
        self._least, self._most = self._runs(flow) if isinstance(flow, Loop) else (1, 1)
        self._mark = 0
        """Flags that success sets."""
        never = flow.own_unless and walk.number(spec, flow.own_unless) == 0
        self._own = dict[NodeStatus, NodeStatus]() if never else flow.own

    def outcomes(self, entry: FlowState) -> Outcomes:
        """Return the outcomes of the node."""
        flow, spec, walk, ends = self._flow, self._spec, self._walk, self._ends
        match flow:
            case Once():
                return self._once(flow, entry)
            case Turns():
                return self._in_turn(flow, entry)
            case Choice() if self._may_fit_no_case():
                ends.add(FAILURE, (entry,), self._own_reasons)
            case _:
                pass
        if isinstance(flow, Loop) and self._node.causes:
            _ = self._own_reasons
        if self._least == 0:
            ends.add(SUCCESS if flow.success is AGAIN else FAILURE, (entry,), self._missing_reasons)
        if self._most == 0:
            loop = cast("Loop", flow)
            why = "there is no element" if loop.each_of else f"{loop.runs} is 0"
            walk.unreached(spec.children[0], why)
            return ends
        starts: States = frozenset((entry,))
        while True:
            arriving = Outcomes()
            arriving.skipped = self._begun(starts)
            passed = self._pass(spec.children, arriving)
            ends.take(passed.over)
            after = tidy(starts | passed.again)
            if after == starts:
                break
            starts = after
        if IDLE in self._own:
            ends.add(self._own[IDLE], (entry,), self._own_reasons)
        return ends.tidied()

    # What the node's ports say.

    @cached_property
    def _own_reasons(self) -> FailureReasons:
        return self._walk.fails(self._spec, self._walk.causes.of(self._node.causes))

    @cached_property
    def _missing_reasons(self) -> FailureReasons:
        """Reasons in place of a report that no child gives."""
        return self._own_reasons if self._node.causes else NO_REPORT

    def _runs(self, loop: Loop) -> tuple[float, float]:
        """Return the least and the greatest number of runs that are allowed."""
        least = most = inf
        if loop.runs:
            number = self._walk.number(self._spec, loop.runs)
            least, most = (0, inf) if number is None else (inf, inf) if number < 0 else (number, number)
        if loop.each_of:
            items = self._walk.literal(self._spec, loop.each_of)
            length = len(cast("list[object]", items)) if isinstance(items, list) else None
            least, most = min(least, length or 0), min(most, inf if length is None else length)
        return least, most

    def _begun(self, starts: States) -> States:
        """Return the states in which the first child starts."""
        loop = self._flow
        if not isinstance(loop, Loop):
            return starts
        guard = self._walk.literal(self._spec, loop.guard) if loop.guard else None
        if isinstance(guard, Expression):
            asked = self._walk.ask(self._spec, loop.guard, guard, starts)
            self._ends.add(SUCCESS, asked.no)
            self._ends.fail(asked.failed)
            starts = asked.yes
            if not starts:
                self._walk.unreached(self._spec.children[0], f"its {loop.guard} never holds")
        outputs = self._walk.keys_of(self._spec, (port.key for port in self._node.outputs))
        return tidy(state.written(outputs) for state in starts)

    @cached_property
    def _chosen(self) -> tuple[NodeSpec, ...]:
        """Cases, and the default, that the value may lead to; one at most where the text says the value."""
        key, cases, default = _choice(self._spec)
        bound = self._spec.ports[key]
        if not isinstance(bound, Constant):
            return self._spec.children
        case = next((part for name, part in cases if is_case(bound.value, name)), None)
        return default if case is None else (case,)

    def _may_fit_no_case(self) -> bool:
        chosen, (key, _, default) = self._chosen, _choice(self._spec)
        return not chosen or (not default and self._walk.literal(self._spec, key) is None)

    # One pass over children.

    def _pass(self, parts: tuple[NodeSpec, ...], first: Outcomes) -> _Pass:
        flow, walk = self._flow, self._walk
        arriving = [first, *(Outcomes() for _ in parts)]
        if isinstance(flow, Choice):
            chosen = self._chosen
            none = Outcomes()
            arriving[:-1] = [first if any(part is one for one in chosen) else none for part in parts]
        passed = _Pass(arriving[-1])
        meanwhile, before = NOTHING, ""
        for index, part in enumerate(parts):
            arrival = arriving[index]
            if not arrival.everywhere:
                if before or isinstance(flow, Choice):
                    walk.unreached(part, self._why_not(before, index))
                continue
            groups = [(SKIPPED, arrival.skipped, None), (SUCCESS, arrival.success, None)]
            groups += [(FAILURE, frozenset((state,)), why) for state, why in arrival.failure.items()]
            if isinstance(flow, Branch):
                targets = [arriving[min(index + step, len(parts))] for step in (1, 2)]
            else:
                targets = [arriving[index + 1]] * 2
            for came, states, why in groups:
                if states:
                    outcomes = walk.child(part, states, meanwhile)
                    self._lead(index, outcomes, came, why, targets, passed)
            for target in targets:
                target.tidied()
            if flow.reactive and not isinstance(flow, Choice) and not (isinstance(flow, Branch) and index):
                meanwhile = meanwhile.with_(walk.effect(part, arrival.everywhere))
            before = before if isinstance(flow, Branch) and index else part.name
        return passed

    def _why_not(self, before: str, index: int) -> str:
        flow = self._flow
        if isinstance(flow, Choice):
            return f"the value is always {show(self._walk.literal(self._spec, _choice(self._spec)[0]))}"
        succeeds = index == 1 if isinstance(flow, Branch) else flow.success is NEXT
        return f"{before} before it never {'succeeds' if succeeds else 'fails'}"

    def _lead(
        self,
        index: int,
        outcomes: Outcomes,
        came: NodeStatus,
        before: FailureReasons | None,
        targets: list[Outcomes],
        passed: _Pass,
    ) -> None:
        """Follow the results of a child: to the next child, to another pass, or to the end of the node."""
        flow, ends = self._flow, self._ends
        for status, state, reasons in outcomes:
            if status is RUNNING:
                ends.add(RUNNING, (state,))
                passed.running.add(state)
                if flow.reactive:
                    self._ticked_anew(state, passed)
                continue
            if isinstance(flow, Branch) and index == 0 and status is not SKIPPED:
                target = targets[status is FAILURE]
                # Only past the last child the failure is the node's.
                way = status if target is passed.over else SUCCESS
                target.add(way, (state,), reasons)
                continue
            lead = flow.of(status)
            if lead is not NEXT:
                self._end(status, lead, state, reasons, passed)
            elif status is SKIPPED:
                targets[0].add(came, (state,), before)
            else:
                known = reasons if before is None or reasons is None else decisive(before, reasons)
                targets[0].add(status, (state,), known)

        for status, state, _ in outcomes:
            if status in self._own:
                ends.add(self._own[status], (state,), self._own_reasons)

    def _ticked_anew(self, state: FlowState, passed: _Pass) -> None:
        if not isinstance(self._flow, Choice):
            passed.again.add(state)
        elif len(self._chosen) > 1:
            # The value seldom changes while a case runs. It may, but nothing is reported of it.
            passed.again.add(state.in_doubt())

    def _end(
        self,
        status: NodeStatus,
        lead: Lead,
        state: FlowState,
        reasons: FailureReasons | None,
        passed: _Pass,
    ) -> None:
        ends, unhidable = self._ends, self._walk.unhidable
        if isinstance(self._flow, Loop) and self._flow.passes_over[0] and reasons is not None:
            key, value = self._flow.passes_over
            given = self._walk.literal(self._spec, key)
            # A failure that may not be hidden is passed over once the operator has acknowledged it.
            ends.add(FAILURE, (state,), reasons.only(unhidable) if given == value else reasons)
            if given is not None and given != value:
                return
            status, lead, reasons = SUCCESS, AGAIN, None
        if lead is AGAIN:
            if self._most != 1:
                ends.add(RUNNING, (state,))
                passed.again.add(state)
            if self._least < inf:
                ends.add(status, (state,), reasons and self._used_up(reasons))
                if status is SKIPPED and self._most != 1:
                    ends.add(SUCCESS, (state,))
        elif status is FAILURE and lead is SUCCESS and reasons is not None:
            ends.add(FAILURE, (state,), reasons.only(unhidable))
            if hidden := reasons.only(~unhidable).any:
                ends.add(SUCCESS, (state if reasons.loud & hidden else state.in_doubt(),))
        elif isinstance(lead, NodeStatus):
            ends.add(lead, (state.written(self._mark) if lead is SUCCESS else state,), reasons or NO_REPORT)

    def _used_up(self, reasons: FailureReasons) -> FailureReasons:
        """Return the reasons after the last run of a retry."""
        tried = reasons if self._most == 1 else reasons.tried()
        reported = tried.only(~UNREPORTED)
        return joined((reported, self._missing_reasons.tried())) if tried.any & UNREPORTED else reported

    # Nodes that remember something beyond their end.

    def _once(self, flow: Once, entry: FlowState) -> Outcomes:
        (ended, failed), ends, spec = self._walk.flags(self._spec), self._ends, self._spec
        skips = self._walk.literal(spec, flow.skips)
        if not entry.sure & ended:
            for status, state, reasons in self._walk.child(spec.children[0], (entry,)):
                flags = {SUCCESS: ended, FAILURE: ended | failed}.get(status, 0)
                ends.add(status, (state.written(flags),), reasons)
                if reasons is not None:
                    self._walk.remember(spec, reasons)
        if entry.maybe & ended and skips is not False:
            ends.add(SKIPPED, (entry,))
        if entry.maybe & ended and skips is not True:
            if not entry.sure & failed:
                ends.add(SUCCESS, (entry,))
            if entry.maybe & failed:
                ends.add(FAILURE, (entry,), self._walk.recall(spec))
        return ends.tidied()

    def _in_turn(self, flow: Turns, entry: FlowState) -> Outcomes:
        parts = self._spec.children
        (self._mark,) = self._walk.flags(self._spec)
        wraps = self._walk.literal(self._spec, flow.wraps) is not False
        for turn in range(len(parts) + 1) if entry.maybe & self._mark else range(1):
            order = (*parts[turn:], *(parts[:turn] if wraps else ()))
            if order:
                self._take_turns(order, entry, again=wraps)
            else:
                self._ends.add(FAILURE, (entry,), self._own_reasons)
        return self._ends.tidied()

    def _take_turns(self, order: tuple[NodeSpec, ...], entry: FlowState, *, again: bool) -> None:
        """Collect the outcomes of one pass in this order.

        `again`: children that were skipped before one ran may get another turn after it.
        """
        whole = len(order) == len(self._spec.children)
        first = Outcomes()
        first.skipped = frozenset((entry,))
        passed = self._pass(order, first)
        skipped, failed = passed.over.skipped, passed.over.failure
        self._ends.fail(failed)
        if whole:
            self._ends.add(SKIPPED, skipped)
        if passed.running or not whole:
            self._ends.add(FAILURE, skipped, NO_REPORT)
        if again and passed.running:
            self._more_turns(order, {**dict.fromkeys(skipped, NO_REPORT), **failed})

    def _more_turns(self, order: tuple[NodeSpec, ...], failed: Failures) -> None:
        seen: set[FlowState] = set()
        while not seen.issuperset(failed):
            seen |= failed.keys()
            for part in order:
                after = self._pass((part,), Outcomes(failed)).over.failure
                self._ends.fail(after)
                failed = {**failed, **after}


def _choice(spec: NodeSpec) -> tuple[str, tuple[tuple[str, NodeSpec], ...], tuple[NodeSpec, ...]]:
    """Return the input whose value selects a case, the cases by label, and the default."""
    assert spec.node is not None
    slot = next(slot for slot in spec.node.declaration.slots if slot.matches)
    cases = spec.slots[slot.key]
    default = tuple(part for part in spec.children if not any(part is case for _, case in cases))
    return slot.matches or "", cases, default
