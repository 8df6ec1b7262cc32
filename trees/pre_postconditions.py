"""Pre- and postconditions of a node, as in BehaviorTree.CPP.

`_failureIf`, `_successIf` and `_skipIf` are evaluated in this order before the node starts; `_while` at every
tick. After the end `_onSuccess` or `_onFailure` runs, then `_post`; after a halt while RUNNING `_onHalted`
runs. A skipped node assigns nothing, and a halted one only `_onHalted`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ..world.causes import Failure, FailureReport, tree
from .declaration import PRECONDITIONS
from .runtime import TreeWorld, Wiring, evaluate
from .status import NodeStatus
from .values.failure_reports import with_attached

if TYPE_CHECKING:
    from .mission import Assignment

ON_HALTED = "_onHalted"
_AFTER: Mapping[NodeStatus, tuple[str, ...]] = {
    NodeStatus.SUCCESS: ("_onSuccess", "_post"),
    NodeStatus.FAILURE: ("_onFailure", "_post"),
}
_SETTLED: Mapping[str, NodeStatus] = {
    "_failureIf": NodeStatus.FAILURE,
    "_successIf": NodeStatus.SUCCESS,
    "_skipIf": NodeStatus.SKIPPED,
}


def settled_before(wiring: Wiring, world: TreeWorld, *, running: bool) -> NodeStatus | None:
    """Return the status that a precondition sets instead of a tick; None: the node is ticked.

    Raises Failure when a precondition has no value.
    """
    for name in PRECONDITIONS:
        expression = wiring.preconditions.get(name)
        if expression is None or (running and name != "_while"):
            continue
        true = bool(evaluate(expression, wiring.namespace, world))
        if name == "_while" and not true:
            return NodeStatus.SKIPPED
        if name != "_while" and true:
            return _SETTLED[name]
    return None


def assign_after(wiring: Wiring, world: TreeWorld, state: NodeStatus) -> tuple[FailureReport, ...]:
    """Carry out the assignments for this end (IDLE: a halt); return reports of those that failed."""
    names = (ON_HALTED,) if state is NodeStatus.IDLE else _AFTER.get(state, ())
    problems: list[FailureReport] = []
    for name in names:
        try:
            for assignment in wiring.postconditions.get(name, ()):
                _assign(assignment, wiring, world)
        except Failure as failure:
            problems.append(FailureReport(failure.cause, f"{name}: {failure.message}", {}, wiring.path))
    return tuple(problems)


def after_postconditions(
    wiring: Wiring, world: TreeWorld, state: NodeStatus, failure: FailureReport | None
) -> tuple[NodeStatus, FailureReport | None]:
    """Carry out the postconditions of a node that has ended; return its status and failure after them.

    A postcondition that fails makes a success a failure, and never hides a failure.
    """
    problems = assign_after(wiring, world, state)
    if not problems:
        return state, failure
    if state is NodeStatus.FAILURE and failure is not None:
        return state, with_attached(failure, problems)
    return NodeStatus.FAILURE, with_attached(problems[0], problems[1:])


def _assign(assignment: Assignment, wiring: Wiring, world: TreeWorld) -> None:
    value = evaluate(assignment.value, wiring.namespace, world)
    if not assignment.new and not wiring.namespace.has(assignment.key):
        message = f"nothing has written {assignment.key!r} yet; ':=' writes it anew"
        raise Failure(tree.MISSING_INPUT, message, key=assignment.key)
    try:
        wiring.namespace.write(assignment.key, value, wiring.path)
    except ValueError as error:
        raise Failure(tree.MISSING_INPUT, str(error), key=assignment.key) from None
