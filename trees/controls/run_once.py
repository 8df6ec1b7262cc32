"""RunOnce: a branch that runs at most once in a mission."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ...world.causes import FailureReport
from ..flow import FlowState, NodeOutcomes, OutcomeCollector
from ..ports import In, port
from ..status import NodeStatus
from .decorator import Decorator

if TYPE_CHECKING:
    from ..flow.flow_walk import FlowAnalysis
    from ..mission import NodeSpec


class RunOnce(Decorator):
    """Runs its child until it has ended once; after that it is SKIPPED, or answers as the child did then."""

    by_turns = True

    example = """
    RunOnce:
      Observe: {camera: overhead, objects: "{items}"}
    """

    then_skip: In[bool] = port(
        "after the first time SKIPPED (true), or the first answer again (false)", default=True
    )
    remembers = ("_first_answer", "_first_failure")
    lasting: ClassVar[int] = 2
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

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        (ended, failed), ends = walk.flags(spec), OutcomeCollector()
        then_skip = walk.literal(spec, "then_skip")
        if not entry.sure & ended:
            flow = walk.child(spec.children[0], (entry,))
            ends.succeed(state.written(ended) for state in flow.success)
            for state, reasons in flow.failure.items():
                ends.fail_at(state.written(ended | failed), reasons)
                walk.remember(spec, reasons)
            ends.skip(flow.skipped)
            ends.run(flow.running)
        if entry.maybe & ended and then_skip is not False:
            ends.skip((entry,))
        if entry.maybe & ended and then_skip is not True:
            ends.succeed(() if entry.sure & failed else (entry,))
            if entry.maybe & failed:
                ends.fail_at(entry, walk.recall(spec))
        return ends.flow()
