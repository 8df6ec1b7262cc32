"""Repeat and KeepRunningUntilFailure: loops over one branch."""

from __future__ import annotations

from ...files.expressions.expression import Expression
from ..flow import AGAIN, Loop
from ..ports import In, port
from ..status import NodeStatus
from ..values.port_types import PortValues
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
