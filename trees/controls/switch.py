"""Switch: one branch by a value."""

from __future__ import annotations

from ...world.causes import Failure, tree
from ..node import Control, Node
from ..ports import In, port
from ..slots import optional_child, table
from ..status import NodeStatus
from ..types import show


class Switch(Control):
    """Ticks the case whose name is the value of `variable`, else `default`.

    The value is read at every tick; when it changes, the case that was RUNNING is halted before the other is
    ticked, as in BT.CPP. Without a case and a default it fails with tree.no_case.
    """

    variable: In[object] = port("the value that decides")
    cases = table("what is done for each value", key="cases", required=True)
    default = optional_child("what is done for all other values", key="default")
    causes = (tree.NO_CASE,)

    def on_tick(self) -> NodeStatus:
        self.read_inputs()
        chosen = next((node for name, node in self.cases.items() if _same(self.variable, name)), self.default)
        if chosen is None:
            raise Failure(
                tree.NO_CASE,
                f"no case for {show(self.variable)}, and no default",
                value=str(self.variable),
                cases=list(self.cases),
            )
        self._leave_others(chosen)
        state = chosen.step()
        return self.fail_with(chosen.failure) if state is NodeStatus.FAILURE else state

    def _leave_others(self, chosen: Node) -> None:
        for node in self.below:
            if node is not chosen:
                node.halt()


def _same(value: object, name: str) -> bool:
    if isinstance(value, bool):
        return name == str(value).lower()
    if isinstance(value, int | float):
        try:
            return float(name) == value
        except ValueError:
            return False
    return name == ("null" if value is None else str(value))
