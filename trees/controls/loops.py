"""Repeat, KeepRunningUntilFailure, RetryUntilSuccessful and ForEach: loops over one branch."""

from __future__ import annotations

from collections.abc import Collection
from typing import Literal

from ...files.expressions.expression import Expression
from ...world.causes import FailureReport, internal, matches, tree
from ...world.run_events import HandledEvent
from ..failure_reports import cannot_be_hidden, with_attached
from ..flow import AGAIN, Loop
from ..node import Node
from ..port_types import PortProblem, PortValues
from ..ports import In, Out, port
from ..status import NodeStatus
from .decorator import Decorator


class Repeat(Decorator):
    """Runs its child `num_cycles` times, or for as long as `while` holds; it fails when the child fails.

    `while` is asked before each cycle. The tick ends between two cycles. A skipped child skips the loop.
    """

    flow = Loop(success=AGAIN, runs="num_cycles", guard="while")
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


class KeepRunningUntilFailure(Decorator):
    """Runs its child again and again, one tick apart, until it fails; then it fails with its failure."""

    flow = Loop(success=AGAIN, skipped=AGAIN)
    example = """
    KeepRunningUntilFailure:
      Observe: {camera: overhead, expect: "{item}"}
    """

    def on_tick(self) -> NodeStatus:
        state = self.relay()
        return state if state is NodeStatus.FAILURE else NodeStatus.RUNNING


class RetryUntilSuccessful(Decorator):
    """Runs its child until it succeeds, at most `num_attempts` times, one tick apart.

    When all attempts are used up it fails with the last failure, the earlier ones attached; with
    tree.attempts when the child gave no reason. A fault of the program is not tried again.
    """

    flow = Loop(failure=AGAIN, runs="num_attempts")
    example = """
    RetryUntilSuccessful:
      num_attempts: 3
      do: {Grasp: {object: "{item}"}}
    """

    num_attempts: In[int] = port("how often the child may run; -1 for without end", least=-1)
    causes = (tree.ATTEMPTS,)
    remembers = ("_attempts", "_reports")
    _attempts: int = 0
    _reports: tuple[FailureReport, ...] = ()

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        if given.number("num_attempts") != 0:
            return ()
        return (PortProblem("num_attempts", "with 0 attempts the child never runs", "at least 1, or -1"),)

    def on_start(self) -> None:
        self._attempts, self._reports = 0, ()

    def on_tick(self) -> NodeStatus:
        if self.num_attempts == 0:
            return self.fail(tree.ATTEMPTS, "no attempt is allowed")
        state = self.body.step()
        if state is not NodeStatus.FAILURE:
            return state
        self._attempts += 1
        report = self.body.failure
        fault = report is not None and matches(str(internal.ANY), report.cause)
        # The count can exceed the limit when an edit during the run lowers the limit.
        if fault or 0 < self.num_attempts <= self._attempts:
            return self._give_up(report)
        # Reports are limited, so that the state does not grow over hours of attempts.
        self._reports = (*self._reports, *((report,) if report else ()))[-_MAX_REPORTS:]
        return NodeStatus.RUNNING

    def _give_up(self, last: FailureReport | None) -> NodeStatus:
        if last is None:
            message = f"{self._attempts} attempts are used up"
            return self.fail(tree.ATTEMPTS, message, attached=self._reports)
        return self.fail_with(with_attached(last, self._reports))


_MAX_REPORTS = 20


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
        """Skip these elements (as a rule ids), which need no more work; called while the node runs."""
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
