"""IfThenElse and WhileDoElse: a condition selects the branch that is ticked."""

from __future__ import annotations

from ..flow import Branch
from ..node import ControlNode, Node
from ..slots import children
from ..status import NodeStatus


class IfThenElse(ControlNode):
    """Asks its first child once; then ticks the second (yes) or the third (no) until it ends.

    Without a third child a no is FAILURE. SKIPPED when the condition is skipped.
    """

    flow = Branch()
    example = """
    IfThenElse:
      - Condition: {if: holding}
      - SafeRetreat: {hand: open}
      - GoTo: {pose: home}
    """

    parts = children(
        "the condition, what is done if it holds, what otherwise",
        least=2,
        most=3,
        labels=("if", "then", "else"),
    )
    remembers = ("_chosen",)
    positions = ("_chosen",)
    _chosen: int = 0

    def on_start(self) -> None:
        self._chosen = 0

    def on_tick(self) -> NodeStatus:
        if self._chosen == 0:
            match self.parts[0].step():
                case NodeStatus.SUCCESS:
                    self._chosen = 1
                case NodeStatus.FAILURE:
                    if len(self.parts) == 2:
                        return self.fail_with(self.parts[0].failure)
                    self._chosen = 2
                case other:
                    return other
        chosen = self.parts[self._chosen]
        state = chosen.step()
        return self.fail_with(chosen.failure) if state is NodeStatus.FAILURE else state


class WhileDoElse(ControlNode):
    """Asks its first child at every tick, and ticks the second while it holds, the third while not.

    It is not a loop: it ends when the ticked child ends. As in BT.CPP the branch that is left is halted
    before the other is ticked. Without a third child a no is FAILURE.
    """

    flow = Branch(reactive=True)
    example = """
    WhileDoElse:
      - Condition: {if: items_left}
      - Observe: {camera: overhead, objects: "{items}"}
      - GoTo: {pose: rest}
    """

    parts = children(
        "the condition, what is done while it holds, what otherwise",
        least=2,
        most=3,
        labels=("while", "do", "else"),
    )

    def on_tick(self) -> NodeStatus:
        condition, yes = self.parts[0], self.parts[1]
        no: Node | None = self.parts[2] if len(self.parts) == 3 else None
        match condition.step():
            case NodeStatus.SUCCESS:
                if no is not None:
                    no.halt()
                chosen = yes
            case NodeStatus.FAILURE:
                yes.halt()
                if no is None:
                    return self.fail_with(condition.failure)
                chosen = no
            case other:
                return other
        state = chosen.step()
        return self.fail_with(chosen.failure) if state is NodeStatus.FAILURE else state
