"""Leaves of the language itself: they neither move the robot nor take time."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, cast

from picktree.files import Expression
from picktree.world import event_types, tree

from .control_flow import FAILURE, SUCCESS, LeafFlow, NodeStatus
from .node import Node, assign
from .port_types import plain_copy, show
from .ports import In, Out, port
from .runtime import TIME_TOLERANCE

if TYPE_CHECKING:
    from picktree.robot import World


class ConditionNode(Node, abstract=True):
    """Base class of conditions. False is FAILURE without a report: a status that needs no recovery."""

    flow = LeafFlow(instant=True)
    kind = "condition"

    @abstractmethod
    def answer(self, world: World) -> bool:
        """Return whether the condition holds now. Raise Failure when that cannot be decided."""
        ...

    def on_tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS if self.answer(cast("World", self.world)) else NodeStatus.FAILURE


class AlwaysSuccess(Node):
    """SUCCESS in its first tick."""

    flow = LeafFlow(steady=True, ends=(SUCCESS,))
    example = """
    Fallback:
      - GoTo: {pose: observe}
      - AlwaysSuccess
    """

    kind = "action"

    def on_tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS


class AlwaysFailure(Node):
    """FAILURE in its first tick, without a report, as a false condition."""

    flow = LeafFlow(steady=True, ends=(FAILURE,))
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


class Condition(ConditionNode):
    """Whether an expression holds. It sees the blackboard's keys and the facts of the world."""

    flow = LeafFlow(steady=True, asks="if")
    example = """
    Condition: {if: "item.colour == 'red' and not holding"}
    """

    expression: In[Expression] = port("the expression that must hold", key="if")

    def answer(self, world: World) -> bool:
        return self.holds(self.expression)


class SetBlackboard(Node):
    """Writes a value to the blackboard."""

    flow = LeafFlow(steady=True, ends=(SUCCESS,))
    example = """
    SetBlackboard: {value: 3, output_key: "{tries}"}
    """

    kind = "action"
    value: In[object] = port("the value, or a reference to an entry")
    output_key: Out[object] = port("the key to write to", like="value")

    def on_tick(self) -> NodeStatus:
        self.output_key = self.value
        return NodeStatus.SUCCESS


class Script(Node):
    """Assigns to keys of the blackboard: `key := expression`, separated by `;`.

    `:=` creates a missing key; `=`, `+=`, `-=`, `*=` and `/=` change an existing one.
    """

    flow = LeafFlow(steady=True, ends=(SUCCESS,))
    example = """
    Script: {code: "tries := 0; limit := 3"}
    """

    kind = "action"
    causes = (tree.MISSING_INPUT,)
    code: In[str] = port("the assignments, such as `n := 3; n += 1`", takes="assignments")

    def on_tick(self) -> NodeStatus:
        assign("code", self.wiring, self.world)
        return NodeStatus.SUCCESS


class Log(Node):
    """Writes a sentence, and a value if given, into the record.

    `picktree replay` and the report show it among the events; the summary of a run does not.
    """

    flow = LeafFlow(steady=True, ends=(SUCCESS,))
    example = """
    Log: {message: now comes, value: "{item.kind}"}
    """

    kind = "action"
    message: In[str] = port("the sentence for the record")
    value: In[object] = port("a value of any type to log after it", default=None)

    def on_tick(self) -> NodeStatus:
        value = plain_copy(self.value)
        self.feedback_message = self.message if value is None else f"{self.message}: {show(value)}"
        self.world.journal.note(event_types.LogEvent(self.feedback_message, self.path, value=value))
        return NodeStatus.SUCCESS


class Sleep(Node):
    """Is RUNNING for `msec`, and then succeeds. With 0 it succeeds in its first tick."""

    flow = LeafFlow(ends=(SUCCESS,))
    example = """
    Sleep: {msec: 500 ms}
    """

    kind = "action"
    msec: In[float] = port("simulated time to wait", unit="ms", least=0)
    remembers = ("_since",)
    _since: float = 0.0

    @property
    def saveable(self) -> bool:
        return True

    def on_start(self) -> None:
        self._since = self.world.clock.now

    def on_tick(self) -> NodeStatus:
        waited = self.world.clock.now - self._since
        return NodeStatus.SUCCESS if waited >= self.msec / 1000.0 - TIME_TOLERANCE else NodeStatus.RUNNING
