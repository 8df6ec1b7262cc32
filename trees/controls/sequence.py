"""Sequence and ReactiveSequence: all children, one after the other."""

from __future__ import annotations

from ..flow import NEXT, ChildFlow
from ..node import ControlNode
from ..slots import children
from ..status import NodeStatus


class Sequence(ControlNode):
    """Ticks its children in order until one fails; goes on with the child that was RUNNING.

    SUCCESS when all succeeded (skipped ones do not count), SKIPPED when all were skipped. It fails with the
    failure of its failing child.
    """

    flow = ChildFlow(success=NEXT, skipped=NEXT)
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


class ReactiveSequence(ControlNode):
    """Asks every child anew at each tick, from the first: conditions first, then what they guard.

    When an earlier child runs or fails, a later one that was RUNNING is halted, after the earlier was ticked.
    """

    flow = ChildFlow(success=NEXT, skipped=NEXT, reactive=True)
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
