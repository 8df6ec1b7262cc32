"""RoundRobin: children in turn."""

from __future__ import annotations

from ...world.causes import tree
from ..flow import NEXT, Turns
from ..node import ControlNode
from ..ports import In, port
from ..slots import children
from ..status import NodeStatus
from ..values.failure_reports import decisive_report


class RoundRobin(ControlNode):
    """Ticks its children in turn, and begins each time after the child that succeeded last, as Nav2's.

    A child that fails or is skipped passes the turn on, in the same tick. It fails when all have failed, and,
    unless it may `wrap_around`, when the last child has had its turn and did not succeed. Whose turn it is
    outlasts success; failure and being halted give it back to the first child. As handler of a `Recover` it
    tries another cure at each failure.
    """

    flow = Turns(failure=NEXT, skipped=NEXT, wraps="wrap_around")
    example = """
    Recover:
      attempts: 5
      do: {Grasp: {object: "{item}"}}
      when:
        grasp.*:
          RoundRobin:
            wrap_around: true
            do:
              - Observe: {camera: overhead}
              - SafeRetreat: {pose: observe}
    """

    parts = children("what takes turns")
    wrap_around: In[bool] = port("after the last child it is the first one's turn again", default=False)
    causes = (tree.ATTEMPTS,)
    remembers = ("_turn", "_failed")
    positions = ("_turn",)
    counted = (NodeStatus.FAILURE,)
    _turn: int = 0
    _failed: int = 0

    def on_tick(self) -> NodeStatus:
        skipped = 0
        while self._failed + skipped < len(self.parts):
            if self._turn == len(self.parts):
                if not self.wrap_around:
                    break
                self._turn = 0
            state = self.parts[self._turn].step()
            if state is NodeStatus.RUNNING:
                return state
            self._turn += 1
            match state:
                case NodeStatus.FAILURE:
                    self._failed += 1
                case NodeStatus.SKIPPED:
                    skipped += 1
                case _:
                    self._failed = 0
                    return state
        return self._give_up(skipped)

    def on_halt(self) -> None:
        self._turn = self._failed = 0

    def _give_up(self, skipped: int) -> NodeStatus:
        in_turn = (*self.parts[self._turn :], *self.parts[: self._turn])
        nobody_asked = self._failed + skipped == 0
        self._turn = self._failed = 0
        if nobody_asked:
            return self.fail(tree.ATTEMPTS, "every child has had its turn")
        if skipped == len(self.parts):
            return NodeStatus.SKIPPED
        return self.fail_with(decisive_report(part.failure for part in in_turn))
