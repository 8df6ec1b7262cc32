"""The leaves of the language itself: they neither move the robot nor take time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...world.files.expressions import Expression
from ..condition import ConditionNode
from ..node import Node
from ..plain import plain_copy
from ..ports import In, Out, port
from ..status import NodeStatus
from ..types import show

if TYPE_CHECKING:
    from ...world.world import World


class AlwaysSuccess(Node):
    """SUCCESS at once."""

    kind = "action"

    def on_tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS


class AlwaysFailure(Node):
    """FAILURE at once, without a report, as a false condition."""

    kind = "action"

    def on_tick(self) -> NodeStatus:
        return NodeStatus.FAILURE


class Condition(ConditionNode):
    """Whether an expression holds. It sees the blackboard's keys and the facts of the world."""

    expression: In[Expression] = port("what must hold", key="if")

    def answer(self, world: World) -> bool:
        return self.holds(self.expression)


class SetBlackboard(Node):
    """Writes a value to the blackboard."""

    kind = "action"
    value: In[object] = port("the value, or a reference to another")
    output_key: Out[object] = port("where to")

    def on_tick(self) -> NodeStatus:
        self.output_key = self.value
        return NodeStatus.SUCCESS


class Log(Node):
    """Writes a sentence, and a value if given, into the record."""

    kind = "action"
    message: In[str] = port("the sentence")
    value: In[object] = port("a value to log with it", default=None)

    def on_tick(self) -> NodeStatus:
        value = plain_copy(self.value)
        self.feedback_message = self.message if value is None else f"{self.message}: {show(value)}"
        self.note("log", self.feedback_message, value=value)
        return NodeStatus.SUCCESS
