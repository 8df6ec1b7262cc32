"""What a branch may change: keys, and with them what is asked; or the world, and with it its facts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from ...files.expressions.expression import Expression
from ...trees.flow.key_bits import expressions_of
from ...trees.mission import NodeSpec, TreeSpec
from ...trees.values.references import Reference
from ...world.belief.facts import FACTS
from .key_usage import ports_of

_BY_ITSELF = "time"
"""The fact that changes although nobody does anything."""


@dataclass(frozen=True, slots=True)
class Changes:
    """`acts`: something in it may move the robot, look, or do what nobody knows. `keys`: what it writes."""

    acts: bool
    keys: frozenset[str]

    def decides(self, expression: Expression) -> bool:
        """Whether the expression may get another value by it."""
        facts = {name for name in expression.names if name in FACTS}
        by_world = self.acts and bool(facts or expression.paths)
        return by_world or _BY_ITSELF in facts or bool(self.keys & expression.names)


def changes_of(branches: Iterable[NodeSpec], trees: Mapping[str, TreeSpec]) -> Changes:
    """What the branches may change, seen from the tree in which they stand."""
    acts, keys = False, set[str]()
    for branch in branches:
        for spec in branch.iterate():
            keys |= _written(spec, trees)
            if spec.node is None:
                acts = acts or changes_of((trees[spec.id].root,), trees).acts
            elif not spec.children and not spec.node.steady and spec.node.kind != "condition":
                acts = True
    return Changes(acts, frozenset(keys))


def is_steady(branch: NodeSpec, trees: Mapping[str, TreeSpec]) -> bool:
    """Whether it takes no time and answers alike each time, unless something else changes what it asks."""
    written: set[str] = set()
    read: set[str] = set()
    for spec in branch.iterate():
        if spec.node is None:
            if not is_steady(trees[spec.id].root, trees):
                return False
        elif not spec.node.steady:
            return False
        written |= _written(spec, trees)
        read |= set(_read(spec, trees))
    return _BY_ITSELF not in read and not written & read


def depends_on(branch: NodeSpec, trees: Mapping[str, TreeSpec], changes: Changes) -> bool:
    """Whether these changes may make it answer otherwise."""
    if changes.acts:
        return True
    return any(changes.keys & set(_read(spec, trees)) for spec in branch.iterate())


def _written(spec: NodeSpec, trees: Mapping[str, TreeSpec]) -> set[str]:
    outputs = {port.key for port in ports_of(spec, trees) if port.direction == "out"}
    wired = {b.key for key, b in spec.ports.items() if isinstance(b, Reference) and key in outputs}
    return wired | {a.key for assignments in spec.postconditions.values() for a in assignments}


def _read(spec: NodeSpec, trees: Mapping[str, TreeSpec]) -> Iterator[str]:
    outputs = {port.key for port in ports_of(spec, trees) if port.direction == "out"}
    for key, bound in spec.ports.items():
        if isinstance(bound, Reference) and key not in outputs:
            yield bound.key
    for _, expression in expressions_of(spec):
        yield from expression.names
