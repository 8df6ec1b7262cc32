"""RoundRobin: children in turn."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ...world.causes import tree
from ..flow import NO_REPORT, Failures, FlowState, NodeOutcomes, OutcomeCollector, States
from ..flow.outcomes import try_next
from ..node import ControlNode
from ..ports import In, port
from ..slots import children
from ..status import NodeStatus
from ..values.failure_reports import decisive_report

if TYPE_CHECKING:
    from ..flow.flow_walk import FlowAnalysis
    from ..mission import NodeSpec


class RoundRobin(ControlNode):
    """Ticks its children in turn, and begins each time after the child that succeeded last, as Nav2's.

    A child that fails or is skipped passes the turn on, in the same tick. It fails when all have failed, and,
    unless it may `wrap_around`, when the last child has had its turn and did not succeed. Whose turn it is
    outlasts success; failure and being halted give it back to the first child. As handler of a `Recover` it
    tries another cure at each failure.
    """

    by_turns = True

    example = """
    Recover:
      attempts: 5
      do: {Grasp: {object: "{item}"}}
      when:
        grasp.*:
          RoundRobin:
            wrap_around: true
            do:
              - Observe: {camera: overhead}
              - SafeRetreat: {pose: observe}
    """

    parts = children("what takes turns")
    wrap_around: In[bool] = port("after the last child it is the first one's turn again", default=False)
    causes = (tree.ATTEMPTS,)
    remembers = ("_turn", "_failed")
    positions = ("_turn",)
    counted = (NodeStatus.FAILURE,)
    lasting: ClassVar[int] = 1
    _turn: int = 0
    _failed: int = 0

    def on_tick(self) -> NodeStatus:
        skipped = 0
        while self._failed + skipped < len(self.parts):
            if self._turn == len(self.parts):
                if not self.wrap_around:
                    break
                self._turn = 0
            state = self.parts[self._turn].step()
            if state is NodeStatus.RUNNING:
                return state
            self._turn += 1
            match state:
                case NodeStatus.FAILURE:
                    self._failed += 1
                case NodeStatus.SKIPPED:
                    skipped += 1
                case _:
                    self._failed = 0
                    return state
        return self._give_up(skipped)

    def on_halt(self) -> None:
        self._turn = self._failed = 0

    def _give_up(self, skipped: int) -> NodeStatus:
        in_turn = (*self.parts[self._turn :], *self.parts[: self._turn])
        nobody_asked = self._failed + skipped == 0
        self._turn = self._failed = 0
        if nobody_asked:
            return self.fail(tree.ATTEMPTS, "every child has had its turn")
        if skipped == len(self.parts):
            return NodeStatus.SKIPPED
        return self.fail_with(decisive_report(part.failure for part in in_turn))

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        ends, parts = OutcomeCollector(), spec.children
        (succeeded,) = walk.flags(spec)
        wraps = walk.literal(spec, "wrap_around") is not False
        turns = range(len(parts) + 1) if entry.maybe & succeeded else range(1)
        for turn in turns:
            order = (*parts[turn:], *(parts[:turn] if wraps else ()))
            if not order:
                ends.fail_at(entry, walk.fails(spec, walk.causes.of(cls.causes)))
            else:
                _take_turns(order, entry, succeeded, walk, ends, again=wraps, whole=len(order) == len(parts))
        return ends.flow()


def _take_turns(
    order: tuple[NodeSpec, ...],
    entry: FlowState,
    succeeded: int,
    walk: FlowAnalysis,
    ends: OutcomeCollector,
    *,
    again: bool,
    whole: bool,
) -> None:
    """Collect the outcomes of one pass over the children in this order.

    `again`: children that were skipped before one ran may get another turn after it. `whole`: the pass is
    SKIPPED when all children are.
    """
    skipped: States = frozenset((entry,))
    failed: Failures = {}
    running: set[FlowState] = set()
    before = ""
    for part in order:
        if not skipped and not failed:
            walk.unreached(part, f"{before} before it never fails")
            continue
        trial = try_next(part, skipped, failed, walk)
        ends.succeed(state.written(succeeded) for state in trial.success)
        running |= trial.running
        skipped, failed = trial.skipped, trial.failed
        before = part.name
    ends.run(running)
    ends.fail(failed)
    ends.skip(skipped if whole else ())
    if running or not whole:
        ends.fail(dict.fromkeys(skipped, NO_REPORT))
    if again and running:
        _more_turns(order, skipped, failed, succeeded, walk, ends)


def _more_turns(
    order: tuple[NodeSpec, ...],
    skipped: States,
    failed: Failures,
    succeeded: int,
    walk: FlowAnalysis,
    ends: OutcomeCollector,
) -> None:
    seen: set[FlowState] = set()
    failed = {**dict.fromkeys(skipped, NO_REPORT), **failed}
    while not seen.issuperset(failed):
        seen |= failed.keys()
        for part in order:
            trial = try_next(part, frozenset(), failed, walk)
            ends.succeed(state.written(succeeded) for state in trial.success)
            ends.run(trial.running)
            ends.fail(trial.failed)
            failed = {**failed, **trial.failed}
