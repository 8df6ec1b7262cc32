"""Settings of one run: parameters of the mission, and port values for nodes selected by a pattern."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from picktree.files import PicktreeError, node_matches, suggest_name
from picktree.files.yaml import resolve
from picktree.world import Plain

from .mission import Mission, NodeSpec
from .port_types import PortProblem, PortValues, convert_literal
from .ports import PortDeclaration
from .references import Binding, Constant

Overrides: TypeAlias = Mapping[str, Mapping[str, Constant]]
"""Port values that replace those of the mission, by path of the node in the built tree."""


@dataclass(frozen=True, slots=True)
class RunSettings:
    """Checked settings. `parameters`: values for the ports of `Main`."""

    parameters: Mapping[str, Binding]
    overrides: Overrides


def read_settings(mission: Mission, given: Mapping[str, Plain]) -> RunSettings:
    """Check settings such as `{"rounds": 2, "SortOne/Grasp.force": "15 N"}` against this mission.

    A plain name is a parameter of the mission. A pattern with a dot is the port of every node that matches.
    Texts are read as in a file. Raises PicktreeError for a setting that is unknown, missing or of the wrong
    type.
    """
    plain = {name: value for name, value in given.items() if "." not in name}
    patterns = {name: value for name, value in given.items() if "." in name}
    return RunSettings(_parameters(mission.main.ports, plain), _overrides(mission, patterns))


def parameter_value(value: Plain, port: PortDeclaration) -> object:
    """Convert the value of a mission parameter; a text is read as in a file. Raises ValueError."""
    if isinstance(value, str) and port.type.many:
        value = [_scalar(part.strip(), port) for part in value.split(",") if part.strip()]
    elif isinstance(value, str):
        value = _scalar(value, port)
    return convert_literal(value, port.type, port.unit, port.choices, port.within)


def _scalar(text: str, port: PortDeclaration) -> Plain:
    # A text from the command line means the same as in a file.
    return text if port.type.name in ("string", "object") else resolve(text)


def _parameters(ports: tuple[PortDeclaration, ...], given: Mapping[str, Plain]) -> dict[str, Binding]:
    names = [port.key for port in ports]
    for name in given:
        if name not in names:
            known = suggest_name(name, names) or "it has none"
            raise PicktreeError(f"the mission has no parameter {name!r} ({known})")
    bindings: dict[str, Binding] = {}
    for port in ports:
        if port.key not in given:
            if port.required:
                raise PicktreeError(
                    f"the mission's parameter {port.key!r} needs a value: {port.doc}".rstrip(": ")
                )
            continue
        value = given[port.key]
        try:
            bindings[port.key] = Constant(parameter_value(value, port), value)
        except ValueError as error:
            raise PicktreeError(f"the mission's parameter {port.key!r}: {error}") from None
    return bindings


def _overrides(mission: Mission, given: Mapping[str, Plain]) -> dict[str, dict[str, Constant]]:
    found: dict[str, dict[str, Constant]] = {}
    if not given:
        return found
    nodes = list(_written_out(mission))
    for name, value in given.items():
        pattern, _, key = name.rpartition(".")
        fitting = [(path, spec) for path, spec in nodes if node_matches(pattern, path)]
        if not fitting:
            last = pattern.rpartition("/")[2]
            known = suggest_name(last, sorted({spec.name for _, spec in nodes}))
            raise PicktreeError(f"{name}: no node of the mission fits {pattern!r} ({known})")
        for path, spec in fitting:
            port = _port(mission, spec, name, key)
            try:
                found.setdefault(path, {})[key] = Constant(parameter_value(value, port), value)
            except ValueError as error:
                raise PicktreeError(f"{name}: port {key!r} of {spec.id}: {error}") from None
    for path, spec in nodes:
        if path in found:
            _check_together(spec, found[path])
    return found


def _port(mission: Mission, spec: NodeSpec, name: str, key: str) -> PortDeclaration:
    """Return the node's input of that name. Raises PicktreeError for an unknown name."""
    ports = mission.trees[spec.id].ports if spec.node is None else spec.node.declaration.ports
    inputs = [port for port in ports if port.direction == "in"]
    port = next((port for port in inputs if port.key == key), None)
    if port is None:
        known = suggest_name(key, [port.key for port in inputs]) or "it has none"
        raise PicktreeError(f"{name}: {spec.id} has no input {key!r} ({known})")
    return port


def _check_together(spec: NodeSpec, overrides: Mapping[str, Constant]) -> None:
    """Check the node's ports, overrides included, with its class. Raises PicktreeError for an error."""
    if spec.node is None:
        return
    ports: dict[str, Binding] = {**spec.ports, **overrides}
    constants = {key: bound.value for key, bound in ports.items() if isinstance(bound, Constant)}
    labels = {slot: tuple(label for label, _ in filled) for slot, filled in spec.slots.items()}
    for wrong in spec.node.check_ports(PortValues(frozenset({*ports, *spec.slots}), constants, labels)):
        if isinstance(wrong, PortProblem):
            if wrong.key in overrides:
                hint = f" ({wrong.hint})" if wrong.hint else ""
                raise PicktreeError(f"port {wrong.key!r} of {spec.id}: {wrong.message}{hint}")
        else:
            raise PicktreeError(f"{spec.id}: {wrong}")


def _written_out(mission: Mission) -> Iterator[tuple[str, NodeSpec]]:
    """Yield every node below the root with its path in the built tree."""
    todo = [(mission.main.name, mission.main.root)]
    while todo:
        above, spec = todo.pop()
        path = f"{above}/{spec.name}"
        yield path, spec
        if spec.node is None:
            todo.append((path, mission.trees[spec.id].root))
        todo += [(path, child) for child in reversed(spec.children)]
