"""Repeat and KeepRunningUntilFailure: loops over one branch."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...files.expressions.expression import Expression
from ..flow import FlowState, NodeOutcomes, OutcomeCollector, States, tidy
from ..ports import In, port
from ..status import NodeStatus
from ..values.port_types import PortValues
from .decorator import Decorator

if TYPE_CHECKING:
    from ..flow.flow_walk import FlowAnalysis
    from ..mission import NodeSpec


class Repeat(Decorator):
    """Runs its child `num_cycles` times, or for as long as `while` holds; it fails when the child fails.

    `while` is asked before each cycle. The tick ends between two cycles. A skipped child skips the loop.
    """

    by_turns = True

    example = """
    Repeat:
      num_cycles: 3
      while: items_left
      do: {Observe: {camera: overhead, objects: "{items}"}}
    """

    num_cycles: In[int] = port("how often; -1 for without end", default=-1, least=-1)
    condition: In[Expression | None] = port(
        "go on only while this holds; asked before each cycle", key="while", default=None
    )
    remembers = ("_cycles",)
    _cycles: int = 0

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str, ...]:
        if given.any_of("num_cycles", "while"):
            return ()
        return ("one of 'num_cycles' and 'while' must be given, or it would never end",)

    def on_start(self) -> None:
        self._cycles = 0

    def on_tick(self) -> NodeStatus:
        if self.body.state is not NodeStatus.RUNNING and self._enough():
            return NodeStatus.SUCCESS
        state = self.relay()
        if state is not NodeStatus.SUCCESS:
            return state
        self._cycles += 1
        return NodeStatus.SUCCESS if self._cycles == self.num_cycles else NodeStatus.RUNNING

    def _enough(self) -> bool:
        if self.num_cycles >= 0 and self._cycles >= self.num_cycles:
            return True
        return self.condition is not None and not self.holds(self.condition)

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        cycles, part, ends = walk.number(spec, "num_cycles"), spec.children[0], OutcomeCollector()
        condition = walk.literal(spec, "while")
        starts: States = frozenset((entry,))
        if cycles is None or cycles == 0:
            ends.succeed(starts)
        if cycles == 0:
            walk.unreached(part, "num_cycles is 0")
            return ends.flow()
        while True:
            begun = starts
            if isinstance(condition, Expression):
                asked = walk.ask(spec, "while", condition, starts)
                ends.succeed(asked.no)
                ends.fail(asked.failed)
                begun = asked.yes
            if not begun:
                walk.unreached(part, "its while never holds")
            flow = walk.child(part, begun)
            ends.fail(flow.failure)
            ends.skip(flow.skipped)
            ends.run(flow.running)
            if cycles is None or cycles > 0:
                ends.succeed(flow.success)
            if cycles != 1:
                ends.run(flow.success)
            after = starts if cycles == 1 else tidy(starts | flow.success)
            if after == starts:
                return ends.flow()
            starts = after


class KeepRunningUntilFailure(Decorator):
    """Runs its child again and again, one tick apart, until it fails; then it fails with its failure."""

    by_turns = True

    example = """
    KeepRunningUntilFailure:
      Observe: {camera: overhead, expect: "{item}"}
    """

    def on_tick(self) -> NodeStatus:
        state = self.relay()
        return state if state is NodeStatus.FAILURE else NodeStatus.RUNNING

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        ends = OutcomeCollector()
        starts: States = frozenset((entry,))
        while True:
            flow = walk.child(spec.children[0], starts)
            ends.fail(flow.failure)
            ends.run(flow.running | flow.success | flow.skipped)
            after = tidy(starts | flow.success | flow.skipped)
            if after == starts:
                return ends.flow()
            starts = after
