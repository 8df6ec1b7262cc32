"""Which keys of a tree are read and written, and where, whatever way the tree goes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ...trees.flow.key_bits import expressions_of
from ...trees.mission import NodeSpec, TreeSpec
from ...trees.ports import PortDeclaration
from ...trees.values.references import Reference


@dataclass(frozen=True, slots=True)
class Touch:
    """One place of the text that reads or writes a key: under the key `at` of a node."""

    spec: NodeSpec
    at: str


class Usage:
    """The keys of one tree. A wire to a port of a sub-tree reads or writes as the port's direction says."""

    def __init__(self, tree: TreeSpec, trees: Mapping[str, TreeSpec]) -> None:
        self.reads: dict[str, list[Touch]] = {}
        self.writes: dict[str, list[Touch]] = {}
        for spec in tree.root.iterate():
            outputs = {port.key for port in ports_of(spec, trees) if port.direction == "out"}
            for key, bound in spec.ports.items():
                if isinstance(bound, Reference):
                    touched = self.writes if key in outputs else self.reads
                    touched.setdefault(bound.key, []).append(Touch(spec, key))
            for at, expression in expressions_of(spec):
                for name in sorted(expression.names):
                    self.reads.setdefault(name, []).append(Touch(spec, at))
            for at, assignments in spec.postconditions.items():
                for assignment in assignments:
                    self.writes.setdefault(assignment.key, []).append(Touch(spec, at))


def ports_of(spec: NodeSpec, trees: Mapping[str, TreeSpec]) -> tuple[PortDeclaration, ...]:
    """Of the node, or of the sub-tree that it stands for."""
    return trees[spec.id].ports if spec.node is None else spec.node.declaration.ports
