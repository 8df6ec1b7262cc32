"""Faults of a mission's wiring and of its expressions, also comparisons of values that are never equal."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Final

from picktree.files import (
    Diagnostic,
    Mark,
    UnknownName,
    ValueType,
    check_types,
    expression_syntax,
    join,
    suggest_name,
    unlike_sides,
)

from .data_flow import (
    ArrivingValue,
    KeyUse,
    NodeExpression,
    PlacedNode,
    TreeKeys,
    ValueFlow,
    ValueSource,
    constant,
    distinct,
    expressions_of,
    type_mismatch,
)
from .mission import MAIN
from .port_types import show
from .ports import SlotDeclaration
from .references import ATTRIBUTE_TYPES, Constant, ExpressionLocator, PortExpression, Reference


def expression_faults(
    circuit: ValueFlow, pointer: ExpressionLocator, unfinished: Collection[str] = ()
) -> Iterator[Diagnostic]:
    """Yield a fault for each expression that can have no value.

    `unfinished`: trees with unreadable parts, which may write any name.
    """
    for name, keys in circuit.keys.items():
        for placed in keys.places.values():
            for node_expression in expressions_of(placed.spec):
                try:
                    check_types(node_expression.expression, keys, ATTRIBUTE_TYPES)
                except UnknownName as error:
                    if name not in unfinished:
                        yield expression_fault(placed, node_expression, error, pointer, "P227")
                except expression_syntax.ExpressionError as error:
                    fault = expression_fault(placed, node_expression, error, pointer, "P226")
                    used = [fact for fact in circuit.facts if fact in node_expression.expression.names]
                    types = ", ".join(f"{fact} is {keys[fact].words()}" for fact in used)
                    yield replace(fault, hint=types)


def expression_fault(
    placed: PlacedNode,
    node_expression: NodeExpression,
    error: expression_syntax.ExpressionError,
    pointer: ExpressionLocator,
    code: str,
) -> Diagnostic:
    """Return the fault of an expression."""
    start = placed.spec.mark_at(node_expression.key)
    mark, message = pointer.describe(start, node_expression.expression.text, error, node_expression.before)
    return Diagnostic(mark, placed.path, f"{node_expression.what}: {message}", "", code)


def wiring_faults(circuit: ValueFlow) -> Iterator[Diagnostic]:
    """Yield the first misfit of each input, and faults of attributes, cases and writes."""
    for keys in circuit.keys.values():
        for placed in keys.places.values():
            yield from _attributes(keys, placed)
            yield from _cases(keys, placed)
        yield from _writes(keys, frozenset(circuit.facts))
    for arrivals in circuit.arrivals:
        wrong = next((arrival for arrival in arrivals if arrival.problem is not None), None)
        if wrong is not None:
            yield _misfit(wrong)


def _misfit(arrival: ArrivingValue) -> Diagnostic:
    at, message = arrival.at, f"port {arrival.at.port.key!r}: {arrival.problem}"
    return Diagnostic(at.mark, at.trail, message, "; ".join(arrival.hints()), "P237")


def _attributes(keys: TreeKeys, placed: PlacedNode) -> Iterator[Diagnostic]:
    """Yield a fault for each attribute of a value that is no object."""
    for key, bound in placed.spec.ports.items():
        if isinstance(bound, Reference) and bound.attributes:
            mark = placed.spec.mark_at(key)
            for message, hint in _no_object(bound, keys.sources(bound.key), mark.file):
                yield Diagnostic(mark, placed.path, f"port {key!r}: {bound}: {message}", hint, "P238")


def _no_object(
    reference: Reference, sources: tuple[ValueSource, ...], file: str
) -> Iterator[tuple[str, str]]:
    wrong = [(reference.key, s.type, s.describe(file)) for s in sources if s.type.kind not in _MAY_BE_OBJECTS]
    attributes = ((name, ATTRIBUTE_TYPES[name]) for name in reference.attributes[:-1])
    wrong += [(name, kind, "") for name, kind in attributes if kind.kind != "object"]
    for name, kind, hint in wrong[:1]:
        yield f"only an object has attributes, and {name!r} is {kind.words()}", hint


_MAY_BE_OBJECTS = ("any", "word", "object")


def _cases(keys: TreeKeys, placed: PlacedNode) -> Iterator[Diagnostic]:
    """Yield a fault for each case that the deciding value can never be."""
    if placed.spec.node is None:
        return
    for slot in placed.spec.node.declaration.slots:
        bound = placed.spec.ports.get(slot.matches or "")
        sources = keys.reference(bound) if isinstance(bound, Reference) else ()
        for label, _ in placed.spec.slots.get(slot.key, ()) if sources else ():
            if not any(_may_be(source, label) for source in sources):
                yield _never(placed, slot, label, str(bound), sources)


def _never(
    placed: PlacedNode, slot: SlotDeclaration, label: str, text: str, sources: tuple[ValueSource, ...]
) -> Diagnostic:
    mark = placed.spec.mark_at(f"{slot.key}/{label}")
    values = [_as_label(value) for source in sources for value in source.values or ()]
    hint = suggest_name(label, values) if values else sources[0].describe(mark.file)
    message = f"{text} is never {label!r}" + ("" if values else f": it is {sources[0].type.words()}")
    return Diagnostic(mark, placed.path, message, hint, "P258")


def _may_be(source: ValueSource, label: str) -> bool:
    """Whether a value of that source may ever choose the case of that name.

    A deciding literal is a setting of the mission, which may have cases for other settings, too.
    """
    if source.certain:
        return True
    if source.values is not None:
        numbers = [v for v in source.values if isinstance(v, int | float) and not isinstance(v, bool)]
        return label in map(_as_label, source.values) or _number(label) in numbers
    match source.type.kind:
        case "bool":
            return label in ("true", "false")
        case "int" | "float" | "number":
            number = _number(label)
            return number is not None and (source.type.kind != "int" or number.is_integer())
        case "null":
            return label == "null"
        case "list" | "mapping":
            return False
        case _:
            return True


def _number(label: str) -> float | None:
    try:
        return float(label)
    except ValueError:
        return None


def _as_label(value: object) -> str:
    return value if isinstance(value, str) else show(value)


def _writes(keys: TreeKeys, facts: frozenset[str]) -> Iterator[Diagnostic]:
    """Yield a fault for each write to an input of the tree, and for each of another type than its output.

    A key that hides a fact is a fault, too.
    """
    for port in keys.tree.ports:
        if port.key in facts:
            yield Diagnostic(_declared(keys, port.key), keys.tree.name, *_hidden(port.key), "P259")
    for key, writes in keys.writes.items():
        for write in writes:
            yield from _write(keys, key, write, facts)


def _write(keys: TreeKeys, key: str, write: KeyUse, facts: frozenset[str]) -> Iterator[Diagnostic]:
    mark, path = write.mark, keys.places[id(write.spec)].path
    what = write.at if write.at.startswith("_") else f"port {write.at!r}"
    output = keys.outputs.get(key)
    if key in keys.inputs:
        message = f"{what}: {key!r} is an input of the tree {keys.tree.name!r}; it cannot be written"
        hint = "declare the port with 'direction: out', or write another key"
        yield Diagnostic(mark, path, message, hint, "P239")
    elif output is not None:
        for source in keys.written(write):
            problem = type_mismatch(source, output, "what it writes", strict=False)
            if problem is not None:
                hint = f"the tree's output {key!r}, {_declared(keys, key).describe(mark.file)}"
                yield Diagnostic(mark, path, f"{what}: {problem}", hint, "P237")
                return
    elif key in facts:
        message, hint = _hidden(key)
        yield Diagnostic(mark, path, f"{what}: {message}", hint, "P259")


def _declared(keys: TreeKeys, port: str) -> Mark:
    return keys.tree.places.get(port, keys.tree.mark)


def _hidden(key: str) -> tuple[str, str]:
    return f"the key {key!r} hides the fact of that name in expressions", "give it another name"


MAX_DEPTH: Final = 30
"""Greatest number of sub-trees through which a value is followed."""


def unlike_comparisons(circuit: ValueFlow, pointer: ExpressionLocator) -> Iterator[Diagnostic]:
    """Yield a fault for each comparison that fails with the value of a call, for all other values.

    Parameters of the mission have no call: their values are unknown.
    """
    calls = _Calls(circuit)
    for name, keys in circuit.keys.items():
        open_ = [port.key for port in keys.inputs.values() if port.type.name == "any" and not port.type.many]
        if not open_ or name == MAIN:
            continue
        for placed in keys.places.values():
            for node_expression in expressions_of(placed.spec):
                inputs = [key for key in open_ if key in node_expression.expression.names]
                fault = (
                    _first_fault(calls, keys, placed, node_expression, inputs, pointer) if inputs else None
                )
                if fault is not None:
                    yield fault


def _first_fault(
    calls: _Calls,
    keys: TreeKeys,
    placed: PlacedNode,
    node_expression: NodeExpression,
    inputs: list[str],
    pointer: ExpressionLocator,
) -> Diagnostic | None:
    names: dict[str, ValueType] = {
        name: keys[name] for name in node_expression.expression.names if name in keys
    }
    for key in inputs:
        for source in calls.input_values(keys.tree.name, key):
            error = unlike_sides(node_expression.expression, {**names, key: source.type}, ATTRIBUTE_TYPES)
            if error is not None:
                fault = expression_fault(placed, node_expression, error, pointer, "P226")
                hint = f"{key!r} is {source.type.words()}, {source.describe(fault.mark.file)}"
                return replace(fault, hint=hint)
    return None


class _Calls:
    """Values that the calls of trees give."""

    def __init__(self, circuit: ValueFlow) -> None:
        self._keys = circuit.keys
        self._known: dict[tuple[str, str], tuple[ValueSource, ...]] = {}
        self._places: dict[str, list[tuple[TreeKeys, PlacedNode]]] = {}
        for keys in circuit.keys.values():
            for placed in keys.places.values():
                if placed.spec.node is None:
                    self._places.setdefault(placed.spec.id, []).append((keys, placed))

    def input_values(self, tree: str, key: str, depth: int = MAX_DEPTH) -> tuple[ValueSource, ...]:
        """Return the values of an input, one for each call with a known type."""
        if depth and (tree, key) not in self._known:
            found = (self._at(*place, key, depth) for place in self._places.get(tree, ()))
            self._known[tree, key] = distinct(source for sources in found for source in sources)
        return self._known.get((tree, key), ())

    def _at(self, keys: TreeKeys, placed: PlacedNode, key: str, depth: int) -> Iterator[ValueSource]:
        bound, mark = placed.spec.ports.get(key), placed.spec.mark_at(key)
        if isinstance(bound, Constant):
            yield constant(bound.value, mark)
        elif isinstance(bound, PortExpression):
            yield keys.computed(bound.value, mark)
        elif isinstance(bound, Reference):
            sources = keys.reference(bound)
            ports = [source.port for source in sources if source.type.kind == "any" and not source.depth]
            if len(sources) == 1 and ports and ports[0] is not None:
                yield from self.input_values(keys.tree.name, ports[0], depth - 1)
            elif sources:
                # A key that is written with several types may have the right one here.
                yield replace(sources[0], type=join(source.type for source in sources))
