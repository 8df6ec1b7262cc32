"""ForEach: one branch for each element of a list."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Literal, cast

from ...world.events.run_events import HandledEvent
from ..flow import FlowState, NodeOutcomes, OutcomeCollector, States, tidy
from ..node import Node
from ..ports import In, Out, port
from ..status import NodeStatus
from ..values.failure_reports import cannot_be_hidden
from ..values.port_types import PortProblem, PortValues
from .decorator import Decorator

if TYPE_CHECKING:
    from ..flow.flow_walk import FlowAnalysis
    from ..mission import NodeSpec


class ForEach(Decorator):
    """Runs its child once for each element of a list, which is read when the loop starts.

    The tick ends between two elements. With `on_failure: continue` a failure is noted in the record as
    handled and the loop goes on; it then succeeds at the end. What it does not pass over: a fault of the
    program, and a safety stop that nobody has acknowledged. An empty list is SUCCESS; SKIPPED when the child
    was skipped for every element.
    """

    by_turns = True

    example = """
    ForEach:
      in: "{items}"
      out: "{item}"
      on_failure: continue
      do:
        - Grasp: {object: "{item}"}
        - Place: {object: "{item}", into: "{item.destination}"}
    """

    items: In[list[object]] = port("the elements", key="in")
    item: Out[object] = port("key of the present element, for the child to read", key="out", each_of="in")
    on_failure: In[Literal["fail", "continue"]] = port(
        "when the child fails: fail with it, or continue with the next element", default="fail"
    )
    most: In[int] = port("how many elements at most, from the first; -1 for all", default=-1, least=-1)
    remembers = ("_items", "_index", "_skipped")
    _items: list[object] = []  # noqa: RUF012 - replaced when the loop starts, never changed
    _index: int = 0
    _skipped: int = 0

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        if given.number("most") != 0:
            return ()
        return (PortProblem("most", "of 0 elements the child never runs", "at least 1, or -1 for all"),)

    def on_start(self) -> None:
        self._items = list(self.items) if self.most < 0 else self.items[: self.most]
        self._index = self._skipped = 0

    def on_tick(self) -> NodeStatus:
        if self._index >= len(self._items):
            return NodeStatus.SUCCESS
        if self.body.state is not NodeStatus.RUNNING:
            self.item = self._items[self._index]
        match self.body.step():
            case NodeStatus.RUNNING:
                return NodeStatus.RUNNING
            case NodeStatus.FAILURE:
                if self.on_failure == "fail" or not self._may_pass_over():
                    return self.fail_with(self.body.failure)
                self._note_handled(self.body)
            case NodeStatus.SKIPPED:
                self._skipped += 1
            case _:
                pass
        self._index += 1
        if self._index < len(self._items):
            return NodeStatus.RUNNING
        return NodeStatus.SKIPPED if self._skipped == len(self._items) else NodeStatus.SUCCESS

    def pass_over(self, elements: Collection[str]) -> None:
        first = self._index + (self.body.state is NodeStatus.RUNNING)
        left = [item for item in self._items[first:] if item not in elements]
        self._items = [*self._items[:first], *left]

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        items, most = walk.literal(spec, "in"), walk.number(spec, "most")
        length = len(cast("list[object]", items)) if isinstance(items, list) else None
        part, ends = spec.children[0], OutcomeCollector()
        if length is None or length == 0 or most is None or most == 0:
            ends.succeed((entry,))
        if length == 0 or most == 0:
            walk.unreached(part, "there is no element")
            return ends.flow()
        only_one = length == 1 or most == 1
        element, on_failure = walk.key_of(spec, "out"), walk.literal(spec, "on_failure")
        starts: States = frozenset((entry,))
        while True:
            flow = walk.child(part, tidy(state.written(element) for state in starts))
            passed = set(flow.success)
            for state, reasons in flow.failure.items():
                # A safety stop may be passed over once the operator has acknowledged it.
                ends.fail_at(state, reasons.only(walk.unhidable) if on_failure == "continue" else reasons)
                passed |= {state} if on_failure != "fail" else set()
            ends.succeed(passed)
            ends.skip(flow.skipped)
            ends.run(flow.running)
            after = starts
            if not only_one:
                ends.succeed(flow.skipped)
                ends.run(passed | flow.skipped)
                after = tidy(starts | passed | flow.skipped)
            if after == starts:
                return ends.flow()
            starts = after

    def _may_pass_over(self) -> bool:
        report = self.body.failure
        if report is None or not cannot_be_hidden(report):
            return True
        stopped = self.world.facts().get("stopped", True)
        return report.cause.name.startswith("safety.") and not stopped

    def _note_handled(self, failed: Node) -> None:
        report = failed.failure
        cause = report.cause.name if report else None
        why = f"{report.cause}: {report.message}" if report else "the condition does not hold"
        message = f"element {self._index + 1} of {len(self._items)} failed and is passed over: {why}"
        element = self._items[self._index]
        self.world.journal.note(
            HandledEvent(
                message,
                self.path,
                cause=cause,
                by="ForEach",
                element=element if isinstance(element, str | int | float | bool) else str(element),
                failed=report.node if report else failed.path,
            )
        )
