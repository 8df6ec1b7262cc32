"""The keys of one tree: who writes them, and with what."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

from ...files.expressions.expression import ExpressionError
from ...files.expressions.type_inference import ANY, BOOL, FLOAT, INT, WORD, ValueType, check_types, join
from ...files.marks import Mark
from ...world.belief.facts import FACTS
from ..mission import NodeSpec, TreeSpec
from ..ports import NameKind, PortDeclaration
from ..values.references import ATTRIBUTE_TYPES, Assignment, Constant, Reference
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
    """A node with its path in the tree."""

    path: str
    spec: NodeSpec

    def mark(self, key: str) -> Mark:
        """Where the value of one of its keys stands; of one that is not given, where the node does."""
        return self.spec.places.get(key, self.spec.mark)


@dataclass(frozen=True, slots=True)
class KeyWrite:
    """One place of the text that writes a key."""

    placed: PlacedNode
    place: str
    """Under which key of the node it stands."""
    what: PortDeclaration | Assignment


def placed_below(spec: NodeSpec, above: str) -> Iterator[PlacedNode]:
    """The node and all below it in the same tree, with their paths."""
    todo = [PlacedNode(f"{above}/{spec.name}", spec)]
    while todo:
        placed = todo.pop()
        yield placed
        todo += [PlacedNode(f"{placed.path}/{child.name}", child) for child in reversed(placed.spec.children)]


class TreeKeys(Mapping[str, ValueType]):
    """The types of a tree's keys by name, as an expression asks for them, and the sources behind them."""

    def __init__(
        self,
        tree: TreeSpec,
        trees: Mapping[str, TreeSpec],
        below: Mapping[str, TreeKeys],
        facts: Mapping[str, ValueType],
    ) -> None:
        """`below` are the keys of the trees that this one uses."""
        self.tree = tree
        self.nodes = tuple(placed_below(tree.root, tree.name))
        self.writes: dict[str, list[KeyWrite]] = {}
        self._trees, self._below, self._facts = trees, below, facts
        self._inputs = {port.key: port for port in tree.ports if port.direction == "in"}
        self._outputs = {port.key: port for port in tree.ports if port.direction == "out"}
        self._sources: dict[str, tuple[ValueSource, ...]] = {}
        self._types: dict[str, ValueType] = {}
        self._open: set[str] = set()
        """Keys that are being looked up; a value that depends on itself is not known."""
        for placed in self.nodes:
            for write in self._written_by(placed):
                self.writes.setdefault(_key_of(write), []).append(write)

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
        return iter(dict.fromkeys((*self._inputs, *self._outputs, *self.writes, *self._facts)))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    # Sources.

    def known(self, key: str) -> bool:
        """Whether the tree has such a key: an input or output of its own, or one that a node writes."""
        return key in self._inputs or key in self._outputs or key in self.writes

    def input(self, key: str) -> PortDeclaration | None:
        """The tree's own input of that name."""
        return self._inputs.get(key)

    def output(self, key: str) -> PortDeclaration | None:
        """The tree's own output of that name."""
        return self._outputs.get(key)

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

    def _find(self, key: str) -> Iterator[ValueSource]:
        own = self._inputs.get(key)
        if own is not None:
            yield replace(declared(own, self.tree.places.get(key, self.tree.mark)), port=key)
        for write in self.writes.get(key, ()):
            yield from self.written(write)

    def _written_by(self, placed: PlacedNode) -> Iterator[KeyWrite]:
        spec = placed.spec
        for port in self.ports(spec):
            bound = spec.ports.get(port.key)
            if port.direction == "out" and isinstance(bound, Reference):
                yield KeyWrite(placed, port.key, port)
        for name, assignments in spec.postconditions.items():
            for assignment in assignments:
                yield KeyWrite(placed, name, assignment)

    def ports(self, spec: NodeSpec) -> tuple[PortDeclaration, ...]:
        """Return the ports of a node, or of the tree that it stands for."""
        if spec.node is not None:
            return spec.node.declaration.ports
        called = self._trees.get(spec.id)
        return called.ports if called is not None else ()

    def written(self, write: KeyWrite) -> Iterator[ValueSource]:
        """Yield the sources that one place of the text writes."""
        mark, path = write.placed.mark(write.place), write.placed.path
        if isinstance(write.what, Assignment):
            yield self._assigned(write.what, mark, path)
        elif write.what.like is not None:
            yield from self._passed(write, write.what.like, lambda source: source)
        elif write.what.each_of is not None:
            yield from self._passed(write, write.what.each_of, ValueSource.elements)
        elif write.placed.spec.node is None and write.what.type.name == "any":
            # An output whose type nobody declared: what the sub-tree writes there.
            inner = self._below[write.placed.spec.id].sources(write.what.key)
            yield from (replace(s, mark=mark, writer=path, port=None, depth=0) for s in inner)
        else:
            yield declared(write.what, mark, path)

    def _passed(
        self, write: KeyWrite, key: str, change: Callable[[ValueSource], ValueSource]
    ) -> Iterator[ValueSource]:
        spec, mark, path = write.placed.spec, write.placed.mark(write.place), write.placed.path
        bound = spec.ports.get(key)
        port = spec.node.declaration.port(key) if spec.node is not None else None
        if isinstance(bound, Reference):
            found = self.reference(bound)
        elif isinstance(bound, Constant):
            found = (constant(bound.value, mark),)
        else:
            found = (constant(port.default, mark),) if port is not None and not port.required else ()
        for source in found:
            yield replace(change(source), mark=mark, writer=path)

    def _assigned(self, assignment: Assignment, mark: Mark, path: str) -> ValueSource:
        try:
            return ValueSource(check_types(assignment.value, self, ATTRIBUTE_TYPES), mark, path)
        except ExpressionError:
            return ValueSource(ANY, mark, path)


def _key_of(write: KeyWrite) -> str:
    if isinstance(write.what, Assignment):
        return write.what.key
    bound = write.placed.spec.ports[write.what.key]
    assert isinstance(bound, Reference)
    return bound.key
