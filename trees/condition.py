"""The base of leaves that answer at once whether something holds."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, cast

from .flow.default_flow import leaf
from .node import Node
from .status import NodeStatus

if TYPE_CHECKING:
    from ..cell.world import World
    from .flow import Flow, State
    from .flow.flow_walk import Walk
    from .mission import NodeSpec


class ConditionNode(Node, abstract=True):
    """A question. No is FAILURE without a report: a status, not a failure that needs a cure."""

    kind = "condition"

    @abstractmethod
    def answer(self, world: World) -> bool:
        """Whether it holds now. Raise Failure when that cannot be said."""
        ...

    def on_tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS if self.answer(cast("World", self.world)) else NodeStatus.FAILURE

    @classmethod
    def flow(cls, spec: NodeSpec, entry: State, walk: Walk) -> Flow:
        return leaf(cls, spec, entry, walk, takes_time=False, says_no=True)
