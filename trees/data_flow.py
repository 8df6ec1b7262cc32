"""Data flow of a mission before anything runs: the writers of each key with their values, and the values that
arrive at each input. Values flow through keys, lists and the ports of sub-trees.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, cast

from picktree.files import (
    ANY,
    BOOL,
    FLOAT,
    INT,
    OBJECT,
    TEXT,
    WORD,
    Expression,
    Mark,
    ValueType,
    check_types,
    expression_syntax,
    join,
    list_of,
    type_of_value,
)
from picktree.world import Plain, world_facts

from .mission import MAIN, NodeSpec, TreeSpec, bottom_up
from .port_types import accept_value
from .ports import NameKind, PortDeclaration
from .references import (
    ATTRIBUTE_TYPES,
    REFERENCE_IN_TEXT,
    ROOT_KEY,
    Assignment,
    Constant,
    PortExpression,
    Reference,
)

MAX_SOURCES: Final = 40
"""Greatest number of sources of one key; nothing is known of the others."""


@dataclass(frozen=True, slots=True)
class ValueSource:
    """One way in which a key gets its value."""

    type: ValueType
    mark: Mark
    """Place in the text that gives the value."""
    writer: str = ""
    """Path of the node that writes it; empty for an input of the tree."""
    unit: str | None = None
    values: tuple[Plain, ...] | None = None
    """All that it can be, when that is known;"""
    certain: bool = False
    """whether it will be each of them at some time, as a literal is."""
    names: NameKind | None = None
    """Kind of thing in scene or robot that it names."""
    port: str | None = None
    """Input of the tree that passes the value unchanged,"""
    depth: int = 0
    """or whose element it is, at this depth of lists."""

    def describe(self, file: str) -> str:
        """Describe the origin of the value, for a reader of that file."""
        place = self.mark.describe(file)
        if self.writer:
            return f"{self.writer} writes it, {place}"
        return f"the tree's input {self.port!r}, {place}" if self.port else place

    def elements(self) -> ValueSource:
        """Return the source of the elements of this list."""
        inner = self.type.element if self.type.kind == "list" and self.type.element else ANY
        values = None if self.values is None else _flat(self.values)
        return replace(self, type=inner, values=values, depth=self.depth + 1 if self.port else 0)


def _flat(values: Iterable[Plain]) -> tuple[Plain, ...]:
    return tuple(item for value in values if isinstance(value, list) for item in value)


def constant(value: object, mark: Mark, writer: str = "") -> ValueSource:
    """Return the source of a literal or a default."""
    return ValueSource(type_of_value(value), mark, writer, values=(cast("Plain", value),), certain=True)


def unknown(mark: Mark, writer: str = "") -> ValueSource:
    return ValueSource(ANY, mark, writer)


def declared(port: PortDeclaration, mark: Mark, writer: str = "") -> ValueSource:
    """Return the source that an output, or a tree's input, declares."""
    values = None if port.type.many else port.choices
    return ValueSource(type_of_port(port), mark, writer, port.unit, values, names=port.names)


_TYPES: Mapping[str, ValueType] = {
    "string": TEXT, "int": INT, "float": FLOAT, "bool": BOOL, "object": OBJECT,
}  # fmt: skip


def type_of_port(port: PortDeclaration) -> ValueType:
    """Return the type of the values of an output."""
    one = _TYPES.get(port.type.name, ANY)
    found = list_of(one) if port.type.many else one
    return replace(found, optional=port.type.optional)


def distinct(sources: Iterable[ValueSource]) -> tuple[ValueSource, ...]:
    """Return each kind of source once, with the first writer; beyond MAX_SOURCES one unknown source for the
    rest."""
    found: dict[object, ValueSource] = {}
    for source in sources:
        values = repr(source.values)
        found.setdefault((source.type, source.unit, values, source.names, source.port, source.depth), source)
        if len(found) == MAX_SOURCES:
            return (*found.values(), unknown(source.mark, source.writer))
    return tuple(found.values())


DEFAULT: Final = "its default"
"""Text for an input at which nothing is written."""
_TEXTS = ("text", "word", "object", "place")
_TAKES: Mapping[str, tuple[str, ...]] = {
    "string": _TEXTS,
    "object": ("object", "word", "place"),
    "int": ("int", "number"),
    "float": ("int", "float", "number"),
    "bool": ("bool",),
}
"""Kinds of values by the name of the port's type."""


def type_mismatch(source: ValueSource, target: PortDeclaration, text: str, *, strict: bool) -> str | None:
    """Return the reason why the input cannot take the value, as a sentence; None when it can. `text` is the
    text of the file.

    strict: the name of a place is no object, unless the input takes places.
    """
    if not _fits(source.type, target, strict=strict):
        return f"{text} is {source.type.words()}, not {target.type.words()}"
    if source.unit and target.unit and source.unit != target.unit:
        return f"{text} is in {source.unit}, not in {target.unit}"
    values = source.values or ()
    wrong = [problem for value in values if (problem := _refused(value, target)) is not None]
    if wrong and (source.certain or len(wrong) == len(values)):
        # The reason contains a literal already.
        return f"{text}: {wrong[0]}" if text.startswith("{") or text == DEFAULT else wrong[0]
    return None


def _refused(value: object, target: PortDeclaration) -> str | None:
    try:
        accept_value(value, target.type, target.choices, target.within)
    except (TypeError, ValueError) as error:
        return str(error)
    return None


def _fits(value: ValueType, port: PortDeclaration, *, strict: bool) -> bool:
    name = port.type.name
    if value.kind == "any" or (name == "any" and not port.type.many):
        return True
    if value.kind == "null":
        return port.type.optional
    if not port.type.many:
        return _takes(value, port, strict=strict)
    if value.kind != "list":
        return False
    element = value.element
    return element is None or element.kind == "any" or _takes(element, port, strict=strict)


def _takes(value: ValueType, port: PortDeclaration, *, strict: bool) -> bool:
    name = port.type.name
    if name == "object" and value.kind == "place" and strict:
        return port.names in ("bin", "hole", "fixture")
    return name == "any" or value.kind in _TAKES.get(name, (value.kind,))


MAX_CHAIN: Final = 60
"""Greatest number of keys through which a value is followed."""
_PLAIN: Mapping[type, ValueType] = {bool: BOOL, int: INT, float: FLOAT, str: WORD}
FACT_TYPES: Final[Mapping[str, ValueType]] = {name: _PLAIN[kind] for name, kind in world_facts.FACTS.items()}
"""Types of the facts of the world; a text among them is the id of an object."""
_NAMING: Mapping[str, NameKind] = {"kind": "kind", "colour": "colour", "destination": "bin"}
"""Attributes whose value is a name of the scene."""


@dataclass(frozen=True, slots=True)
class PlacedNode:
    """A node with its tree, its path in it, and the nodes above it."""

    spec: NodeSpec
    path: str
    tree: TreeSpec
    above: tuple[NodeSpec, ...] = ()


def placed_nodes(tree: TreeSpec) -> Iterator[PlacedNode]:
    """Yield the nodes of a tree, parents first."""
    todo = [PlacedNode(tree.root, f"{tree.name}/{tree.root.name}", tree)]
    while todo:
        placed = todo.pop()
        yield placed
        path, above = placed.path, (*placed.above, placed.spec)
        todo += [PlacedNode(n, f"{path}/{n.name}", tree, above) for n in reversed(placed.spec.children)]


@dataclass(frozen=True, slots=True)
class NodeExpression:
    """An expression of a node, and its key."""

    key: str
    expression: Expression
    assigned: str = ""
    """Key that gets its value; empty: none."""
    before: int = 0
    """Characters of the text before it."""

    @property
    def what(self) -> str:
        if self.assigned:
            return f"{self.key}: {self.assigned!r}"
        return self.key if self.key.startswith("_") else f"port {self.key!r}"


def expressions_of(spec: NodeSpec) -> Iterator[NodeExpression]:
    """Yield all expressions of one node."""
    for name, expression in spec.preconditions.items():
        yield NodeExpression(name, expression)
    for key, bound in spec.ports.items():
        if isinstance(bound, Constant) and isinstance(bound.value, Expression):
            yield NodeExpression(key, bound.value)
        elif isinstance(bound, PortExpression):
            yield NodeExpression(key, bound.value, before=bound.at)
    for name, assignments in spec.postconditions.items():
        for set_ in assignments:
            yield NodeExpression(name, set_.value, set_.key, set_.at)


@dataclass(frozen=True, slots=True)
class KeyUse:
    """One place of the text that reads or writes a key: under the key `at` of a node."""

    spec: NodeSpec
    at: str
    key: str
    what: PortDeclaration | Assignment | Expression
    writes: bool

    @property
    def mark(self) -> Mark:
        return self.spec.mark_at(self.at)


def ports_of(spec: NodeSpec, trees: Mapping[str, TreeSpec]) -> tuple[PortDeclaration, ...]:
    """Return the ports of the node, or of the sub-tree that it calls."""
    if spec.node is not None:
        return spec.node.declaration.ports
    return trees[spec.id].ports if spec.id in trees else ()


def uses_of(spec: NodeSpec, trees: Mapping[str, TreeSpec]) -> Iterator[KeyUse]:
    """Yield the key uses of one node. A wire to a port of a sub-tree reads or writes by the direction of the
    port."""
    for port in ports_of(spec, trees):
        bound = spec.ports.get(port.key)
        if isinstance(bound, Reference):
            yield KeyUse(spec, port.key, bound.key, port, port.direction == "out")
            if port.remapped and port.direction == "out":
                yield KeyUse(spec, port.key, bound.key, port, writes=False)  # the tree may read it, too
    for place in expressions_of(spec):
        for name in sorted(place.expression.names):
            yield KeyUse(spec, place.key, name, place.expression, writes=False)
    for name, assignments in spec.postconditions.items():
        for assignment in assignments:
            yield KeyUse(spec, name, assignment.key, assignment, writes=True)


class TreeKeys(Mapping[str, ValueType]):
    """Types of a tree's keys by name, for expressions, with the sources of their values."""

    def __init__(
        self,
        tree: TreeSpec,
        trees: Mapping[str, TreeSpec],
        below: Mapping[str, TreeKeys],
        facts: Mapping[str, ValueType],
    ) -> None:
        """`below` are the keys of all trees, by name."""
        self.tree = tree
        self.places = {id(placed.spec): placed for placed in placed_nodes(tree)}
        """Placed nodes by `id` of the spec."""
        self.writes: dict[str, list[KeyUse]] = {}
        self._below, self._facts = below, facts
        self.inputs = {port.key: port for port in tree.ports if port.direction == "in"}
        self.outputs = {port.key: port for port in tree.ports if port.direction == "out"}
        self._sources: dict[str, tuple[ValueSource, ...]] = {}
        self._types: dict[str, ValueType] = {}
        self._open: set[str] = set()
        """Keys that are being looked up; a value that depends on itself is not known."""
        for spec in tree.root.iterate():
            for use in uses_of(spec, trees):
                if use.writes:
                    self.writes.setdefault(use.key, []).append(use)

    # As a mapping: what an expression may name.

    def __getitem__(self, name: str) -> ValueType:
        if name not in self._types:
            if not self.known(name):
                return self._facts[name]
            found = join(source.type for source in self.sources(name))
            if name in self._open:
                return found  # not known yet: it depends on itself
            self._types[name] = found
        return self._types[name]

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and (self.known(name) or name in self._facts)

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys((*self.inputs, *self.outputs, *self.writes, *self._facts)))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    # Sources.

    def known(self, key: str) -> bool:
        """Whether the tree has such a key: an input or output of its own, or one that a node writes."""
        root = self._below.get(MAIN)
        if key.startswith(ROOT_KEY):
            return root is None or root.known(key[1:])
        own = key in self.inputs or key in self.outputs or key in self.writes
        return own or (self is root and any(ROOT_KEY + key in keys.writes for keys in self._below.values()))

    def sources(self, key: str) -> tuple[ValueSource, ...]:
        """Return the sources of the key; empty when no node of the tree writes it."""
        found = self._sources.get(key)
        if found is None:
            if key in self._open or len(self._open) >= MAX_CHAIN:
                return (unknown(self.tree.mark),)
            self._open.add(key)
            found = self._sources[key] = distinct(self._find(key))
            self._open.discard(key)
        return found

    def reference(self, reference: Reference) -> tuple[ValueSource, ...]:
        """Return the sources that a reference may read."""
        sources = self.sources(reference.key)
        if not reference.attributes:
            return sources
        last = reference.attributes[-1]
        kind, names = ATTRIBUTE_TYPES[last], _NAMING.get(last)
        values = kind.choices or None
        return tuple(ValueSource(kind, s.mark, s.writer, values=values, names=names) for s in sources[:1])

    def computed(self, expression: Expression, mark: Mark, writer: str = "") -> ValueSource:
        """Return the source that an expression is; nothing is known of one that can have no value."""
        try:
            found = check_types(expression, self, ATTRIBUTE_TYPES)
        except expression_syntax.ExpressionError:
            found = ANY
        return ValueSource(found, mark, writer)

    def _find(self, key: str) -> Iterator[ValueSource]:
        root = self._below.get(MAIN)
        if key.startswith(ROOT_KEY):
            sources = (unknown(self.tree.mark),) if root is None else root.sources(key[1:])
            yield from (replace(source, port=None, depth=0) for source in sources)
            return
        for keys in self._below.values() if self is root else ():
            for write in keys.writes.get(ROOT_KEY + key, ()):
                yield from (replace(source, port=None, depth=0) for source in keys.written(write))
        own = self.inputs.get(key)
        if own is not None:
            yield replace(declared(own, self.tree.places.get(key, self.tree.mark)), port=key)
        for write in self.writes.get(key, ()):
            yield from self.written(write)

    def written(self, write: KeyUse) -> Iterator[ValueSource]:
        """Yield the sources that one place of the text writes."""
        mark, path, what = write.mark, self.places[id(write.spec)].path, write.what
        if isinstance(what, Assignment):
            yield self.computed(what.value, mark, path)
            return
        assert isinstance(what, PortDeclaration)
        if what.like is not None or what.each_of is not None:
            for source in self._input_of(write.spec, what.like or what.each_of or "", mark):
                yield replace(source if what.like else source.elements(), mark=mark, writer=path)
        elif write.spec.node is None and what.type.name == "any":
            # An output without a declared type has the type that the sub-tree writes.
            for source in self._below[write.spec.id].sources(what.key):
                yield replace(source, mark=mark, writer=path, port=None, depth=0)
        else:
            yield declared(what, mark, path)

    def _input_of(self, spec: NodeSpec, key: str, mark: Mark) -> tuple[ValueSource, ...]:
        bound = spec.ports.get(key)
        if isinstance(bound, Reference):
            return self.reference(bound)
        if isinstance(bound, PortExpression):
            return (self.computed(bound.value, mark),)
        port = spec.node.declaration.port(key) if spec.node is not None else None
        if isinstance(bound, Constant):
            return (constant(bound.value, mark),)
        return (constant(port.default, mark),) if port is not None and not port.required else ()


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
    """Final input: the same one, or that of a node in the sub-tree."""
    node: NodeSpec
    problem: str | None
    """Why it does not fit there."""

    def hints(self) -> list[str]:
        """Describe target and origin of the value."""
        file = self.at.mark.file
        goes = (
            f"the value goes to the port {self.target.key!r} of {self.node.id}, "
            f"{self.node.mark.describe(file)}"
        )
        wired = self.at.text.startswith("{") and self.source.mark != self.at.mark
        comes = [self.source.describe(file)] if wired else []
        if (
            self.at.text.startswith("{=")
            and self.target.type.name == "int"
            and self.source.type.kind == "float"
        ):
            comes = [f'round it, as "{{= round({self.at.text[2:-1].strip()})}}"']
        element = None if self.target.type.many else self.source.type.element
        if self.at.text.startswith("{") and element is not None and _takes(element, self.target, strict=True):
            name = self.at.text[1:-1].removeprefix("=").strip()
            comes.append(f'one of it is "{{= {name}[0]}}", and ForEach takes all in turn')
        if (
            self.at.text.startswith("{")
            and self.target.type.name == "string"
            and not (self.target.names or self.target.choices)
            and self.source.type.kind in ("int", "float", "number")
        ):
            value = self.at.text[1:-1].removeprefix("=").strip()
            operand = value if REFERENCE_IN_TEXT.fullmatch(f"{{{value}}}") else f"({value})"
            comes.append(f"join it to a text, as \"{{= 'text ' + {operand}}}\"")
        return comes if self.target is self.at.port else [goes, *comes]


def _arrival(at: WiredInput, source: ValueSource, demand: _Demand) -> ArrivingValue:
    for _ in range(demand.depth):
        source = source.elements()
    problem = type_mismatch(source, demand.target, at.text, strict=demand.strict)
    return ArrivingValue(at, source, demand.target, demand.node, problem)


class ValueFlow:
    """Trees of a mission with their keys, and the values that arrive at each input.

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
        """Arriving values by input, in the order of the text."""

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
            text = _excerpt(bound.text) if isinstance(bound, Constant) else DEFAULT
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
        """Yield the default of a parameter of the mission, if it reaches nodes."""
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


def _excerpt(text: object) -> str:
    shown = repr(text) if isinstance(text, str) else str(text)
    return shown if len(shown) <= 60 else shown[:57] + "..."
