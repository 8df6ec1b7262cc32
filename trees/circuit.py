"""Which values arrive at which inputs, through keys, lists and the ports of sub-trees."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

from ..files.expressions.type_inference import ValueType
from ..files.marks import Mark
from .key_writers import PlacedNode, TreeKeys, ports_of
from .mission import MAIN, NodeSpec, TreeSpec, bottom_up
from .ports import PortDeclaration
from .references import Constant, PortExpression
from .value_sources import DEFAULT, ValueSource, constant, type_mismatch

MAX_DEMANDS: Final = 60
"""Greatest number of demands on one input of a tree; more are not followed."""


@dataclass(frozen=True, slots=True)
class _Demand:
    """Use of a tree's input: the port that gets it, or its elements `depth` lists deep."""

    target: PortDeclaration
    node: NodeSpec
    depth: int
    strict: bool


@dataclass(frozen=True, slots=True)
class WiredInput:
    """An input, which may be that of a sub-tree, and the place of the text where it is wired."""

    mark: Mark
    trail: str
    port: PortDeclaration
    text: str
    """Text at that place: `{item.colour}`, or a literal."""


@dataclass(frozen=True, slots=True)
class ArrivingValue:
    """A value that reaches an input."""

    at: WiredInput
    source: ValueSource
    target: PortDeclaration
    """Where it ends up: the same input, or that of a node in the sub-tree."""
    node: NodeSpec
    problem: str | None
    """Why it does not fit there."""

    def hints(self) -> list[str]:
        """Where it goes, and where it comes from."""
        file = self.at.mark.file
        goes = f"it goes to the port {self.target.key!r} of {self.node.id}, {self.node.mark.told(file)}"
        wired = self.at.text.startswith("{") and self.source.mark != self.at.mark
        comes = [self.source.told(file)] if wired else []
        if (
            self.at.text.startswith("{=")
            and self.target.type.name == "int"
            and self.source.type.kind == "float"
        ):
            comes = [f'round it, as "{{= round({self.at.text[2:-1].strip()})}}"']
        return comes if self.target is self.at.port else [goes, *comes]


def _arrival(at: WiredInput, source: ValueSource, demand: _Demand) -> ArrivingValue:
    for _ in range(demand.depth):
        source = source.elements()
    problem = type_mismatch(source, demand.target, at.text, strict=demand.strict)
    return ArrivingValue(at, source, demand.target, demand.node, problem)


class ValueFlow:
    """The trees of a mission with their keys, and what arrives at each input.

    Raises CycleError for sub-trees in a circle.
    """

    def __init__(self, trees: Mapping[str, TreeSpec], facts: Mapping[str, ValueType]) -> None:
        self.keys: dict[str, TreeKeys] = {}
        self.facts = facts
        self._demands: dict[str, dict[str, list[_Demand]]] = {}
        for name in bottom_up(trees):
            self.keys[name] = TreeKeys(trees[name], trees, self.keys, facts)
            self._demands[name] = {}
        for name, keys in self.keys.items():
            for port in trees[name].ports:
                keys.sources(port.key)  # now, so that callers need not look through many trees at once
        self.arrivals = tuple(self._all(trees))
        """By input; what stands first at an input came first in the text."""

    def _all(self, trees: Mapping[str, TreeSpec]) -> Iterator[tuple[ArrivingValue, ...]]:
        for name, keys in self.keys.items():
            for placed in keys.places.values():
                for port in ports_of(placed.spec, trees):
                    if port.direction == "in":
                        yield tuple(self._at(name, placed, port))
        for port in trees[MAIN].ports if MAIN in trees else ():
            yield tuple(self._parameter(trees[MAIN], port))

    def _at(self, tree: str, placed: PlacedNode, port: PortDeclaration) -> Iterator[ArrivingValue]:
        spec = placed.spec
        bound = spec.ports.get(port.key)
        if bound is None and (port.required or port.default == ""):
            return
        inside = self._demands.get(spec.id, {}).get(port.key, []) if spec.node is None else []
        own = _Demand(port, spec, 0, strict=spec.node is not None)
        if bound is None or isinstance(bound, Constant):
            value = bound.value if isinstance(bound, Constant) else port.default
            text = _shown(bound.text) if isinstance(bound, Constant) else DEFAULT
            # It was converted to the port's own type; whether it names something is another question.
            wanted = [own, *inside] if port.names is not None else inside
            place = WiredInput(spec.mark_at(port.key), placed.path, port, text)
            yield from _literal(place, value, wanted)
            return
        place = WiredInput(spec.mark_at(port.key), placed.path, port, str(bound))
        if isinstance(bound, PortExpression):
            source = self.keys[tree].computed(bound.value, place.mark)
            sources = (replace(source, values=source.type.choices or None),)
        else:
            sources = self.keys[tree].reference(bound)
        for source in sources:
            for demand in (own, *inside):
                arrival = _arrival(place, source, demand)
                yield arrival
                if source.port is not None and arrival.problem is None:
                    self._add(tree, source, demand)

    def _parameter(self, main: TreeSpec, port: PortDeclaration) -> Iterator[ArrivingValue]:
        """The default of a parameter of the mission, as far as it goes on to nodes."""
        if port.direction == "in" and not port.required and port.default != "":
            mark = main.places.get(port.key, main.mark)
            place = WiredInput(mark, main.name, port, DEFAULT)
            yield from _literal(place, port.default, self._demands[MAIN].get(port.key, []))

    def _add(self, tree: str, source: ValueSource, demand: _Demand) -> None:
        assert source.port is not None
        found = self._demands[tree].setdefault(source.port, [])
        depth = demand.depth + source.depth
        known = any(d.target is demand.target and d.depth == depth for d in found)
        if not known and len(found) < MAX_DEMANDS:
            found.append(_Demand(demand.target, demand.node, depth, demand.strict))


def _literal(place: WiredInput, value: object, wanted: list[_Demand]) -> Iterator[ArrivingValue]:
    source = constant(value, place.mark)
    for demand in wanted:
        yield _arrival(place, source, demand)


def _shown(text: object) -> str:
    shown = repr(text) if isinstance(text, str) else str(text)
    return shown if len(shown) <= 60 else shown[:57] + "..."
