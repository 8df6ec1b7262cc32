"""Decorators: nodes with exactly one child, which change when and how often it is ticked, or how its
status is reported.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Literal, cast

from picktree.files import Expression
from picktree.world import Failure, FailureReport, event_types, internal, matches, tree

from .control_flow import (
    AGAIN,
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    ChildFlow,
    LeafFlow,
    Loop,
    NodeStatus,
    Once,
)
from .failure_reports import cannot_be_hidden, with_attached
from .node import ControlNode, Node
from .port_types import PortProblem, PortValues
from .ports import In, Out, child, port
from .references import Reference
from .runtime import TIME_TOLERANCE, Runtime, Wiring


class Decorator(ControlNode, abstract=True):
    """Node that changes when its one child is ticked, or how the child's status is reported."""

    kind = "decorator"
    body = child("the child")

    def relay(self) -> NodeStatus:
        """Tick the child; return its status and take over its failure."""
        return self.result_of(self.body)


class StatusDecorator(Decorator, abstract=True):
    """Decorator that replaces the child's status by its `flow`."""

    def on_tick(self) -> NodeStatus:
        state = self.relay()
        lead = cast("ChildFlow", self.flow).of(state)
        if state is NodeStatus.FAILURE and cannot_be_hidden(self.failure):
            return state
        return lead if isinstance(lead, NodeStatus) else state


class Inverter(StatusDecorator):
    """SUCCESS becomes FAILURE without a report, and FAILURE becomes SUCCESS.

    A safety stop (safety.*) and a fault of the program stay failures.
    """

    flow = ChildFlow(success=FAILURE, failure=SUCCESS)
    example = """
    Inverter:
      Condition: {if: holding}
    """


class ForceSuccess(StatusDecorator):
    """SUCCESS however the child ends. It cannot hide a safety stop (safety.*) or a fault of the program."""

    flow = ChildFlow(failure=SUCCESS)
    example = """
    ForceSuccess:
      GoTo: {pose: observe}
    """


class ForceFailure(StatusDecorator):
    """FAILURE however the child ends, with the child's failure when it has one."""

    flow = ChildFlow(success=FAILURE)
    example = """
    Fallback:
      - Grasp: {object: "{item}"}
      - ForceFailure:
          Log: {message: could not be grasped, value: "{item}"}
    """


class Timeout(Decorator):
    """Halts its child and fails with tree.timeout when the child still runs after `msec`. 0: no limit."""

    flow = ChildFlow(own={RUNNING: FAILURE}, own_unless="msec")
    example = """
    Timeout:
      msec: 20 s
      do: {Grasp: {object: "{item}"}}
    """

    msec: In[float] = port("simulated time that the child may take; 0 for no limit", unit="ms", least=0)
    causes = (tree.TIMEOUT,)
    remembers = ("_since",)
    _since: float = 0.0

    def on_start(self) -> None:
        self._since = self.world.clock.now

    def on_tick(self) -> NodeStatus:
        elapsed = self.world.clock.now - self._since
        if self.msec > 0 and elapsed >= self.msec / 1000.0 - TIME_TOLERANCE:
            self.body.halt()
            raise Failure(
                tree.TIMEOUT,
                f"{self.body.name} still ran after {self.msec / 1000.0:g} s",
                seconds=self.msec / 1000.0,
                running=self.body.path,
            )
        return self.relay()


class Delay(Decorator):
    """Is RUNNING for `delay_msec`, and then ticks its child."""

    flow = ChildFlow(own={IDLE: RUNNING}, own_unless="delay_msec")
    example = """
    Delay:
      delay_msec: 500 ms
      do: {Observe: {camera: overhead, objects: "{items}"}}
    """

    delay_msec: In[float] = port("simulated time to wait before the child is ticked", unit="ms", least=0)
    remembers = ("_since", "_over")
    _since: float = 0.0
    _over: bool = False

    def on_start(self) -> None:
        self._since, self._over = self.world.clock.now, False

    def on_tick(self) -> NodeStatus:
        waited = self.world.clock.now - self._since
        self._over = self._over or waited >= self.delay_msec / 1000.0 - TIME_TOLERANCE
        return self.relay() if self._over else NodeStatus.RUNNING


class RateController(Decorator):
    """Starts its child at most `hz` times a second, as in Nav2; between two runs it is RUNNING.

    The first run starts immediately, the next when 1/`hz` seconds have passed since the last success. A child
    that runs is ticked at each tick. The node is made for the children of a PipelineSequence. With a parent
    that resets it after its end, the next run starts immediately.
    """

    flow = ChildFlow(own={IDLE: RUNNING})
    example = """
    PipelineSequence:
      - RateController:
          hz: 0.5
          do: {Observe: {camera: overhead, objects: "{items}"}}
      - GoTo: {pose: home}
    """

    hz: In[float] = port("maximum number of starts of the child per second", default=10.0, above=0)
    remembers = ("_since", "_begins")
    _since: float = 0.0
    _begins: bool = True
    """Whether no round has begun since the node was reset."""

    def on_start(self) -> None:
        if not self._kept:
            self._since, self._begins = self.world.clock.now, True

    def on_tick(self) -> NodeStatus:
        waited = self.world.clock.now - self._since
        runs = self._begins or self.body.state is NodeStatus.RUNNING
        if not runs and waited < 1.0 / self.hz - TIME_TOLERANCE:
            return NodeStatus.RUNNING
        self._begins = False
        state = self.relay()
        if state is NodeStatus.SUCCESS:
            self._since = self.world.clock.now
        return state


class RunOnce(Decorator):
    """Runs its child until the child has ended once; after that it is SKIPPED or repeats the result."""

    flow = Once(skips="then_skip")
    example = """
    RunOnce:
      Observe: {camera: overhead, objects: "{items}"}
    """

    then_skip: In[bool] = port(
        "result of the second and later runs: SKIPPED (true), or the first result again (false)", default=True
    )
    remembers = ("_first_answer", "_first_failure")
    _first_answer: str = ""
    _first_failure: FailureReport | None = None

    def on_tick(self) -> NodeStatus:
        if self._first_answer and self.then_skip:
            return NodeStatus.SKIPPED
        if self._first_answer:
            answer = NodeStatus(self._first_answer)
            return self.fail_with(self._first_failure) if answer is NodeStatus.FAILURE else answer
        state = self.relay()
        if state in (NodeStatus.SUCCESS, NodeStatus.FAILURE):
            self._first_answer, self._first_failure = state.value, self.failure
        return state


class Repeat(Decorator):
    """Runs its child `num_cycles` times, or for as long as `while` holds; it fails when the child fails.

    `while` is evaluated before each cycle. The tick ends between two cycles. SKIPPED when the child is.
    """

    flow = Loop(success=AGAIN, runs="num_cycles", guard="while")
    example = """
    Repeat:
      num_cycles: 3
      while: items_left
      do: {Observe: {camera: overhead, objects: "{items}"}}
    """

    num_cycles: In[int] = port("number of cycles; -1 for no limit", default=-1, least=-1)
    condition: In[Expression | None] = port(
        "condition to continue, checked before each cycle", key="while", default=None
    )
    remembers = ("_cycles",)
    _cycles: int = 0

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str, ...]:
        if given.any_of("num_cycles", "while"):
            return ()
        return ("one of 'num_cycles' and 'while' must be given, or the loop would never end",)

    def on_start(self) -> None:
        self._cycles = 0

    def on_tick(self) -> NodeStatus:
        if self.body.state is not NodeStatus.RUNNING and self._is_finished():
            return NodeStatus.SUCCESS
        state = self.relay()
        if state is not NodeStatus.SUCCESS:
            return state
        self._cycles += 1
        return NodeStatus.SUCCESS if self._cycles == self.num_cycles else NodeStatus.RUNNING

    def _is_finished(self) -> bool:
        if self.num_cycles >= 0 and self._cycles >= self.num_cycles:
            return True
        return self.condition is not None and not self.holds(self.condition)


class KeepRunningUntilFailure(Decorator):
    """Runs its child once a cycle until the child fails, and then fails with its failure.

    The tick ends between two cycles.
    """

    flow = Loop(success=AGAIN, skipped=AGAIN)
    example = """
    KeepRunningUntilFailure:
      Observe: {camera: overhead, expect: "{item}"}
    """

    def on_tick(self) -> NodeStatus:
        state = self.relay()
        return state if state is NodeStatus.FAILURE else NodeStatus.RUNNING


class RetryUntilSuccessful(Decorator):
    """Runs its child until the child succeeds, at most `num_attempts` times.

    The tick ends between two attempts. When all attempts are used up, it fails with the last failure and
    attaches the earlier ones. When the child gave no reason, it fails with tree.attempts. A fault of the
    program is not tried again.
    """

    flow = Loop(failure=AGAIN, runs="num_attempts")
    example = """
    RetryUntilSuccessful:
      num_attempts: 3
      do: {Grasp: {object: "{item}"}}
    """

    num_attempts: In[int] = port("maximum number of runs of the child; -1 for no limit", least=-1)
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

    The tick ends between two elements. With `on_failure: continue` a failure is recorded as handled and the
    loop continues; it then succeeds at the end. It never passes over a fault of the program, nor a safety
    stop without acknowledgement. An empty list is SUCCESS; SKIPPED when the child was skipped for every
    element.
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
        "reaction to a failure of the child: fail with it, or continue with the next element", default="fail"
    )
    most: In[int] = port("maximum number of elements, from the first; -1 for all", default=-1, least=-1)
    remembers = ("_items", "_index", "_skipped")
    _items: list[object] = []  # noqa: RUF012 - replaced when the loop starts, never changed
    _index: int = 0
    _skipped: int = 0

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        if given.number("most") != 0:
            return ()
        return (PortProblem("most", "with 0 elements the child never runs", "at least 1, or -1 for all"),)

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
            event_types.HandledEvent(
                message,
                self.path,
                cause=cause,
                by="ForEach",
                element=element if isinstance(element, str | int | float | bool) else str(element),
                failed=report.node if report else failed.path,
            )
        )


class EntryNode(Node, abstract=True):
    """Node that checks whether a key was written since its last check. A write of an equal value counts."""

    entry: In[object] = port("the key whose writes the node watches", takes="key")
    remembers = ("_updated",)
    _updated: bool | None = None
    """Whether the key was written since the last check; None before the first check."""

    def bind(self, wiring: Wiring, runtime: Runtime) -> None:
        super().bind(wiring, runtime)
        entry = wiring.ports.get("entry")
        if isinstance(entry, Reference):
            runtime.blackboard.watch(wiring.namespace.full_key(entry.key), self._note_write)

    def was_updated(self) -> bool:
        """Whether the key was written since the last call; at first, whether it was written at all."""
        updated, self._updated = self._updated, False
        entry = self.wiring.ports["entry"]
        written = isinstance(entry, Reference) and self.wiring.namespace.has(entry.key)
        return written if updated is None else updated

    def _note_write(self) -> None:
        self._updated = True


class EntryDecorator(EntryNode, Decorator, abstract=True):
    """Decorator that starts its child when the key was written; else its own end in `flow` is its status."""

    def on_tick(self) -> NodeStatus:
        if self.body.state is NodeStatus.RUNNING or self.was_updated():
            return self.relay()
        return cast("ChildFlow", self.flow).own[IDLE]


class SkipUnlessUpdated(EntryDecorator):
    """Ticks its child when the key was written since the child last started; otherwise it is SKIPPED.

    A child that runs is ticked until it ends. A write of an equal value counts, too.
    """

    flow = ChildFlow(own={IDLE: SKIPPED})
    example = """
    SkipUnlessUpdated:
      entry: "{items}"
      do: {Log: {message: there are new items, value: "{items}"}}
    """


class WaitValueUpdate(EntryDecorator):
    """Ticks its child when the key was written since the child last started; until then it is RUNNING.

    A child that runs is ticked until it ends. A write of an equal value counts, too.
    """

    flow = ChildFlow(own={IDLE: RUNNING})
    example = """
    WaitValueUpdate:
      entry: "{items}"
      do: {Log: {message: there are new items, value: "{items}"}}
    """


class WasEntryUpdated(EntryNode):
    """Whether the key was written since the node was ticked last. A write of an equal value counts, too."""

    flow = LeafFlow(instant=True)
    kind = "condition"
    example = """
    Fallback:
      - WasEntryUpdated: {entry: "{items}"}
      - Observe: {camera: overhead, objects: "{items}"}
    """

    def on_tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS if self.was_updated() else NodeStatus.FAILURE
