"""Which nodes there are: the language's own, installed ones (entry points), those of `plugins:`."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import traceback
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import cast

from ..world.errors import PicktreeError
from .declaration import NodeDeclaration
from .node import Node

GROUP = "picktree.nodes"


@dataclass(frozen=True, slots=True)
class Problem:
    """A plug-in that could not be used: a sentence, and its own traceback."""

    plugin: str
    message: str
    traceback: str = ""


class Registry:
    """Node classes by ID. Installed plug-ins are imported when a name is asked for that is not built in."""

    def __init__(self, nodes: Iterable[type[Node]] = (), *, installed: bool = True) -> None:
        from .controls import NODES  # the control nodes are made from the base, which the registry serves

        self._nodes: dict[str, type[Node]] = {}
        self._from: dict[str, str] = {}
        self._problems: list[Problem] = []
        self._pending = installed
        self.add(NODES, "picktree.trees")
        self.add(nodes, "given")

    def find(self, identity: str) -> type[Node] | None:
        if identity not in self._nodes:
            self._load_installed()
        return self._nodes.get(identity)

    def ids(self) -> tuple[str, ...]:
        self._load_installed()
        return tuple(self._nodes)

    def declarations(self) -> tuple[NodeDeclaration, ...]:
        self._load_installed()
        return tuple(node.declaration for node in self._nodes.values())

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Installed plug-ins that failed. Only a mission that misses a node needs to hear of it."""
        self._load_installed()
        return tuple(self._problems)

    def copy(self) -> Registry:
        """A registry that can take in a mission's plug-ins without this one changing."""
        other = Registry(installed=False)
        other._nodes, other._from = dict(self._nodes), dict(self._from)
        other._problems, other._pending = list(self._problems), self._pending
        return other

    def add(self, nodes: Iterable[type[Node]], source: str) -> None:
        """Raises PicktreeError when an ID is taken by another class."""
        for node in nodes:
            identity = node.declaration.id
            other = self._nodes.get(identity)
            if other is not None and other is not node:
                raise PicktreeError(
                    f"{source}: the node {identity!r} is already offered by {self._from[identity]}"
                )
            self._nodes[identity] = node
            self._from[identity] = source

    def add_plugin(self, plugin: str, folder: Path) -> None:
        """A module by its name, or a Python file in `folder`. Raises PicktreeError with what went wrong."""
        module = _module_of_file(plugin, folder) if plugin.endswith(".py") else _module_named(plugin)
        self.add(_nodes_of(module, plugin), plugin)

    def _load_installed(self) -> None:
        if not self._pending:
            return
        self._pending = False
        for entry in sorted(entry_points(group=GROUP), key=lambda e: (e.name, e.value)):
            name = f"{entry.name} ({entry.value})"
            try:
                self.add(_nodes_of(_module_named(entry.value), name), name)
            except PicktreeError as error:
                cause = error.__cause__
                trace = "".join(traceback.format_exception(cause)) if cause else ""
                self._problems.append(Problem(name, str(error), trace))


def _module_named(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except Exception as error:  # whatever a plug-in's import raises becomes one clear error
        raise PicktreeError(
            f"the plug-in {name!r} cannot be imported: {type(error).__name__}: {error}"
        ) from error


def _module_of_file(plugin: str, folder: Path) -> ModuleType:
    path = (folder / plugin).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise PicktreeError(f"the plug-in {plugin!r} lies outside of the mission's folder")
    if not path.is_file():
        raise PicktreeError(f"there is no plug-in {plugin!r} beside the mission")
    name = f"picktree_plugin_{path.stem}_{zlib.crc32(str(path).encode()):08x}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise PicktreeError(f"the plug-in {plugin!r} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise PicktreeError(
            f"the plug-in {plugin!r} cannot be imported: {type(error).__name__}: {error}"
        ) from error
    return module


def _nodes_of(module: ModuleType, source: str) -> tuple[type[Node], ...]:
    nodes: object = getattr(module, "NODES", None)
    if not isinstance(nodes, tuple | list):
        raise PicktreeError(f"the plug-in {source} has no NODES, a tuple of node classes")
    for node in cast("tuple[object, ...]", nodes):
        if not (isinstance(node, type) and issubclass(node, Node) and hasattr(node, "declaration")):
            raise PicktreeError(f"the plug-in {source}: {node!r} in NODES is not a node class")
    return cast("tuple[type[Node], ...]", tuple(cast("tuple[object, ...]", nodes)))
