"""Decorators: nodes with exactly one child, which change when it is ticked, or how its status is reported."""

from __future__ import annotations

from typing import cast

from ...world.causes import Failure, FailureReport, tree
from ..failure_reports import cannot_be_hidden
from ..flow import FAILURE, IDLE, RUNNING, SUCCESS, ChildFlow, Once
from ..node import ControlNode
from ..ports import In, child, port
from ..runtime import TIME_TOLERANCE
from ..status import NodeStatus


class Decorator(ControlNode, abstract=True):
    """Node that changes when its one child is ticked, or how the child's status is reported."""

    kind = "decorator"
    body = child("the child")

    def relay(self) -> NodeStatus:
        """Tick the child; return its status and take over its failure."""
        return self.result_of(self.body)


class StatusDecorator(Decorator, abstract=True):
    """Decorator that reports another status than the child's, as its `flow` says."""

    def on_tick(self) -> NodeStatus:
        state = self.relay()
        lead = cast("ChildFlow", self.flow).of(state)
        if state is NodeStatus.FAILURE and cannot_be_hidden(self.failure):
            return state
        return lead if isinstance(lead, NodeStatus) else state


class Inverter(StatusDecorator):
    """SUCCESS becomes FAILURE without a report, and FAILURE becomes SUCCESS, unless it is a safety stop."""

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
    """Halts its child and fails with tree.timeout when it still runs after that time. 0 is without limit."""

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
    """Waits that time, RUNNING, and then ticks its child."""

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
    """Begins a round of its child at most `hz` times a second, as Nav2's; RUNNING in between.

    The first round begins at once, the next when that time has passed since the last success. A child that
    runs is ticked at each tick. It is made for the children of a PipelineSequence: a parent that resets it
    after its end begins the next round at once.
    """

    flow = ChildFlow(own={IDLE: RUNNING})
    example = """
    PipelineSequence:
      - RateController:
          hz: 0.5
          do: {Observe: {camera: overhead, objects: "{items}"}}
      - GoTo: {pose: home}
    """

    hz: In[float] = port("rounds a second", default=10.0, above=0)
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
    """Runs its child until it has ended once; after that it is SKIPPED, or answers as the child did then."""

    flow = Once(skips="then_skip")
    example = """
    RunOnce:
      Observe: {camera: overhead, objects: "{items}"}
    """

    then_skip: In[bool] = port(
        "after the first time SKIPPED (true), or the first answer again (false)", default=True
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
