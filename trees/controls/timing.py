"""Timeout and Delay, in simulated time."""

from __future__ import annotations

from ...world.causes import Failure, tree
from ..flow import FAILURE, IDLE, RUNNING, ChildFlow
from ..ports import In, port
from ..status import NodeStatus
from .decorator import Decorator

_TIME_TOLERANCE = 1e-9
"""Tolerance for the rounding of summed ticks, s."""


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
        if self.msec > 0 and elapsed >= self.msec / 1000.0 - _TIME_TOLERANCE:
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
        self._over = self._over or waited >= self.delay_msec / 1000.0 - _TIME_TOLERANCE
        return self.relay() if self._over else NodeStatus.RUNNING
