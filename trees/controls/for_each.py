"""ForEach: one branch for each element of a list."""

from __future__ import annotations

from collections.abc import Collection
from typing import Literal

from ...world.events.run_events import HandledEvent
from ..flow import AGAIN, Loop
from ..node import Node
from ..ports import In, Out, port
from ..status import NodeStatus
from ..values.failure_reports import cannot_be_hidden
from ..values.port_types import PortProblem, PortValues
from .decorator import Decorator


class ForEach(Decorator):
    """Runs its child once for each element of a list, which is read when the loop starts.

    The tick ends between two elements. With `on_failure: continue` a failure is noted in the record as
    handled and the loop goes on; it then succeeds at the end. What it does not pass over: a fault of the
    program, and a safety stop that nobody has acknowledged. An empty list is SUCCESS; SKIPPED when the child
    was skipped for every element.
    """

    flow = Loop(
        success=AGAIN, skipped=AGAIN, runs="most", each_of="in", passes_over=("on_failure", "continue")
    )
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
