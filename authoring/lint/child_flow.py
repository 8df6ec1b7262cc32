"""Outcomes of nodes with children: in order, by choice, in turn, again, to recover, at the same time, or
with a clean-up.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from math import inf

from picktree.files import Expression
from picktree.trees import NodeSpec, NodeStatus, control_flow, counted, is_case, references, show
from picktree.world import internal

from .flow_walk import FlowWalk
from .outcomes import (
    HAND_SHARED,
    NO_CONCURRENT_EFFECT,
    NO_REPORT,
    NO_STATES,
    UNREPORTED,
    ConcurrentEffect,
    FailureReasons,
    Failures,
    FlowState,
    Outcomes,
    States,
    decisive,
    joined,
    merged,
    narrowed,
    tidy,
    together,
)


class ChildWalk:
    """Passes over the children of one node that starts in one state.

    `_arriving`: start states of each child, by the outcome before it; the last entry: states after all
    children.
    """

    def __init__(self, spec: NodeSpec, flow: control_flow.ChildFlow, walk: FlowWalk) -> None:
        assert spec.node is not None
        self._spec, self._flow, self._walk = spec, flow, walk
        self._node = spec.node.declaration
        self._ends = Outcomes()
        self._again: set[FlowState] = set()
        """States in which another pass begins."""
        self._arriving: list[Outcomes] = []
        self._runs_on = False
        self._least, self._most = walk.runs(spec, flow)
        self._mark = 0
        """Flags that success sets."""
        self._passed = (
            walk.flags(spec)
            if isinstance(flow, control_flow.Resumed | control_flow.Pipeline)
            else (0,) * len(spec.children)
        )
        """Flags of the children that have led on to the next."""
        never = flow.own_unless and walk.number(spec, flow.own_unless) == 0
        self._own = dict[NodeStatus, NodeStatus]() if never else flow.own
        self._parts = spec.children
        self._handlers: dict[int, tuple[str, str]] = {}
        """Label and pattern of each handler, by its place."""
        self._endings: set[int] = set()
        """Places of the handlers whose success ends the node."""
        if isinstance(flow, control_flow.Recovery):
            self._sort_handlers(flow)
        if isinstance(flow, control_flow.Pipeline) or (
            isinstance(flow, control_flow.Branch) and flow.reactive
        ):
            walk.kept.update(
                map(id, self._parts if isinstance(flow, control_flow.Pipeline) else self._parts[:1])
            )
        if isinstance(flow, control_flow.Loop | control_flow.Recovery) and self._node.causes:
            _ = self._own_reasons

    def outcomes(self, entry: FlowState) -> Outcomes:
        flow, ends = self._flow, self._ends
        match flow:
            case control_flow.Once():
                return self._once(flow, entry)
            case control_flow.Turns():
                return self._in_turn(flow, entry)
            case control_flow.Resumed():
                return self._resumed(entry)
            case control_flow.Pipeline():
                gone = ~sum(self._passed)
                entry = entry._replace(sure=entry.sure & gone, maybe=entry.maybe & gone)
            case control_flow.Choice() if self._may_fit_no_case():
                ends.add(control_flow.FAILURE, (entry,), self._own_reasons)
            case control_flow.Loop() if self._least == 0:
                ends.add(
                    control_flow.SUCCESS if flow.success is control_flow.AGAIN else control_flow.FAILURE,
                    (entry,),
                    self._missing_reasons,
                )
            case _:
                pass
        if isinstance(flow, control_flow.Loop) and self._most == 0:
            why = "there is no element" if flow.each_of else f"{flow.runs} is 0"
            self._walk.unreached(self._parts[0], why)
            return ends
        starts: States = frozenset((entry,))
        seen = NO_STATES if isinstance(flow, control_flow.Recovery) else starts
        for run in count(1):
            self._again = set()
            ends.take(self._pass(self._parts, Outcomes(skipped=self._begun(starts)), run))
            starts = tidy(seen | self._again)
            if starts == seen:
                break
            seen = starts
        if control_flow.IDLE in self._own:
            ends.add(self._own[control_flow.IDLE], (entry,), self._own_reasons)
        return ends.tidied()

    # What the node's ports say.

    @cached_property
    def _own_reasons(self) -> FailureReasons:
        return self._walk.fails(self._spec, self._walk.causes.of(self._node.causes))

    @cached_property
    def _missing_reasons(self) -> FailureReasons:
        """Reasons for a failure that no child reports."""
        return self._own_reasons if self._node.causes else NO_REPORT

    def _begun(self, starts: States) -> States:
        flow, spec = self._flow, self._spec
        if not isinstance(flow, control_flow.Loop | control_flow.Recovery):
            return starts
        guard = (
            self._walk.literal(spec, flow.guard)
            if isinstance(flow, control_flow.Loop) and flow.guard
            else None
        )
        if isinstance(flow, control_flow.Loop) and isinstance(guard, Expression):
            answers = self._walk.ask(spec, flow.guard, guard, starts)
            self._ends.add(control_flow.SUCCESS, answers.no)
            self._ends.fail(answers.failed)
            starts = answers.yes
            if not starts:
                self._walk.unreached(spec.children[0], f"its {flow.guard} never holds")
        return tidy(state.written(self._walk.outputs(spec)) for state in starts)

    @cached_property
    def _chosen(self) -> tuple[NodeSpec, ...]:
        """Possible cases for the value, with the default; at most one for a constant value."""
        key, cases, default = self._choice
        bound = self._spec.ports[key]
        if not isinstance(bound, references.Constant):
            return self._parts
        case = next((part for name, part in cases if is_case(bound.value, name)), None)
        return default if case is None else (case,)

    @cached_property
    def _choice(self) -> tuple[str, tuple[tuple[str, NodeSpec], ...], tuple[NodeSpec, ...]]:
        """Input whose value selects a case, cases by label, and default."""
        slot = next(slot for slot in self._node.slots if slot.matches)
        cases = self._spec.slots[slot.key]
        default = tuple(part for part in self._parts if not any(part is case for _, case in cases))
        return slot.matches or "", cases, default

    def _may_fit_no_case(self) -> bool:
        key, _, default = self._choice
        return not self._chosen or (not default and self._walk.literal(self._spec, key) is None)

    def _sort_handlers(self, flow: control_flow.Recovery) -> None:
        """Put the handlers behind the first child: those of a cause, those of any, the last resort."""
        spec, tried = self._spec, self._parts[0]
        last, first = flow.resort, flow.instead
        slots = sorted(self._node.slots, key=lambda slot: (slot.key == last, slot.key != first, slot.of))
        parts = [tried]
        for slot in slots:
            for label, part in spec.slots.get(slot.key, ()):
                if part is tried:
                    continue
                if slot.key == flow.instead:
                    self._endings.add(len(parts))
                if slot.key != flow.resort:
                    name = label if slot.of == "cause" else slot.key if slot.arity == "one" else part.name
                    self._handlers[len(parts)] = (name, label if slot.of == "cause" else "*")
                parts.append(part)
        self._parts = tuple(parts)

    # One pass over children.

    def _pass(self, parts: tuple[NodeSpec, ...], first: Outcomes, run: int = 1, turn: int = 0) -> Outcomes:
        """Collect the ends of one pass from the child `turn` on; return the outcomes after the last child."""
        flow, walk = self._flow, self._walk
        one_of = isinstance(flow, control_flow.Choice)
        chosen = self._chosen if isinstance(flow, control_flow.Choice) else parts[turn : turn + 1]
        self._arriving = [first if any(part is one for one in chosen) else Outcomes() for part in parts]
        self._arriving.append(Outcomes())
        meanwhile, before = NO_CONCURRENT_EFFECT, ""
        for index, part in enumerate(parts):
            arrival = self._arriving[index].tidied()
            if not arrival.everywhere:
                if before or one_of:
                    walk.unreached(part, self._why_not(before, index))
                continue
            for came, states, why in arrival.groups():
                outcomes = walk.child(part, states, meanwhile)
                if isinstance(flow, control_flow.Recovery) and index == 0:
                    self._share(self._failures(states, outcomes), run)
                self._follow(index, outcomes, came, why)
            later_branch = isinstance(flow, control_flow.Branch) and index
            if flow.reactive and not one_of and not later_branch:
                meanwhile = meanwhile.with_(walk.effect(part, arrival.everywhere))
            before = (
                before if later_branch or (isinstance(flow, control_flow.Recovery) and index) else part.name
            )
        return self._arriving[-1]

    def _why_not(self, before: str, index: int) -> str:
        flow = self._flow
        match flow:
            case control_flow.Choice():
                return f"the value is always {show(self._walk.literal(self._spec, self._choice[0]))}"
            case control_flow.Recovery() if index not in self._handlers:
                return f"{before} never fails for good"
            case control_flow.Recovery() if self._most == 1:
                return f"{before} may run only once, so no second run follows"
            case control_flow.Recovery():
                return f"{before} never fails" + (" with another cause" if index > 1 else "")
            case _:
                succeeds = (
                    index == 1 if isinstance(flow, control_flow.Branch) else flow.success is control_flow.NEXT
                )
                return f"{before} before it never {'succeeds' if succeeds else 'fails'}"

    def _lead(self, index: int, status: NodeStatus) -> control_flow.Lead | int:
        """Return the destination of a result of that child; a number: another child."""
        match self._flow:
            case control_flow.Branch() if index == 0 and status is not control_flow.SKIPPED:
                chosen = 1 if status is control_flow.SUCCESS else 2
                return chosen if chosen < len(self._parts) else status
            case control_flow.Recovery() if index in self._endings:
                return control_flow.SUCCESS if status is control_flow.SUCCESS else control_flow.FAILURE
            case control_flow.Recovery(skipped_handler=skipped) if index in self._handlers:
                return (
                    skipped
                    if status is control_flow.SKIPPED
                    else control_flow.AGAIN
                    if status is control_flow.SUCCESS
                    else control_flow.FAILURE
                )
            case control_flow.Recovery() if index:
                return control_flow.FAILURE
            case flow:
                lead = flow.of(status)
                return index + 1 if lead is control_flow.NEXT else lead

    def _follow(
        self, index: int, outcomes: Outcomes, came: NodeStatus, before: FailureReasons | None
    ) -> None:
        """Follow the results of a child: to another child, to another pass, or to the end of the node."""
        recovers = isinstance(self._flow, control_flow.Recovery)
        for status, state, reasons in outcomes:
            if status in self._own:
                self._ends.add(self._own[status], (state,), self._own_reasons)
            if status is control_flow.RUNNING:
                self._run_on(state)
                if isinstance(self._flow, control_flow.Pipeline) and state.maybe & self._passed[index]:
                    self._arriving[index + 1].add(control_flow.SUCCESS, (state,), before)
                continue
            if recovers and index == 0 and status is control_flow.FAILURE:
                continue  # shared out among the handlers
            lead = self._lead(index, status)
            state = state.written(self._passed[index]) if isinstance(lead, int) else state
            if not isinstance(lead, int):
                failed = before if recovers and lead is not control_flow.SUCCESS else None
                self._end(status, lead, state, failed.tried() if failed else reasons)
            elif status is control_flow.SKIPPED:
                self._arriving[lead].add(came, (state,), before)
            else:
                known = reasons if before is None or reasons is None else decisive(before, reasons)
                self._arriving[lead].add(status, (state,), known)
                if self._flow.pauses and lead < len(self._parts):
                    self._ends.add(control_flow.RUNNING, (state,))

    def _run_on(self, state: FlowState) -> None:
        self._runs_on = True
        self._ends.add(control_flow.RUNNING, (state,))
        if self._flow.reactive and not isinstance(self._flow, control_flow.Choice):
            self._again.add(state)
        elif self._flow.reactive and len(self._chosen) > 1:
            # The value seldom changes while a case runs. It may, but nothing is reported of it.
            self._again.add(state.in_doubt())

    def _end(
        self, status: NodeStatus, lead: control_flow.Lead, state: FlowState, reasons: FailureReasons | None
    ) -> None:
        flow, ends, unhidable = self._flow, self._ends, self._walk.unhidable
        if isinstance(flow, control_flow.Loop) and flow.passes_over[0] and reasons is not None:
            key, value = flow.passes_over
            literal = self._walk.literal(self._spec, key)
            # A failure that may not be hidden is passed over once the operator has acknowledged it.
            ends.add(control_flow.FAILURE, (state,), reasons.only(unhidable) if literal == value else reasons)
            if literal is not None and literal != value:
                return
            status, lead, reasons = control_flow.SUCCESS, control_flow.AGAIN, None
        if lead is control_flow.AGAIN:
            if self._most != 1:
                ends.add(control_flow.RUNNING, (state,))
                self._again.add(state)
            if self._least < inf and isinstance(flow, control_flow.Loop):
                ends.add(status, (state,), reasons and self._used_up(reasons))
                if status is control_flow.SKIPPED and self._most != 1:
                    ends.add(control_flow.SUCCESS, (state,))
        elif status is control_flow.FAILURE and lead is control_flow.SUCCESS and reasons is not None:
            ends.add(control_flow.FAILURE, (state,), reasons.only(unhidable))
            if hidden := reasons.only(~unhidable).any:
                ends.add(control_flow.SUCCESS, (state if reasons.loud & hidden else state.in_doubt(),))
        elif isinstance(lead, NodeStatus):
            ends.add(
                lead,
                (state.written(self._mark) if lead is control_flow.SUCCESS else state,),
                reasons or NO_REPORT,
            )

    def _used_up(self, reasons: FailureReasons) -> FailureReasons:
        """Return the reasons after the last run of a retry."""
        tried = reasons if self._most == 1 else reasons.tried()
        reported = tried.only(~UNREPORTED)
        return joined((reported, self._missing_reasons.tried())) if tried.any & UNREPORTED else reported

    # Failures that handlers share.

    def _failures(self, states: Iterable[FlowState], outcomes: Outcomes) -> Failures:
        """Return the failures of a run. A condition that does not hold counts as a cause of the node."""
        found = dict(outcomes.failure)
        for state, reasons in found.items():
            if reasons.any & UNREPORTED:
                found[state] = joined((reasons.only(~UNREPORTED), self._own_reasons))
        if any(pattern in (internal.ERROR.name, str(internal.ANY)) for _, pattern in self._handlers.values()):
            # It may happen in any node, at any time.
            fault = self._walk.fails(self._spec, 0, self._walk.causes.matching(str(internal.ANY)))
            for at in {state.in_doubt() for state in tidy((*states, *outcomes.everywhere))}:
                found[at] = joined((found[at], fault)) if at in found else fault
        return found

    def _share(self, failures: Failures, run: int) -> None:
        """Lead each failure to the first handler of its cause, and to the end when no further run is
        allowed."""
        for index, (label, pattern) in self._handlers.items():
            mask = self._walk.causes.matching(pattern)
            caught, failures = narrowed(failures, mask), narrowed(failures, ~mask)
            ends = index in self._endings
            if caught and (ends or run < self._most):
                self._walk.handles(self._spec, label)
                self._arriving[index].fail(together(caught))
                self._ends.add(control_flow.RUNNING, caught)
            # The first run is by itself: after it nothing is used up yet.
            if self._most <= 1 and not ends:
                self._give_up(caught)
            elif not ends and (run > 1 or self._least < self._most):
                self._give_up({state: reasons.tried() for state, reasons in caught.items()})
        self._give_up(failures)

    def _give_up(self, failures: Failures) -> None:
        if len(self._handlers) + 1 < len(self._parts):
            self._arriving[-2].fail(together(failures))
        else:
            self._ends.fail(failures)

    # Nodes that remember something beyond their end.

    def _once(self, flow: control_flow.Once, entry: FlowState) -> Outcomes:
        (ended, failed), ends, spec = self._walk.flags(self._spec), self._ends, self._spec
        skips = self._walk.literal(spec, flow.skips)
        if not entry.sure & ended:
            for status, state, reasons in self._walk.child(spec.children[0], (entry,)):
                flags = {control_flow.SUCCESS: ended, control_flow.FAILURE: ended | failed}.get(status, 0)
                ends.add(status, (state.written(flags),), reasons)
                if reasons is not None:
                    self._walk.remember(spec, reasons)
        if entry.maybe & ended and skips is not False:
            ends.add(control_flow.SKIPPED, (entry,))
        if entry.maybe & ended and skips is not True:
            if not entry.sure & failed:
                ends.add(control_flow.SUCCESS, (entry,))
            if entry.maybe & failed:
                ends.add(control_flow.FAILURE, (entry,), self._walk.recall(spec))
        return ends.tidied()

    def _resumed(self, entry: FlowState) -> Outcomes:
        """Follow the children from each possible first one of an activation."""
        for turn in range(len(self._parts)):
            if turn == 0 or entry.maybe & self._passed[turn - 1]:
                over = self._pass(self._parts, Outcomes(skipped=frozenset((entry,))), turn=turn)
                if turn:
                    self._ends.add(control_flow.SUCCESS, over.skipped)
                    over.skipped = NO_STATES
                self._ends.take(over)
        return self._ends.tidied()

    def _in_turn(self, flow: control_flow.Turns, entry: FlowState) -> Outcomes:
        parts, ends = self._parts, self._ends
        (self._mark,) = self._walk.flags(self._spec)
        wraps = self._walk.literal(self._spec, flow.wraps) is not False
        for turn in range(len(parts) + 1) if entry.maybe & self._mark else range(1):
            order, self._runs_on = (*parts[turn:], *(parts[:turn] if wraps else ())), False
            if not order:
                ends.add(control_flow.FAILURE, (entry,), self._own_reasons)
                continue
            over = self._pass(order, Outcomes(skipped=frozenset((entry,))))
            whole = len(order) == len(parts)
            ends.fail(over.failure)
            ends.add(control_flow.SKIPPED, over.skipped if whole else NO_STATES)
            if self._runs_on or not whole:
                ends.add(control_flow.FAILURE, over.skipped, NO_REPORT)
            if wraps and self._runs_on:
                self._more_turns(order, {**dict.fromkeys(over.skipped, NO_REPORT), **over.failure})
        return ends.tidied()

    def _more_turns(self, order: tuple[NodeSpec, ...], failed: Failures) -> None:
        """Follow the children that were skipped before one ran: they may get another turn after it."""
        seen: set[FlowState] = set()
        while not seen.issuperset(failed):
            seen |= failed.keys()
            for part in order:
                after = self._pass((part,), Outcomes(failed)).failure
                self._ends.fail(after)
                failed = {**failed, **after}


@dataclass(frozen=True, slots=True)
class _Part:
    """Child with its start states and possible outcomes; no outcome: it is never ticked."""

    start: FlowState
    ends: Outcomes
    moves: bool = False
    """Whether it may change the held object."""

    @property
    def passed(self) -> States:
        return self.ends.success | self.ends.skipped

    def anywhere(self, entry: FlowState) -> States:
        """Possible states of the child: before its start if no end must precede it, running, or ended."""
        return self.ends.everywhere | {self.start._replace(sure=entry.sure)}


class ParallelWalk:
    """Walk over children that are all ticked until `wanted` succeeded or `tolerated` failed, or all ended.

    None: the number is not known. `spares_skipped`: those that are skipped need not succeed.
    """

    def __init__(self, spec: NodeSpec, flow: control_flow.AtOnce, walk: FlowWalk, entry: FlowState) -> None:
        self._spec, self._entry, self._walk = spec, entry, walk
        self._total = len(spec.children)
        success, failure = walk.number(spec, flow.wanted), walk.number(spec, flow.tolerated)
        self._wanted = None if success is None else counted(int(success), self._total)
        self._tolerated = None if failure is None else counted(int(failure), self._total)
        self._spares_skipped = success is None or success < 0
        self._waits = flow.waits
        if flow.waits and self._tolerated is not None:
            self._wanted = self._total - self._tolerated + 1

    def outcomes(self) -> Outcomes:
        effects = [NO_CONCURRENT_EFFECT] * self._total
        while True:
            parts = self._started(effects)
            more = [e.with_(p.ends.effect(p.start)) for e, p in zip(effects, parts, strict=True)]
            if more == effects:
                return self._ends(parts)
            effects = more

    # How each child may go, given what the others may do.

    def _started(self, effects: Sequence[ConcurrentEffect]) -> list[_Part]:
        parts: list[_Part] = []
        sure, over = self._entry, False
        for index, child in enumerate(self._spec.children):
            if over:
                self._walk.unreached(child, f"{self._spec.name} already ends in the first tick")
                parts.append(_Part(sure, Outcomes()))
                continue
            start = sure
            for other, effect in enumerate(effects):
                start = effect.on(start) if other != index else start
            ends = self._walk.child(child, (start,))
            if not self._entry.hand & HAND_SHARED:
                start, ends = start.alone(), ends.mapped(FlowState.alone)
            turns = any(state.hand != start.hand for state in ends.everywhere)
            parts.append(_Part(start, ends, moves=turns or effects[index].hand != 0))
            if not ends.running:
                over = self._decides(ends)
                fails = self._tolerated == 1 and not self._waits
                leads_on = parts[-1].passed | (NO_STATES if fails else ends.failure.keys())
                # The next child may rely on what is written by one that ends at once.
                sure = sure.written(merged(leads_on).sure) if leads_on else sure
        return parts

    def _decides(self, ends: Outcomes) -> bool:
        """Whether a child that ends in the first tick ends everything."""
        if self._waits:
            return False
        fails, succeeds = self._tolerated == 1, self._wanted == 1
        return not ends.skipped and (fails or not ends.failure) and (succeeds or not ends.success)

    # What comes of them together.

    def _ends(self, parts: list[_Part]) -> Outcomes:
        ends, flows = Outcomes(), [part.ends for part in parts if part.ends.everywhere]
        anywhere = [part.anywhere(self._entry) for part in parts]
        passed = [part.passed for part in parts]
        self._fail(parts, anywhere, ends)
        passing = sum(bool(f.success or (f.skipped and self._spares_skipped)) for f in flows)
        if self._wanted is None or passing >= self._wanted:
            all_pass = self._wanted == self._total and all(passed)
            ends.add(control_flow.SUCCESS, self._together(parts, passed if all_pass else anywhere))
        if len(flows) == self._total and all(flow.skipped for flow in flows):
            ends.add(control_flow.SKIPPED, self._together(parts, [flow.skipped for flow in flows]))
        waits = any(flow.running or flow.skipped for flow in flows)
        if waits or not (self._waits or (self._tolerated == 1 and self._wanted == self._total)):
            ends.add(control_flow.RUNNING, self._together(parts, anywhere))
        return ends.tidied()

    def _fail(self, parts: list[_Part], anywhere: list[States], ends: Outcomes) -> None:
        """Add the failures, if enough children may fail."""
        needed = 1
        if self._wanted is not None and self._tolerated is not None:
            needed = max(1, min(self._tolerated, self._total - self._wanted + 1))
        failing = [(index, part.ends.failure) for index, part in enumerate(parts) if part.ends.failure]
        everything = joined(reasons for _, failure in failing for reasons in failure.values())
        for index, failure in failing if len(failing) >= needed else ():
            for state, reasons in failure.items():
                ways = [*anywhere[:index], frozenset((state,)), *anywhere[index + 1 :]]
                ends.add(
                    control_flow.FAILURE, self._together(parts, ways), reasons if needed == 1 else everything
                )

    def _together(self, parts: list[_Part], ways: list[States]) -> Iterable[FlowState]:
        """Return states that combine one state of each child."""
        entry, ways_taken = self._entry, [merged(states) for states in ways if states]
        sure, maybe, doubtful = entry.sure, entry.maybe, entry.doubtful
        for way in ways_taken:
            sure, maybe, doubtful = sure | way.sure, maybe | way.maybe, doubtful or way.doubtful
        movers = [states for part, states in zip(parts, ways, strict=True) if part.moves]
        hands: dict[int, bool] = {}
        if len(movers) == 1:
            for state in movers[0]:
                hands[state.hand] = (doubtful or state.doubtful) and hands.get(state.hand, True)
        else:
            hand = entry.hand
            for way in ways_taken if movers else ():
                hand |= way.hand
            hands[hand] = doubtful
        return [FlowState(sure, maybe, hand, in_doubt) for hand, in_doubt in hands.items()]


def clean_up_outcomes(
    spec: NodeSpec, flow: control_flow.CleanUp, entry: FlowState, walk: FlowWalk
) -> Outcomes:
    *tried, last = spec.children
    ends, failed, before = Outcomes(), Outcomes(), ""
    halted: States = NO_STATES
    arriving = Outcomes(skipped=frozenset((entry,)))
    for part in tried:
        if not (arriving.success or arriving.skipped):
            walk.unreached(part, f"{before} before it never succeeds")
            continue
        begun, skipped = (walk.child(part, states) for states in (arriving.success, arriving.skipped))
        arriving = Outcomes(skipped=skipped.skipped)
        arriving.success = begun.success | begun.skipped | skipped.success
        arriving.tidied()
        halted |= begun.running | skipped.running
        failed.fail(begun.failure)
        failed.fail(skipped.failure)
        before = part.name
    ends.success, ends.skipped, ends.running = arriving.success, arriving.skipped, halted
    _clean(last, failed.tidied().failure, ends, walk)
    if walk.literal(spec, flow.on_halt) is not False and halted:
        ends.running |= walk.child(last, tidy(halted)).everywhere
    elif not failed.failure:
        walk.unreached(last, "no child before it fails")
    return ends.tidied()


def _clean(last: NodeSpec, failures: Failures, ends: Outcomes, walk: FlowWalk) -> None:
    """Add the failures after the last child. Its own failure counts only when the one before it is
    unreported."""
    for state, reasons in failures.items():
        cleaned, reported = walk.child(last, (state,)), reasons.only(~UNREPORTED)
        ends.add(control_flow.RUNNING, cleaned.running)
        ends.add(control_flow.FAILURE, cleaned.success | cleaned.skipped, reasons)
        for after, why in cleaned.failure.items():
            silent = (reported, why) if reported.any else (why,)
            ends.add(control_flow.FAILURE, (after,), joined(silent) if reasons.any & UNREPORTED else reasons)
