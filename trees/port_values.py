"""Values of a node's ports: constants, defaults, references read at the start, outputs to be written."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

from ..world.causes import Failure, tree
from ..world.journal import Plain
from .ports import PortDeclaration
from .runtime import TreeWorld, Wiring
from .values.port_types import accept_value, plain_copy
from .values.references import Constant, Reference


def wired_references(
    inputs: tuple[PortDeclaration, ...], wiring: Wiring
) -> Iterator[tuple[PortDeclaration, Reference]]:
    """Yield each input that a reference feeds, with the reference, in the order of the wiring."""
    by_key = {port.key: port for port in inputs}
    for key, wired in wiring.ports.items():
        if isinstance(wired, Reference) and key in by_key:
            yield by_key[key], wired


def constant_inputs(inputs: tuple[PortDeclaration, ...], wiring: Wiring) -> dict[str, object]:
    """Return the values of the inputs that no reference feeds, by key: a copy of the constant or default."""
    found: dict[str, object] = {}
    for port in inputs:
        wired = wiring.ports.get(port.key)
        value = wired.value if isinstance(wired, Constant) else port.default
        if not isinstance(wired, Reference):
            found[port.key] = plain_copy(cast("Plain", value)) if isinstance(value, list) else value
    return found


def read_input(port: PortDeclaration, wired: Reference, wiring: Wiring, world: TreeWorld) -> object:
    """Read an input through its reference.

    Raises Failure(tree.missing_input) when the key is unwritten or empty, or its value does not fit the port.
    """
    where = f"input {port.key!r} of {wiring.id}: "
    evidence = {"port": port.key, "reference": str(wired)}
    try:
        value = wiring.namespace.read(wired, world.scene)
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
