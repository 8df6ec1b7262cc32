"""Fallback and ReactiveFallback: children in order until one succeeds."""

from __future__ import annotations

from ..flow import NEXT, ChildFlow
from ..node import ControlNode
from ..slots import children
from ..status import NodeStatus
from ..values.failure_reports import decisive_report


class Fallback(ControlNode):
    """Ticks its children in order until one succeeds; goes on with the child that was RUNNING.

    When none succeeds it fails with the last child's failure, the others' attached. A child without a report
    (a false condition) does not hide one that has. SKIPPED when all were skipped.
    """

    flow = ChildFlow(failure=NEXT, skipped=NEXT)
    example = """
    Fallback:
      - Place: {object: "{item}", into: red_bin}
      - SafeRetreat: {hand: open}
    """

    parts = children("what is tried, in this order")
    remembers = ("_index", "_skipped")
    positions = ("_index",)
    counted = (NodeStatus.SKIPPED,)
    _index: int = 0
    _skipped: int = 0

    def on_start(self) -> None:
        self._index = self._skipped = 0

    def on_tick(self) -> NodeStatus:
        while self._index < len(self.parts):
            match self.parts[self._index].step():
                case NodeStatus.RUNNING:
                    return NodeStatus.RUNNING
                case NodeStatus.SUCCESS:
                    return NodeStatus.SUCCESS
                case NodeStatus.SKIPPED:
                    self._skipped += 1
                case _:
                    pass
            self._index += 1
        if self._skipped == len(self.parts):
            return NodeStatus.SKIPPED
        return self.fail_with(decisive_report(part.failure for part in self.parts))


class ReactiveFallback(ControlNode):
    """Tries every child anew at each tick, from the first.

    When an earlier child runs or succeeds, a later one that was RUNNING is halted, after the earlier was
    ticked. Both hold the arm for a moment, and the one that acquired it last keeps it.
    """

    flow = ChildFlow(failure=NEXT, skipped=NEXT, reactive=True)
    example = """
    ReactiveFallback:
      - Condition: {if: not holding}
      - SafeRetreat: {hand: open}
    """

    parts = children("what is tried, the most wanted first")

    def on_tick(self) -> NodeStatus:
        skipped = 0
        for index, part in enumerate(self.parts):
            state = part.step()
            skipped += state is NodeStatus.SKIPPED
            if state in (NodeStatus.RUNNING, NodeStatus.SUCCESS):
                for later in self.parts[index + 1 :]:
                    later.halt()
                return state
        if skipped == len(self.parts):
            return NodeStatus.SKIPPED
        return self.fail_with(decisive_report(part.failure for part in self.parts))
