"""Leaves of the language itself: they neither move the robot nor take time."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, cast

from ...files.expressions.expression import Expression
from ...world.events.run_events import LogEvent
from ..flow import NO_REPORT, FlowState, NodeOutcomes, OutcomeCollector
from ..flow.default_flow import leaf
from ..node import Node
from ..ports import In, Out, port
from ..status import NodeStatus
from ..values.port_types import plain_copy, show

if TYPE_CHECKING:
    from ...cell.world import World
    from ..flow.flow_walk import FlowAnalysis
    from ..mission import NodeSpec


class ConditionNode(Node, abstract=True):
    """Base class of conditions. False is FAILURE without a report: a status that needs no recovery."""

    kind = "condition"

    @abstractmethod
    def answer(self, world: World) -> bool:
        """Return whether the condition holds now. Raise Failure when that cannot be decided."""
        ...

    def on_tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS if self.answer(cast("World", self.world)) else NodeStatus.FAILURE

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        return leaf(cls, spec, entry, walk, takes_time=False, says_no=True)


class AlwaysSuccess(Node):
    """SUCCESS at once."""

    steady = True

    example = """
    Fallback:
      - GoTo: {pose: observe}
      - AlwaysSuccess
    """

    kind = "action"

    def on_tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        return _succeeding(entry)


class AlwaysFailure(Node):
    """FAILURE at once, without a report, as a false condition."""

    steady = True

    example = """
    Fallback:
      - Grasp: {object: "{item}"}
      - Sequence:
          - Log: {message: could not be grasped, value: "{item}"}
          - AlwaysFailure
    """

    kind = "action"

    def on_tick(self) -> NodeStatus:
        return NodeStatus.FAILURE

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        ends = OutcomeCollector()
        ends.fail_at(entry, NO_REPORT)
        return ends.flow()


class Condition(ConditionNode):
    """Whether an expression holds. It sees the blackboard's keys and the facts of the world."""

    steady = True

    example = """
    Condition: {if: "item.colour == 'red' and not holding"}
    """

    expression: In[Expression] = port("the expression that must hold", key="if")

    def answer(self, world: World) -> bool:
        return self.holds(self.expression)

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        expression, ends = walk.literal(spec, "if"), OutcomeCollector()
        assert isinstance(expression, Expression)
        asked = walk.ask(spec, "if", expression, (entry,))
        ends.succeed(asked.yes)
        ends.fail(dict.fromkeys(asked.no, NO_REPORT))
        ends.fail(asked.failed)
        return ends.flow()


class SetBlackboard(Node):
    """Writes a value to the blackboard."""

    steady = True

    example = """
    SetBlackboard: {value: 3, output_key: "{tries}"}
    """

    kind = "action"
    value: In[object] = port("the value, or a reference to another")
    output_key: Out[object] = port("the key to write it to", like="value")

    def on_tick(self) -> NodeStatus:
        self.output_key = self.value
        return NodeStatus.SUCCESS

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        return _succeeding(entry.written(walk.key_of(spec, "output_key")))


class Log(Node):
    """Writes a sentence, and a value if given, into the record."""

    steady = True

    example = """
    Log: {message: now comes, value: "{item.kind}"}
    """

    kind = "action"
    message: In[str] = port("the sentence for the record")
    value: In[object] = port("a value to log behind it", default=None)

    def on_tick(self) -> NodeStatus:
        value = plain_copy(self.value)
        self.feedback_message = self.message if value is None else f"{self.message}: {show(value)}"
        self.world.journal.note(LogEvent(self.feedback_message, self.path, value=value))
        return NodeStatus.SUCCESS

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        return _succeeding(entry)


def _succeeding(state: FlowState) -> NodeOutcomes:
    ends = OutcomeCollector()
    ends.succeed((state,))
    return ends.flow()
