"""Blackboard entries that an operator names and changes: the key, the value, and the types that the tree
gives it."""

from __future__ import annotations

from collections.abc import Iterator

from ..files.errors import PicktreeError
from ..files.expressions.expression import ExpressionError
from ..files.marks import FileError
from ..files.value_wording import suggest_name
from ..files.yaml.reader import read
from ..world.causes import Failure
from ..world.journal import Plain
from .node import Node
from .port_types import accept_value, convert_literal, plain_copy, show
from .ports import PortDeclaration
from .references import PortExpression, Reference
from .runner import BehaviourTree, SubTree
from .runtime import evaluate


def entry_key(tree: BehaviourTree, name: str, here: Node) -> str:
    """Return the full key that a name means: a full key, a key of the tree of `here`, or the end of a key.

    Raises PicktreeError for an unknown key, and for a name that fits several keys.
    """
    known = sorted({*tree.blackboard, *(key for key, _ in _wired_keys(tree))})
    if name in known:
        return name
    here_means = here.wiring.namespace.full_key(name)
    if here_means in known:
        return here_means
    fitting = [key for key in known if key.endswith(f"/{name}")]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise PicktreeError(f"{len(fitting)} keys fit {name!r}: {', '.join(fitting)}")
    raise PicktreeError(f"the blackboard has no key {name!r} ({suggest_name(name, known) or 'it is empty'})")


def entry_value(tree: BehaviourTree, key: str, text: str, here: Node) -> Plain:
    """Return the value of a text for a key: YAML, as in a mission file, or an expression `{= rounds + 1}`.

    `here` is the node at which expressions are evaluated. Raises PicktreeError for a text that has no value,
    and for a value that a port wired to the key does not accept.
    """
    value: object
    try:
        expression = PortExpression.parse(text)
        if expression is not None:
            value = evaluate(expression.value, here.wiring.namespace, here.world)
        else:
            value = read(text, "value").root.value
            for port in _ports_at(tree, key):
                value = convert_literal(value, port.type, port.unit, port.choices, port.within)
    except ExpressionError as error:
        raise PicktreeError(f"{error}, at character {error.offset + 1} of {text!r}") from None
    except Failure as failure:
        raise PicktreeError(failure.message) from None
    except FileError as error:
        raise PicktreeError(f"{text!r} has no value: {error.faults[0].message}") from None
    except ValueError as error:
        raise PicktreeError(f"{key}: {error}") from None
    return checked_value(tree, key, value)


def checked_value(tree: BehaviourTree, key: str, value: object) -> Plain:
    """Return the value as the key's ports have it. Raises PicktreeError for one that a port does not
    accept."""
    try:
        for port in _ports_at(tree, key):
            value = accept_value(value, port.type, port.choices, port.within)
        return plain_copy(value)
    except (ValueError, TypeError) as error:
        raise PicktreeError(f"{key} cannot be {show(value)}: {error}") from None


def _ports_at(tree: BehaviourTree, key: str) -> list[PortDeclaration]:
    """Return the ports that are wired to a key, as far as their types say anything."""
    untyped = ("any", "expression")
    return [port for wired, port in _wired_keys(tree) if wired == key and port.type.name not in untyped]


def _wired_keys(tree: BehaviourTree) -> Iterator[tuple[str, PortDeclaration]]:
    """Yield each port that reads or writes a key as a whole, with the full key."""
    for node in tree.nodes:
        if isinstance(node, SubTree):
            for port in node.interface:
                wired = node.wiring.ports.get(port.key)
                if not (isinstance(wired, Reference) and wired.attributes):
                    yield node.inside.full_key(port.key), port
            continue
        for port in node.declaration.ports:
            wired = node.wiring.ports.get(port.key)
            if isinstance(wired, Reference) and not wired.attributes and port.takes in ("value", "template"):
                yield node.wiring.namespace.full_key(wired.key), port
