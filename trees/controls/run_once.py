"""RunOnce: a branch that runs at most once in a mission."""

from __future__ import annotations

from ...world.causes import FailureReport
from ..flow import Once
from ..ports import In, port
from ..status import NodeStatus
from .decorator import Decorator


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
