"""IfThenElse, WhileDoElse and Switch: a condition or a value selects the branch that is ticked."""

from __future__ import annotations

from typing import cast

from ...world.causes import Failure, tree
from ..flow import Branch, Choice
from ..node import ControlNode
from ..port_types import PortProblem, PortValues, show
from ..ports import In, children, optional_child, port, table
from ..status import NodeStatus


class BranchNode(ControlNode, abstract=True):
    """Node whose first child's answer selects the one that is ticked; reactive: anew at each tick."""

    parts = children("the condition, what is done if it holds, what otherwise", least=2, most=3)
    remembers = ("_chosen",)
    positions = ("_chosen",)
    _chosen: int = 0

    def on_start(self) -> None:
        self._chosen = 0

    def on_tick(self) -> NodeStatus:
        condition = self.parts[0]
        if self._chosen == 0 or cast("Branch", self.flow).reactive:
            answer = condition.step(kept=True)
            if answer not in (NodeStatus.SUCCESS, NodeStatus.FAILURE):
                return answer
            self._chosen = 1 if answer is NodeStatus.SUCCESS else 2
            for index, part in enumerate(self.parts):
                if index not in (0, self._chosen):
                    part.halt()
        if self._chosen == len(self.parts):
            return self.fail_with(condition.failure)
        return self.result_of(self.parts[self._chosen])


class IfThenElse(BranchNode):
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


class WhileDoElse(BranchNode):
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
    remembers = positions = ()


class Switch(ControlNode):
    """Ticks the case whose name is the value of `variable`, else `default`.

    The value is read at every tick; when it changes, the case that was RUNNING is halted before the other is
    ticked, as in BT.CPP. Without a case and a default it fails with tree.no_case.
    """

    flow = Choice(reactive=True)
    example = """
    Switch:
      variable: "{item.form}"
      cases:
        plate: {Grasp: {object: "{item}", force: 15 N}}
        sphere: {Grasp: {object: "{item}", speed: 0.5}}
      default: {Grasp: {object: "{item}"}}
    """

    variable: In[object] = port("the value that decides; it is read at every tick")
    cases = table("what is done for each value", key="cases", required=True, matches="variable")
    default = optional_child("what is done for all other values", key="default")
    causes = (tree.NO_CASE,)

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        seen: dict[object, str] = {}
        wrong: list[PortProblem] = []
        for name in given.labels.get("cases", ()):
            value = _value_of(name)
            if value in seen:
                wrong.append(
                    PortProblem(f"cases/{name}", f"the cases {seen[value]!r} and {name!r} are the same value")
                )
            seen.setdefault(value, name)
        return tuple(wrong)

    def on_tick(self) -> NodeStatus:
        self.read_inputs()
        fitting = (node for name, node in self.cases.items() if is_case(self.variable, name))
        chosen = next(fitting, self.default)
        if chosen is None:
            raise Failure(
                tree.NO_CASE,
                f"no case for {show(self.variable)}, and no default",
                value=str(self.variable),
                cases=list(self.cases),
            )
        for other in self.below:
            if other is not chosen:
                other.halt()
        return self.result_of(chosen)


def _value_of(name: str) -> object:
    """Return the number in a case's name, else the name; equal results are selected by the same values."""
    try:
        return float(name)
    except ValueError:
        return name


def is_case(value: object, name: str) -> bool:
    """Whether the case of that name is the one for the value."""
    if isinstance(value, bool):
        return name == str(value).lower()
    if isinstance(value, int | float):
        try:
            return float(name) == value
        except ValueError:
            return False
    return name == ("null" if value is None else str(value))
