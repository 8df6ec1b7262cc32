"""Which bit stands for which key of a tree, with those of the sub-trees that it uses behind its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ...files.expressions.expression import Expression
from ...files.expressions.syntax_tree import Name, walk
from ..mission import NodeSpec, TreeSpec
from ..values.references import Constant, Reference


@dataclass(frozen=True, slots=True)
class KeyBits:
    """Bits of one tree. An instance of a sub-tree keeps its keys from one activation to the next, so each
    use of one has a region of its own: its layout, shifted."""

    tree: TreeSpec
    keys: Mapping[str, int]
    flags: Mapping[int, tuple[int, ...]]
    """For nodes that remember something beyond their end, by `id` of the spec."""
    calls: Mapping[int, tuple[int, KeyBits]]
    """Shift and layout of each use of a sub-tree, by `id` of the spec."""
    size: int
    inputs: int
    """The bits of its input ports."""


def lay_out(trees: Mapping[str, TreeSpec], order: tuple[str, ...]) -> dict[str, KeyBits]:
    """The layouts of all trees; `order`: each after those that it uses."""
    layouts: dict[str, KeyBits] = {}
    for name in order:
        tree = trees[name]
        specs = tuple(tree.root.iterate())
        keys: dict[str, int] = {}
        for key in (*(port.key for port in tree.ports), *(key for spec in specs for key in _keys(spec))):
            keys.setdefault(key, 1 << len(keys))
        size = len(keys)
        flags: dict[int, tuple[int, ...]] = {}
        calls: dict[int, tuple[int, KeyBits]] = {}
        for spec in specs:
            if spec.node is None:
                calls[id(spec)] = (size, layouts[spec.id])
                size += layouts[spec.id].size
            elif spec.node.lasting:
                flags[id(spec)] = tuple(1 << size + index for index in range(spec.node.lasting))
                size += spec.node.lasting
        inputs = sum(keys[port.key] for port in tree.ports if port.direction == "in")
        layouts[name] = KeyBits(tree, keys, flags, calls, size, inputs)
    return layouts


def _keys(spec: NodeSpec) -> Iterator[str]:
    """The keys that a node's ports and conditions name, in the order of the file."""
    for bound in spec.ports.values():
        if isinstance(bound, Reference):
            yield bound.key
        elif isinstance(bound.value, Expression):
            yield from _names(bound.value)
    for condition in spec.preconditions.values():
        yield from _names(condition)
    for assignments in spec.postconditions.values():
        for assignment in assignments:
            yield assignment.key
            yield from _names(assignment.value)


def _names(expression: Expression) -> Iterator[str]:
    return (part.name for part in walk(expression.root) if isinstance(part, Name))


def expressions_of(spec: NodeSpec) -> Iterator[tuple[str, Expression]]:
    """The expressions of a node, with the key under which each stands."""
    for key, bound in spec.ports.items():
        if isinstance(bound, Constant) and isinstance(bound.value, Expression):
            yield key, bound.value
    yield from spec.preconditions.items()
    for key, assignments in spec.postconditions.items():
        for assignment in assignments:
            yield key, assignment.value
