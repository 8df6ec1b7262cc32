"""The keys of one tree: who writes them, and with what."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

from ..files.expressions.expression import Expression, ExpressionError
from ..files.expressions.type_inference import ANY, BOOL, FLOAT, INT, WORD, ValueType, check_types, join
from ..files.marks import Mark
from ..world.belief.facts import FACTS
from .mission import MAIN, NodeSpec, TreeSpec
from .ports import NameKind, PortDeclaration
from .references import ATTRIBUTE_TYPES, ROOT_KEY, Assignment, Constant, PortExpression, Reference
from .value_sources import ValueSource, constant, declared, distinct, unknown

MAX_CHAIN: Final = 60
"""How far a value is followed from key to key."""


_PLAIN: Mapping[type, ValueType] = {bool: BOOL, int: INT, float: FLOAT, str: WORD}
FACT_TYPES: Final[Mapping[str, ValueType]] = {name: _PLAIN[kind] for name, kind in FACTS.items()}
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
    """The nodes of a tree, parents first."""
    todo = [PlacedNode(tree.root, f"{tree.name}/{tree.root.name}", tree)]
    while todo:
        placed = todo.pop()
        yield placed
        path, above = placed.path, (*placed.above, placed.spec)
        todo += [PlacedNode(n, f"{path}/{n.name}", tree, above) for n in reversed(placed.spec.children)]


@dataclass(frozen=True, slots=True)
class NodeExpression:
    """An expression of a node, and the key under which it stands."""

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
    """All expressions of one node."""
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
    """Return the ports of the node, or of the sub-tree that it stands for."""
    if spec.node is not None:
        return spec.node.declaration.ports
    return trees[spec.id].ports if spec.id in trees else ()


def uses_of(spec: NodeSpec, trees: Mapping[str, TreeSpec]) -> Iterator[KeyUse]:
    """The keys of one node. A wire to a port of a sub-tree reads or writes as the port's direction says."""
    for port in ports_of(spec, trees):
        bound = spec.ports.get(port.key)
        if isinstance(bound, Reference):
            yield KeyUse(spec, port.key, bound.key, port, port.direction == "out")
            if port.remapped and port.direction == "out":
                yield KeyUse(spec, port.key, bound.key, port, writes=False)  # the tree may read it, too
    for asked in expressions_of(spec):
        for name in sorted(asked.expression.names):
            yield KeyUse(spec, asked.key, name, asked.expression, writes=False)
    for name, assignments in spec.postconditions.items():
        for assignment in assignments:
            yield KeyUse(spec, name, assignment.key, assignment, writes=True)


class TreeKeys(Mapping[str, ValueType]):
    """The types of a tree's keys by name, as an expression asks for them, and the sources behind them."""

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
        """By `id` of the spec."""
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
        """All that may write the key; nothing when nobody in the tree does."""
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
        except ExpressionError:
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
            # An output whose type nobody declared: what the sub-tree writes there.
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
