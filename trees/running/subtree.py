"""An instance of a sub-tree, with a namespace of its own."""

from __future__ import annotations

from ..blackboard import Namespace
from ..node import Node
from ..runtime import Runtime, Wiring
from ..slots import child
from ..status import NodeStatus
from ..values.references import Constant


class SubTree(Node):
    """Ticks its one child in a namespace of its own.

    A port that is wired to a key of the caller *is* that key; literals and defaults are written when the
    sub-tree starts. `inside` is what the nodes of the sub-tree see.
    """

    node_id = "SubTree"
    kind = "subtree"
    body = child("the root of the sub-tree")

    def __init__(self, wiring: Wiring, runtime: Runtime, inside: Namespace) -> None:
        super().__init__(wiring, runtime)
        self.inside = inside

    def on_start(self) -> None:
        self.on_rewired(frozenset(self.wiring.ports))

    def on_rewired(self, ports: frozenset[str]) -> None:
        for key, wired in self.wiring.ports.items():
            if key in ports and isinstance(wired, Constant):
                self.inside.write(key, wired.value, self.path)

    def on_tick(self) -> NodeStatus:
        state = self.body.step()
        if state is NodeStatus.FAILURE:
            return self.fail_with(self.body.failure)
        return state
