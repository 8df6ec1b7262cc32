"""The base of nodes with exactly one child."""

from __future__ import annotations

from ..node import Node
from ..slots import child
from ..status import NodeStatus


class Decorator(Node, abstract=True):
    """Changes when its child is ticked, or what its answer means."""

    kind = "decorator"
    body = child("the child")

    def relay(self) -> NodeStatus:
        """Tick the child and answer as it does, with its failure."""
        state = self.body.step()
        return self.fail_with(self.body.failure) if state is NodeStatus.FAILURE else state
