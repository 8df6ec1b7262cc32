"""Base class of nodes as they are made in Python: `Grasp(object="{item}")`, with children in brackets."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

from py_trees.behaviour import Behaviour

from .declaration import NodeDeclaration
from .description import Child, NodeDescription, NodeSignature, describe
from .tree_definition import MAIN, MissionSource, TreeDefinition, node_text


class DescribedNode(Behaviour):
    """Node as the constructor describes it, before a builder binds it to a running tree."""

    declaration: ClassVar[NodeDeclaration]
    description: NodeDescription
    """Ports and children of a node that was made in Python; a node of a running tree has none."""
    __signature__ = NodeSignature()

    def __init__(self, *children: Child, name: str = "", **ports: Any) -> None:
        """Describe a node in Python, in the terms of a mission file; `bound` makes the nodes that are ticked.

        Raises TypeError for a port that the node does not have, or a missing one.
        """
        super().__init__(name=name or self.declaration.id)
        self.description = describe(
            type(self), self.declaration, children, {"name": name, **ports} if name else ports
        )

    def save(self, file: str | PathLike[str], *, scene: str | None = None, name: str = "") -> None:
        """Write a mission file whose `Main` is the tree below this node, made in Python.

        Raises PicktreeError for a node that no file offers, or a disk that refuses.
        """
        path = Path(file)
        MissionSource(TreeDefinition(MAIN, self), name or path.stem, scene).save(path)

    def __repr__(self) -> str:
        if "description" in vars(self):
            return node_text(self.description)
        return f"<{type(self).__name__} {self.name}>"
