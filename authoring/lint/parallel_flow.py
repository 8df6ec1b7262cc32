"""Children that are ticked in the same ticks: what each does may happen while the others run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ...trees.controls.parallel import counted
from ...trees.flow import FAILURE, RUNNING, SKIPPED, SUCCESS, AtOnce
from ...trees.mission import NodeSpec
from .failure_reasons import joined
from .flow_walk import FlowWalk
from .outcomes import NONE, NOTHING, SHARED, ConcurrentEffect, FlowState, Outcomes, States, merged


@dataclass(frozen=True, slots=True)
class _Part:
    """One child: where it starts, and how it may end; no end: it is never ticked."""

    start: FlowState
    ends: Outcomes
    moves: bool = False
    """Whether it may change what the hand holds."""

    @property
    def passed(self) -> States:
        return self.ends.success | self.ends.skipped

    def anywhere(self, entry: FlowState) -> States:
        """Not begun yet, where nothing before it need have come to its end; still running; or ended."""
        return self.ends.everywhere | {self.start._replace(sure=entry.sure)}


class ParallelWalk:
    """Walk over children that are all ticked until `wanted` succeeded or `tolerated` failed, or all ended.

    None: the number is not known. `spares_skipped`: those that are skipped need not succeed.
    """

    def __init__(self, spec: NodeSpec, flow: AtOnce, walk: FlowWalk, entry: FlowState) -> None:
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
        """Return the outcomes of the node."""
        effects = [NOTHING] * self._total
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
                self._walk.unreached(child, f"{self._spec.name} ends before it in the first tick")
                parts.append(_Part(sure, Outcomes()))
                continue
            start = sure
            for other, effect in enumerate(effects):
                start = effect.on(start) if other != index else start
            ends = self._walk.child(child, (start,))
            if not self._entry.hand & SHARED:
                start, ends = start.alone(), ends.mapped(FlowState.alone)
            turns = any(state.hand != start.hand for state in ends.everywhere)
            parts.append(_Part(start, ends, moves=turns or effects[index].hand != 0))
            if not ends.running:
                over = self._decides(ends)
                fails = self._tolerated == 1 and not self._waits
                goes_on = parts[-1].passed | (NONE if fails else ends.failure.keys())
                # The next child may rely on what is written by one that ends at once.
                sure = sure.written(merged(goes_on).sure) if goes_on else sure
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
            ends.add(SUCCESS, self._together(parts, passed if all_pass else anywhere))
        if len(flows) == self._total and all(flow.skipped for flow in flows):
            ends.add(SKIPPED, self._together(parts, [flow.skipped for flow in flows]))
        waits = any(flow.running or flow.skipped for flow in flows)
        if waits or not (self._waits or (self._tolerated == 1 and self._wanted == self._total)):
            ends.add(RUNNING, self._together(parts, anywhere))
        return ends.tidied()

    def _fail(self, parts: list[_Part], anywhere: list[States], ends: Outcomes) -> None:
        """Add the failures, if so many children as are needed may fail."""
        needed = 1
        if self._wanted is not None and self._tolerated is not None:
            needed = max(1, min(self._tolerated, self._total - self._wanted + 1))
        failing = [(index, part.ends.failure) for index, part in enumerate(parts) if part.ends.failure]
        everything = joined(reasons for _, failure in failing for reasons in failure.values())
        for index, failure in failing if len(failing) >= needed else ():
            for state, reasons in failure.items():
                ways = [*anywhere[:index], frozenset((state,)), *anywhere[index + 1 :]]
                ends.add(FAILURE, self._together(parts, ways), reasons if needed == 1 else everything)

    def _together(self, parts: list[_Part], ways: list[States]) -> Iterable[FlowState]:
        """States in which each child is in one of its own."""
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
