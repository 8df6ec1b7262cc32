"""IfThenElse and WhileDoElse: a condition selects the branch that is ticked."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..flow import NOTHING, FlowState, NodeOutcomes, OutcomeCollector, States, tidy
from ..node import ControlNode, Node
from ..slots import children
from ..status import NodeStatus

if TYPE_CHECKING:
    from ..flow.flow_walk import FlowAnalysis
    from ..mission import NodeSpec


class IfThenElse(ControlNode):
    """Asks its first child once; then ticks the second (yes) or the third (no) until it ends.

    Without a third child a no is FAILURE. SKIPPED when the condition is skipped.
    """

    by_turns = True
    steady = True

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

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        ends = OutcomeCollector()
        _branch(spec, frozenset((entry,)), walk, ends)
        return ends.flow()


class WhileDoElse(ControlNode):
    """Asks its first child at every tick, and ticks the second while it holds, the third while not.

    It is not a loop: it ends when the ticked child ends. As in BT.CPP the branch that is left is halted
    before the other is ticked. Without a third child a no is FAILURE.
    """

    steady = True

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

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        ends = OutcomeCollector()
        starts: States = frozenset((entry,))
        while (after := tidy(starts | _branch(spec, starts, walk, ends, asked_anew=True))) != starts:
            starts = after
        return ends.flow()


def _branch(
    spec: NodeSpec, starts: States, walk: FlowAnalysis, ends: OutcomeCollector, *, asked_anew: bool = False
) -> States:
    """Collect the outcomes of the branch that the condition selects; return the states in which a node may
    run.

    `asked_anew`: the condition is ticked again at every tick while a branch runs.
    """
    condition, *branches = spec.children
    asked = walk.child(condition, starts)
    meanwhile = walk.effect(condition, starts) if asked_anew else NOTHING
    ends.skip(asked.skipped)
    ends.run(asked.running)
    running = set(asked.running)
    chosen = (asked.success, tidy(asked.failure))
    for branch, states, never in zip(branches, chosen, ("succeeds", "fails"), strict=False):
        if not states:
            walk.unreached(branch, f"{condition.name} before it never {never}")
            continue
        flow = walk.child(branch, states, meanwhile)
        ends.take(flow)
        running |= flow.running
    if len(branches) == 1:
        ends.fail(asked.failure)
    return tidy(running)
