"""Trees made in Python: a named tree with ports, and the text of a mission."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from ..files.errors import PicktreeError
from ..files.marks import Diagnostic, Mark
from ..files.value_wording import suggest_name
from ..files.yaml.document import Document, read_document
from ..files.yaml.reader import Value
from ..files.yaml.writer import from_value, mission_text, value_text
from .description import CalledTree, Described, NodeDescription, plain_value, python_name

MAIN: Final = "Main"
FILE_MODULE: Final = "picktree_plugin_"
"""Beginning of the names under which the files of plug-ins are imported."""
_NOWHERE: Final = Mark("", 1, 1)
_IN_PYTHON: Final = Mark("mission", 0, 0)


class TreeDefinition:
    """A named tree with typed ports. A call of it is a node: `sort_one(item="{item}")`.

    `ports` has the port's type by name (`"object"`, `"list of float"`), or all that a mission file may say of
    it: `{"type": "float", "unit": "N", "default": 20}`.
    """

    def __init__(self, name: str, root: Described, ports: Mapping[str, object] | None = None) -> None:
        self.name = name
        self.root = root.description
        self.ports = {
            key: plain_value(value, f"port {key!r} of {name}") for key, value in (ports or {}).items()
        }

    def __repr__(self) -> str:
        return f"<tree {self.name}({', '.join(self.ports)})>"

    def describe_call(self, node: type, ports: Mapping[str, object]) -> NodeDescription:
        """Return the description of a call by a node of class `node`.

        Raises TypeError for an unknown port.
        """
        names = {python_name(key): key for key in self.ports}
        for name in ports:
            if name not in (*names, "name") and not name.startswith("_"):
                hint = suggest_name(name, names)
                raise TypeError(f"{self.name} has no port {name!r}" + (f" ({hint})" if hint else ""))
        values = {
            names.get(name, name): plain_value(value, f"port {name!r} of {self.name}")
            for name, value in ports.items()
        }
        return NodeDescription(self.name, node, values, {}, self)

    def value(self) -> Value:
        """Return the tree as a mission file has it."""
        root = self.root.value()
        if not self.ports:
            return root
        return {"ports": dict(self.ports), **(root if isinstance(root, dict) else {str(root): None})}


def trees_of(main: NodeDescription) -> dict[str, CalledTree]:
    """Return the trees that a tree calls, directly or not, by name.

    Raises PicktreeError when two trees have the same name.
    """
    found: dict[str, CalledTree] = {}
    todo = [main]
    while todo:
        for tree in (node.tree for node in todo.pop().iterate() if node.tree is not None):
            known = found.get(tree.name)
            if known is None and tree.name != MAIN:
                found[tree.name] = tree
                todo.append(tree.root)
            elif known is not tree:
                raise PicktreeError(f"two different trees are called {tree.name!r}")
    return found


def node_text(node: NodeDescription) -> str:
    """Return a node as text in the style of mission files."""
    return value_text(from_value(node.value(), _NOWHERE))


@dataclass(frozen=True, slots=True)
class MissionSource:
    """Mission made in Python: its main tree and the head of its file."""

    main: TreeDefinition
    """Tree `Main`; its ports are the mission's parameters."""
    name: str
    scene: str | None = None
    goal: str | None = None
    include: tuple[str, ...] = ()

    def classes(self) -> dict[type, None]:
        """Return the classes of all nodes, in order."""
        roots = [self.main.root, *(tree.root for tree in trees_of(self.main.root).values())]
        return {node.node: None for root in roots for node in root.iterate() if node.tree is None}

    def local_classes(self, folder: Path) -> tuple[type, ...]:
        """Return the classes that a file in `folder` cannot name, as those of a notebook's cells."""
        foreign = (node for node in self.classes() if not _is_ours(node))
        return tuple(node for node in foreign if _plugin_name(node, folder) is None)

    def text(self, folder: Path) -> str:
        """Return the text of a mission file in `folder`, with the plug-ins that such a file can name."""
        named = (_plugin_name(node, folder) for node in self.classes() if not _is_ours(node))
        plugins: list[Value] = list(dict.fromkeys(name for name in named if name is not None))
        trees = {MAIN: self.main, **trees_of(self.main.root)}
        data: dict[str, Value] = {"picktree": 1, "kind": "mission", "name": self.name}
        data |= {"scene": self.scene} if self.scene is not None else {}
        data |= {"goal": self.goal} if self.goal is not None else {}
        data |= {"include": list(self.include)} if self.include else {}
        data |= {"plugins": plugins} if plugins else {}
        data["trees"] = {name: tree.value() for name, tree in trees.items()}
        return mission_text(from_value(data, _NOWHERE))

    def document(self, folder: Path) -> Document:
        """Return the mission as a document in `folder` that is not written there."""
        return read_document(folder / f"{self.name}.yaml", "mission", self.text(folder))

    def save(self, file: Path) -> None:
        """Write the mission file. Raises PicktreeError for a node that no file offers, or a disk that
        refuses."""
        folder = file.absolute().parent
        for node in self.local_classes(folder):
            raise PicktreeError(
                f"{node.__name__} is defined in {_place_of(node)}: a mission file names nodes of modules, "
                f"and of Python files in its folder {folder}, that list them in NODES"
            )
        try:
            file.write_text(self.text(folder), encoding="utf-8")
        except OSError as error:
            raise PicktreeError(f"{file}: the mission cannot be written: {error.strerror}") from None


def python_faults(faults: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Return faults of a mission that was made in Python: their places are paths in the tree, not lines."""
    return tuple(replace(fault, mark=_IN_PYTHON) for fault in faults)


def _is_ours(node: type) -> bool:
    return node.__module__.split(".")[0] == "picktree"


def _plugin_name(node: type, folder: Path) -> str | None:
    """Return the entry under `plugins:` for a node: a file in the mission's folder, else a module.

    None when no such entry leads to the node.
    """
    module = sys.modules.get(node.__module__)
    if module is None or module.__name__ == "__main__" or node not in getattr(module, "NODES", ()):
        return None
    file = Path(module.__file__).resolve() if module.__file__ else None
    beside = file is not None and file.is_relative_to(folder.resolve()) and "site-packages" not in file.parts
    if file is not None and beside:
        return file.relative_to(folder.resolve()).as_posix()
    return None if module.__name__.startswith(FILE_MODULE) else module.__name__


def _place_of(node: type) -> str:
    module = sys.modules.get(node.__module__)
    return str(getattr(module, "__file__", None) or node.__module__)
