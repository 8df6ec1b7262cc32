"""Base class of nodes with exactly one child."""

from __future__ import annotations

from ..node import Node
from ..slots import child
from ..status import NodeStatus


class Decorator(Node, abstract=True):
    """Node that changes when its one child is ticked, or how the child's status is reported."""

    kind = "decorator"
    body = child("the child")

    def relay(self) -> NodeStatus:
        """Tick the child; return its status and take over its failure."""
        state = self.body.step()
        return self.fail_with(self.body.failure) if state is NodeStatus.FAILURE else state
