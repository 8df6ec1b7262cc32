"""ForAttempt: another value for each attempt."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..trees.flow.default_flow import leaf
from ..trees.node import Node
from ..trees.ports import In, Out, port
from ..trees.status import NodeStatus
from ..trees.values.port_values import Given, Misfit

if TYPE_CHECKING:
    from ..trees.flow import Flow, State
    from ..trees.flow.flow_walk import Walk
    from ..trees.mission import NodeSpec


class ForAttempt(Node):
    """Take the value that a list has for this attempt: the first for the first; after the last, the last.

    So an attempt is made with more force, more slowly, through another camera than the one before. Numbers
    are in SI units, without unit.
    """

    example = """
    Recover:
      attempts: 3
      attempt: "{attempt}"
      do:
        - ForAttempt: {attempt: "{attempt}", values: [1.0, 0.5, 0.25], value: "{speed}"}
        - Grasp: {object: "{item}", speed: "{speed}"}
      otherwise: SafeRetreat
    """

    kind = "action"
    played = False
    steady = True
    attempt: In[int] = port("which attempt it is: 1, 2, …; output `attempt` of the Recover", least=1)
    values: In[list[object]] = port("one for each attempt")
    value: Out[object] = port("the one for this attempt", each_of="values")

    @classmethod
    def check_ports(cls, given: Given) -> tuple[str | Misfit, ...]:
        if given.constants.get("values") == []:
            return (Misfit("values", "there is no value", "one for each attempt"),)
        return ()

    def on_tick(self) -> NodeStatus:
        if not self.values:
            return NodeStatus.FAILURE
        self.value = self.values[min(self.attempt, len(self.values)) - 1]
        return NodeStatus.SUCCESS

    @classmethod
    def flow(cls, spec: NodeSpec, entry: State, walk: Walk) -> Flow:
        return leaf(cls, spec, entry, walk, takes_time=False)
