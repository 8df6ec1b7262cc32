"""Comparisons of values that are never equal, at inputs of any type: the calls of the tree say the types."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from ..files.expressions.type_inference import ValueType, join, unlike_sides
from ..files.marks import Diagnostic
from .circuit import ValueFlow
from .key_writers import NodeExpression, PlacedNode, TreeKeys, expressions_of
from .mission import MAIN
from .references import ATTRIBUTE_TYPES, Constant, ExpressionLocator, PortExpression, Reference
from .value_sources import ValueSource, constant, distinct
from .wiring_faults import expression_fault

MAX_DEPTH: Final = 30
"""Greatest number of sub-trees through which a value is followed."""


def unlike_comparisons(circuit: ValueFlow, pointer: ExpressionLocator) -> Iterator[Diagnostic]:
    """Yield a fault for each comparison that fails with what a call gives, whatever the other values are.

    The parameters of the mission have no call: what is set is not known.
    """
    calls = _Calls(circuit)
    for name, keys in circuit.keys.items():
        open_ = [port.key for port in keys.inputs.values() if port.type.name == "any" and not port.type.many]
        if not open_ or name == MAIN:
            continue
        for placed in keys.places.values():
            for asked in expressions_of(placed.spec):
                inputs = [key for key in open_ if key in asked.expression.names]
                fault = _first_fault(calls, keys, placed, asked, inputs, pointer) if inputs else None
                if fault is not None:
                    yield fault


def _first_fault(
    calls: _Calls,
    keys: TreeKeys,
    placed: PlacedNode,
    asked: NodeExpression,
    inputs: list[str],
    pointer: ExpressionLocator,
) -> Diagnostic | None:
    names: dict[str, ValueType] = {name: keys[name] for name in asked.expression.names if name in keys}
    for key in inputs:
        for source in calls.given(keys.tree.name, key):
            error = unlike_sides(asked.expression, {**names, key: source.type}, ATTRIBUTE_TYPES)
            if error is not None:
                fault = expression_fault(placed, asked, error, pointer, "P226")
                hint = f"{key!r} is {source.type.words()}, {source.told(fault.mark.file)}"
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

    def given(self, tree: str, key: str, depth: int = MAX_DEPTH) -> tuple[ValueSource, ...]:
        """Return the values of an input, one for each call that says its type."""
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
                yield from self.given(keys.tree.name, ports[0], depth - 1)
            elif sources:
                # A key that is written with several types may have the right one here.
                yield replace(sources[0], type=join(source.type for source in sources))
