"""Children that are ticked in the same ticks: what each does may happen while the others run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from ...trees.controls.parallel import counted
from ...trees.flow import FAILURE, RUNNING, SKIPPED, SUCCESS, AtOnce
from ...trees.mission import NodeSpec
from .failure_reasons import joined
from .flow_walk import FlowWalk
from .outcomes import NOTHING, SHARED, ConcurrentEffect, FlowState, Outcomes


@dataclass(frozen=True, slots=True)
class _Part:
    """One child: where it starts, and how it may end. `begins`: whether it is ticked at all; `brings`: what
    the hand may hold because of it."""

    start: FlowState
    flow: Outcomes
    begins: bool
    brings: int = 0

    @property
    def may_pass(self) -> bool:
        return bool(self.flow.success or self.flow.skipped)

    @property
    def moves(self) -> bool:
        """Whether it may change what the hand holds."""
        return self.brings != 0 or any(state.hand != self.start.hand for state in self.flow.everywhere)

    def anywhere(self, entry: FlowState) -> frozenset[FlowState]:
        """Not begun yet, where nothing before it need have come to its end; still running; or ended."""
        return self.flow.everywhere | {self.start._replace(sure=entry.sure)}


class ParallelWalk:
    """Walk over children that are all ticked until `wanted` succeeded or `tolerated` failed.

    None: the number is not known. `spares_skipped`: those that are skipped need not succeed.
    """

    def __init__(self, spec: NodeSpec, flow: AtOnce, walk: FlowWalk, entry: FlowState) -> None:
        self._spec, self._entry, self._walk = spec, entry, walk
        self._total = len(spec.children)
        success, failure = walk.number(spec, flow.wanted), walk.number(spec, flow.tolerated)
        self._wanted = None if success is None else counted(int(success), self._total)
        self._tolerated = None if failure is None else counted(int(failure), self._total)
        self._spares_skipped = success is None or success < 0

    def outcomes(self) -> Outcomes:
        """Return the outcomes of the node."""
        effects = [NOTHING] * self._total
        while True:
            parts = self._started(effects)
            more = [e.with_(p.flow.effect(p.start)) for e, p in zip(effects, parts, strict=True)]
            if more == effects:
                parts = [replace(p, brings=e.hand) for p, e in zip(parts, effects, strict=True)]
                return self._ends(parts)
            effects = more

    # How each child may go, given what the others may do.

    def _started(self, effects: Sequence[ConcurrentEffect]) -> list[_Part]:
        parts: list[_Part] = []
        sure, over = self._entry, False
        for index, child in enumerate(self._spec.children):
            if over:
                self._walk.unreached(child, f"{self._spec.name} ends before it in the first tick")
                parts.append(_Part(sure, Outcomes(), begins=False))
                continue
            start = sure
            for other, effect in enumerate(effects):
                start = effect.on(start) if other != index else start
            flow = self._walk.child(child, (start,))
            if not self._entry.hand & SHARED:
                start, flow = start.alone(), flow.mapped(FlowState.alone)
            part = _Part(start, flow, begins=True)
            parts.append(part)
            if not flow.running:
                over = self._decides(part)
                sure = self._after_first_tick(part, sure)
        return parts

    def _decides(self, part: _Part) -> bool:
        """Whether a child that ends in the first tick ends everything."""
        fails, succeeds = self._tolerated == 1, self._wanted == 1
        may_fail, may_succeed = bool(part.flow.failure), bool(part.flow.success)
        return not part.flow.skipped and (fails or not may_fail) and (succeeds or not may_succeed)

    def _after_first_tick(self, part: _Part, before: FlowState) -> FlowState:
        """Return the state on which the next child may rely after one that ends at once."""
        states = [*part.flow.success, *part.flow.skipped]
        if self._tolerated != 1:
            states += part.flow.failure
        sure = ~0
        for state in states:
            sure &= state.sure
        return before.written(sure) if states else before

    # What comes of them together.

    def _ends(self, parts: list[_Part]) -> Outcomes:
        ends = Outcomes()
        flows = [part.flow for part in parts if part.begins]
        failing = [index for index, part in enumerate(parts) if part.flow.failure]
        passing = sum(bool(f.success or (f.skipped and self._spares_skipped)) for f in flows)
        needed = self._needed_failures()
        if len(failing) >= needed:
            self._fail(parts, failing, needed, ends)
        if self._wanted is None or passing >= self._wanted:
            self._succeed(parts, ends)
        if len(flows) == self._total and all(flow.skipped for flow in flows):
            ends.add(SKIPPED, self._together(parts, [part.flow.skipped for part in parts]))
        waits = any(flow.running or flow.skipped for flow in flows)
        if waits or not (self._tolerated == 1 and self._wanted == self._total):
            ends.add(RUNNING, self._together(parts, [part.anywhere(self._entry) for part in parts]))
        return ends.tidied()

    def _needed_failures(self) -> int:
        """Return the least number of failed children with which it may fail."""
        if self._wanted is None or self._tolerated is None:
            return 1
        return max(1, min(self._tolerated, self._total - self._wanted + 1))

    def _fail(self, parts: list[_Part], failing: list[int], needed: int, ends: Outcomes) -> None:
        everything = joined(r for index in failing for r in parts[index].flow.failure.values())
        for index in failing:
            for state, reasons in parts[index].flow.failure.items():
                ways = [part.anywhere(self._entry) for part in parts]
                ways[index] = frozenset((state,))
                ends.add(FAILURE, self._together(parts, ways), reasons if needed == 1 else everything)

    def _succeed(self, parts: list[_Part], ends: Outcomes) -> None:
        if self._wanted == self._total and all(part.may_pass for part in parts):
            ways = [part.flow.success | part.flow.skipped for part in parts]
        else:
            ways = [part.anywhere(self._entry) for part in parts]
        ends.add(SUCCESS, self._together(parts, ways))

    def _together(self, parts: list[_Part], ways: list[frozenset[FlowState]]) -> Iterable[FlowState]:
        """States in which each child is in one of its own."""
        sure, maybe = self._entry.sure, self._entry.maybe
        doubtful = self._entry.doubtful
        for states in ways:
            common = ~0
            for state in states:
                common &= state.sure
                maybe |= state.maybe
            sure |= common if states else 0
            doubtful = doubtful or (bool(states) and all(state.doubtful for state in states))
        movers = [index for index, part in enumerate(parts) if part.moves]
        if not movers:
            hands = {self._entry.hand: doubtful}
        elif len(movers) == 1:
            hands: dict[int, bool] = {}
            for state in ways[movers[0]]:
                hands[state.hand] = (doubtful or state.doubtful) and hands.get(state.hand, True)
        else:
            hand = self._entry.hand
            for states in ways:
                for state in states:
                    hand |= state.hand
            hands = {hand: doubtful}
        return [FlowState(sure, maybe, hand, in_doubt) for hand, in_doubt in hands.items()]
