"""Values at a node: inputs and outputs of its ports, preconditions before and postconditions after it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import cast

from ..world.causes import Failure, FailureReport, tree
from ..world.journal import Plain
from .declaration import PRECONDITIONS
from .failure_reports import with_attached
from .port_types import accept_value, plain_copy
from .ports import PortDeclaration
from .references import Assignment, Constant, PortExpression, Reference
from .runtime import TreeWorld, Wiring, evaluate
from .status import NodeStatus


def wired_inputs(
    inputs: tuple[PortDeclaration, ...], wiring: Wiring
) -> Iterator[tuple[PortDeclaration, Reference | PortExpression]]:
    """Yield each input that a reference or an expression feeds, with it, in the order of the wiring."""
    by_key = {port.key: port for port in inputs if port.takes != "key"}
    for key, wired in wiring.ports.items():
        if not isinstance(wired, Constant) and key in by_key:
            yield by_key[key], wired


def reads_key(wired: Reference | PortExpression, wiring: Wiring, full_keys: Collection[str]) -> bool:
    """Return whether the value depends on one of these blackboard keys."""
    names = (wired.key,) if isinstance(wired, Reference) else wired.value.names
    return any(wiring.namespace.full_key(name) in full_keys for name in names)


def constant_inputs(inputs: tuple[PortDeclaration, ...], wiring: Wiring) -> dict[str, object]:
    """Return the values of the inputs that are constant or have their default, by key: copies."""
    found: dict[str, object] = {}
    for port in inputs:
        wired = wiring.ports.get(port.key)
        value = wired.value if isinstance(wired, Constant) else port.default
        if wired is None or isinstance(wired, Constant):
            found[port.key] = plain_copy(cast("Plain", value)) if isinstance(value, list) else value
    return found


def read_input(
    port: PortDeclaration, wired: Reference | PortExpression, wiring: Wiring, world: TreeWorld
) -> object:
    """Read an input through its reference, or evaluate its expression.

    Raises Failure(tree.missing_input) when a key is unwritten or empty, the expression has no value, or the
    value does not fit the port.
    """
    where = f"input {port.key!r} of {wiring.id}: "
    evidence = {"port": port.key, "reference": str(wired)}
    try:
        if isinstance(wired, Reference):
            value: object = wiring.namespace.read(wired, world.scene)
        else:
            value = evaluate(wired.value, wiring.namespace, world, where)
    except KeyError:
        message = f"{where}nothing has written {wired} yet"
        raise Failure(tree.MISSING_INPUT, message, **evidence) from None
    if value is None and not port.type.optional and port.type.name != "any":
        raise Failure(tree.MISSING_INPUT, f"{where}{wired} is empty", **evidence)
    try:
        return accept_value(value, port.type, port.choices, port.within)
    except ValueError as error:
        raise Failure(tree.MISSING_INPUT, f"{where}{wired}: {error}", **evidence) from None


def accept_output(port: PortDeclaration, value: object) -> Plain:
    """Return a plain copy of the value. Raises TypeError when it does not fit the type or choices."""
    try:
        return plain_copy(accept_value(value, port.type, port.choices))
    except (TypeError, ValueError) as error:
        raise TypeError(f"output {port.key!r}: {error}") from None


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
            assign(name, wiring, world)
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


def assign(name: str, wiring: Wiring, world: TreeWorld) -> None:
    """Carry out the assignments under a key of the node. Raises Failure(tree.missing_input)."""
    for assignment in wiring.postconditions.get(name, ()):
        _assign(assignment, wiring, world)


def _assign(assignment: Assignment, wiring: Wiring, world: TreeWorld) -> None:
    value = evaluate(assignment.value, wiring.namespace, world)
    if not assignment.new and not wiring.namespace.has(assignment.key):
        message = f"nothing has written {assignment.key!r} yet; ':=' writes it anew"
        raise Failure(tree.MISSING_INPUT, message, key=assignment.key)
    try:
        wiring.namespace.write(assignment.key, value, wiring.path)
    except ValueError as error:
        raise Failure(tree.MISSING_INPUT, str(error), key=assignment.key) from None
