"""Sequence and ReactiveSequence: all children, one after the other."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..flow import NONE, NOTHING, FlowState, NodeOutcomes, OutcomeCollector, States, tidy
from ..node import ControlNode
from ..slots import children
from ..status import NodeStatus

if TYPE_CHECKING:
    from ..flow.flow_walk import FlowAnalysis
    from ..mission import NodeSpec


class Sequence(ControlNode):
    """Ticks its children in order until one fails; goes on with the child that was RUNNING.

    SUCCESS when all succeeded (skipped ones do not count), SKIPPED when all were skipped. It fails with the
    failure of its failing child.
    """

    by_turns = True
    steady = True

    example = """
    Sequence:
      - Grasp: {object: "{item}"}
      - Place: {object: "{item}", into: "{item.destination}"}
    """

    parts = children("what is done, in this order")
    remembers = ("_index", "_skipped")
    positions = ("_index",)
    counted = (NodeStatus.SKIPPED,)
    _index: int = 0
    _skipped: int = 0

    def on_start(self) -> None:
        self._index = self._skipped = 0

    def on_tick(self) -> NodeStatus:
        while self._index < len(self.parts):
            part = self.parts[self._index]
            match part.step():
                case NodeStatus.RUNNING:
                    return NodeStatus.RUNNING
                case NodeStatus.FAILURE:
                    return self.fail_with(part.failure)
                case NodeStatus.SKIPPED:
                    self._skipped += 1
                case _:
                    pass
            self._index += 1
        return NodeStatus.SKIPPED if self._skipped == len(self.parts) else NodeStatus.SUCCESS

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        ends = OutcomeCollector()
        _go_through(spec, frozenset((entry,)), walk, ends)
        return ends.flow()


class ReactiveSequence(ControlNode):
    """Asks every child anew at each tick, from the first: conditions first, then what they guard.

    When an earlier child runs or fails, a later one that was RUNNING is halted, after the earlier was ticked.
    """

    steady = True

    example = """
    ReactiveSequence:
      - Condition: {if: not stopped}
      - GoTo: {pose: home}
    """

    parts = children("the conditions, then what they guard")

    def on_tick(self) -> NodeStatus:
        skipped = 0
        for index, part in enumerate(self.parts):
            state = part.step()
            skipped += state is NodeStatus.SKIPPED
            if state in (NodeStatus.RUNNING, NodeStatus.FAILURE):
                for later in self.parts[index + 1 :]:
                    later.halt()
                return state if state is NodeStatus.RUNNING else self.fail_with(part.failure)
        return NodeStatus.SKIPPED if skipped == len(self.parts) else NodeStatus.SUCCESS

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        ends = OutcomeCollector()
        starts: States = frozenset((entry,))
        while (after := tidy(starts | _go_through(spec, starts, walk, ends, asked_anew=True))) != starts:
            starts = after
        return ends.flow()


def _go_through(
    spec: NodeSpec, starts: States, walk: FlowAnalysis, ends: OutcomeCollector, *, asked_anew: bool = False
) -> States:
    """Collect the outcomes of one pass over the children; return the states in which a child may run.

    `asked_anew`: the children before the running one are ticked again at every tick.
    """
    skipped, going = starts, NONE
    """States after children that were all skipped, and after others."""
    running: set[FlowState] = set()
    meanwhile = NOTHING
    before = ""
    for part in spec.children:
        if not skipped and not going:
            walk.unreached(part, f"{before} before it never succeeds")
            continue
        first, then = walk.child(part, skipped, meanwhile), walk.child(part, going, meanwhile)
        for flow in (first, then):
            ends.fail(flow.failure)
            running |= flow.running
        if asked_anew:
            meanwhile = meanwhile.with_(walk.effect(part, skipped | going))
        skipped, going = first.skipped, tidy(first.success | then.success | then.skipped)
        before = part.name
    ends.run(running)
    ends.succeed(going)
    ends.skip(skipped)
    return tidy(running)
