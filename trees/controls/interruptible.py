"""AsyncSequence, AsyncFallback and TryCatch of BehaviorTree.CPP: nodes made for being halted."""

from __future__ import annotations

from typing import cast

from ...world.causes import FailureReport
from ..failure_reports import with_attached
from ..flow import NEXT, ChildFlow, CleanUp
from ..node import ControlNode
from ..ports import In, children, port
from ..status import NodeStatus
from .sequence import OrderedNode


class _AsyncNode(OrderedNode, abstract=True):
    """Node whose tick ends behind each child that has ended at once, so that it can be halted there."""

    def on_tick(self) -> NodeStatus:
        flow = cast("ChildFlow", self.flow)
        while self._index < len(self.parts):
            part = self.parts[self._index]
            fresh = part.state is NodeStatus.IDLE
            state = part.step()
            if flow.of(state) is not NEXT:
                return self.fail_with(part.failure) if state is NodeStatus.FAILURE else state
            self._skipped += state is NodeStatus.SKIPPED
            self._index += 1
            if fresh and state is not NodeStatus.SKIPPED and self._index < len(self.parts):
                return NodeStatus.RUNNING
        return self.past_the_last(flow)


class AsyncSequence(_AsyncNode):
    """A Sequence that can be halted between two children: the tick ends behind each that succeeds at once."""

    flow = ChildFlow(success=NEXT, skipped=NEXT, pauses=True)
    example = """
    AsyncSequence:
      - Log: {message: first}
      - Log: {message: in the next tick}
    """

    parts = children("the children, in this order")


class AsyncFallback(_AsyncNode):
    """A Fallback that can be halted between two children: the tick ends behind each that fails at once."""

    flow = ChildFlow(failure=NEXT, skipped=NEXT, pauses=True)
    example = """
    AsyncFallback:
      - Condition: {if: holding}
      - GoTo: {pose: home}
    """

    parts = children("the children, in this order")


class TryCatch(ControlNode):
    """A Sequence of all children but the last, which runs when one of them fails: the node then fails, too.

    It fails with the failure of the child that failed, however the last child ends. With `catch_on_halt` a
    halt also ticks the last child, once; nothing that takes longer may stand there, and nothing that moves.
    """

    flow = CleanUp(success=NEXT, skipped=NEXT, on_halt="catch_on_halt")
    example = """
    TryCatch:
      catch_on_halt: true
      do:
        - GoTo: {pose: observe}
        - GoTo: {pose: home}
        - Log: {message: it has not come home}
    """

    parts = children("the children in this order; the last one cleans up", least=2)
    catch_on_halt: In[bool] = port("whether a halt ticks the last child, too", default=False)
    remembers = ("_index", "_skipped", "_catching", "_reports")
    positions = ("_index",)
    counted = (NodeStatus.SKIPPED,)
    _index: int = 0
    _skipped: int = 0
    _catching: bool = False
    _reports: tuple[FailureReport, ...] = ()

    def on_start(self) -> None:
        self._index = self._skipped = 0
        self._catching = False
        self._reports = ()

    def on_tick(self) -> NodeStatus:
        last = len(self.parts) - 1
        while not self._catching and self._index < last:
            part = self.parts[self._index]
            match part.step():
                case NodeStatus.RUNNING:
                    return NodeStatus.RUNNING
                case NodeStatus.FAILURE:
                    self._catching = True
                    self._reports = (part.failure,) if part.failure is not None else ()
                case state:
                    self._skipped += state is NodeStatus.SKIPPED
                    self._index += 1
        if not self._catching:
            return NodeStatus.SKIPPED if self._skipped == last else NodeStatus.SUCCESS
        if self.parts[last].step() is NodeStatus.RUNNING:
            return NodeStatus.RUNNING
        failed, cleaning = next(iter(self._reports), None), self.parts[last].failure
        if failed is not None and cleaning is not None:
            failed = with_attached(failed, (cleaning,))
        return self.fail_with(failed or cleaning)

    def on_halt(self) -> None:
        """Tick the last child, where the file wants it: once, as BehaviorTree.CPP does."""
        if self.catch_on_halt and not self._catching:
            for part in self.parts[:-1]:
                part.halt()
            if self.parts[-1].step() is NodeStatus.RUNNING:
                self.parts[-1].halt()
