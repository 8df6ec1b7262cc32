"""Trees made in Python: a named tree with ports, and the text of a mission."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Final

from ..errors import PicktreeError
from ..files.marks import Mark
from ..files.value_wording import suggest_name
from ..files.yaml.reader import Value
from ..files.yaml.writer import from_value, mission_text, value_text
from .description import CalledTree, Described, NodeDescription, plain_value, python_name

MAIN: Final = "Main"
FILE_MODULE: Final = "picktree_plugin_"
"""Beginning of the names under which the files of plug-ins are imported."""
_NOWHERE: Final = Mark("", 1, 1)


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

    def local_classes(self) -> tuple[type, ...]:
        """Return the classes that no file or module offers, as those of a notebook's cells."""
        return tuple(node for node in self.classes() if not _is_ours(node) and _module_of(node) is None)

    def text(self, folder: Path) -> str:
        """Return the text of a mission file in `folder`. Plug-ins are named when a file or module offers
        them."""
        modules = (_module_of(node) for node in self.classes() if not _is_ours(node))
        plugins = dict.fromkeys(_plugin_name(module, folder) for module in modules if module is not None)
        trees = {MAIN: self.main, **trees_of(self.main.root)}
        data: dict[str, Value] = {"picktree": 1, "kind": "mission", "name": self.name}
        data |= {"scene": self.scene} if self.scene is not None else {}
        data |= {"goal": self.goal} if self.goal is not None else {}
        data |= {"include": list(self.include)} if self.include else {}
        data |= {"plugins": list(plugins)} if plugins else {}
        data["trees"] = {name: tree.value() for name, tree in trees.items()}
        return mission_text(from_value(data, _NOWHERE))

    def save(self, file: Path) -> None:
        """Write the mission file. Raises PicktreeError for a node that no file offers, or a disk that
        refuses."""
        for node in self.local_classes():
            raise PicktreeError(
                f"{node.__name__} is defined in {node.__module__}: a mission file can only name nodes of a "
                "module or a Python file with NODES"
            )
        try:
            file.write_text(self.text(file.absolute().parent), encoding="utf-8")
        except OSError as error:
            raise PicktreeError(f"{file}: the mission cannot be written: {error.strerror}") from None


def _is_ours(node: type) -> bool:
    return node.__module__.split(".")[0] == "picktree"


def _module_of(node: type) -> ModuleType | None:
    """Return the module that offers a node to missions; None when its own module has no such NODES."""
    module = sys.modules.get(node.__module__)
    offered = getattr(module, "NODES", ()) if module is not None and module.__name__ != "__main__" else ()
    return module if node in offered else None


def _plugin_name(module: ModuleType, folder: Path) -> str:
    """Return the entry under `plugins:`: a file in the mission's folder by its path, else the module."""
    file = Path(module.__file__).resolve() if module.__file__ else None
    if file is not None and file.is_relative_to(folder.resolve()) and "site-packages" not in file.parts:
        return file.relative_to(folder.resolve()).as_posix()
    if module.__name__.startswith(FILE_MODULE):
        raise PicktreeError(
            f"the plug-in {file} lies outside of {folder}: a mission names plug-ins beside it"
        )
    return module.__name__
