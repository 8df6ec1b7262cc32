"""Registry of node classes: built-in nodes, installed plug-ins (entry points), and plug-ins of `plugins:`."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path

from picktree.trees import Node, NodeDeclaration, Plugin
from picktree.world import OUR_PREFIXES, Cause, all_causes, matches

from .plugin import load_installed, load_plugin
from .plugin_import import GROUP, PluginError


@dataclass(frozen=True, slots=True)
class PluginProblem:
    """A plug-in that cannot be used: one sentence, and its own traceback."""

    plugin: str
    message: str
    traceback: str = ""


class NodeRegistry:
    """Node classes by ID.

    Installed plug-ins are imported on the first request for an ID that is not built in. Where only picktree's
    own are installed, the node's module alone is.
    """

    def __init__(self, nodes: Iterable[type[Node]] = (), *, installed: bool = True) -> None:
        from picktree.trees import NODES

        self._nodes: dict[str, type[Node]] = {}
        self._from: dict[str, str] = {}
        self._plugins: list[Plugin] = []
        self._requested: set[str] = set()
        self._problems: list[PluginProblem] = []
        self._lost: list[str] = []
        """Texts of the plug-ins of `plugins:` that could not be loaded."""
        self._pending = installed
        self.add(NODES, "picktree.trees")
        self.add(nodes, "given")

    def find(self, identity: str) -> type[Node] | None:
        known = self._nodes.get(identity)
        if known is not None or not self._pending:
            return known
        modules = [module for _, module, _ in installed_entries()]
        if all(map(_is_ours, modules)):
            doors = map(import_module, modules)
            found = next((getattr(door, identity) for door in doors if identity in door.__all__), None)
            return found if isinstance(found, type) and issubclass(found, Node) else None
        self._load_installed()
        return self._nodes.get(identity)

    def ids(self) -> tuple[str, ...]:
        self._load_installed()
        return tuple(self._nodes)

    def declarations(self) -> tuple[NodeDeclaration, ...]:
        self._load_installed()
        return tuple(node.declaration for node in self._nodes.values())

    @property
    def problems(self) -> tuple[PluginProblem, ...]:
        """Installed plug-ins that failed to load. Only missions that lack a node report them."""
        self._load_installed()
        return tuple(self._problems)

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Return the built-in causes, and those with the prefixes that this registry's nodes declare."""
        self._load_installed()
        declared = (cause for node in self._nodes.values() for cause in node.declaration.causes)
        prefixes = {*OUR_PREFIXES, *(cause.name.split(".")[0] for cause in declared)}
        return tuple(cause for cause in all_causes() if cause.name.split(".")[0] in prefixes)

    @property
    def patterns(self) -> tuple[str, ...]:
        """Return the patterns valid under `when:`: causes, families of causes (`grasp.*`), and `*`."""
        names = [cause.name for cause in self.causes]
        families = {name[:at] for name in names for at, letter in enumerate(name) if letter == "."}
        return (*names, *(f"{family}.*" for family in sorted(families)), "*")

    def registers(self, pattern: str) -> str:
        """Return the plug-in of `plugins:` that registers a cause of the pattern; empty: none does."""
        names = [cause.name.encode() for cause in all_causes() if matches(pattern, cause)]
        return next((one.name for one in self._plugins if any(name in one.source for name in names)), "")

    def plugins_of(self, nodes: Iterable[type[Node]]) -> tuple[Plugin, ...]:
        """Return the plug-ins of `plugins:`, and the installed ones of others that offer one of these
        nodes."""
        used = {self._from.get(node.declaration.id) for node in nodes}
        foreign = (plugin for plugin in self._plugins if not _is_ours(plugin.name))
        return tuple(plugin for plugin in foreign if plugin.name in used | self._requested)

    def copy(self) -> NodeRegistry:
        """Return a copy; a mission's plug-ins are added to it and leave this registry unchanged."""
        other = NodeRegistry(installed=False)
        other._nodes, other._from = dict(self._nodes), dict(self._from)
        other._plugins, other._requested = list(self._plugins), set(self._requested)
        other._problems, other._pending = list(self._problems), self._pending
        other._lost = list(self._lost)
        return other

    def add(self, nodes: Iterable[type[Node]], source: str) -> None:
        """Add all classes or none. Raises PluginError when another class has the ID."""
        given = tuple(nodes)
        for number, node in enumerate(given):
            identity = node.declaration.id
            other = self._nodes.get(identity)
            twice = any(n.declaration.id == identity and n is not node for n in given[:number])
            if twice or (other is not None and other is not node):
                taken = source if twice else self._from[identity]
                raise PluginError(
                    f"the plug-in {source!r}: the node {identity!r} is already offered by {taken}",
                    "give the class a 'node_id' of its own",
                    code="P256",
                )
        for node in given:
            self._nodes.setdefault(node.declaration.id, node)
            self._from.setdefault(node.declaration.id, source)

    def add_plugin(self, plugin: str, folder: Path) -> None:
        """Add a module by its name, or a Python file in `folder`. Raises PluginError with the reason."""
        self._load_installed()  # so that it is the mission's plug-in that hears that an ID is taken
        try:
            self._take(load_plugin(plugin, folder))
        except PluginError:
            self._lost.append(_text(folder / plugin) if plugin.endswith(".py") else "")
            raise
        self._requested.add(plugin)

    def is_lost(self, name: str, *, near: bool = False) -> bool:
        """Whether a node, cause or family may be of a plug-in that could not be loaded.

        Its text has the name then. Where there is no text, any name may be its, but one that is `near` a
        known one.
        """
        word = re.escape(name.removesuffix(".*"))
        pattern = rf"(?<![\w.]){word}" + (r"\." if name.endswith(".*") else r"(?![\w.])")
        return any(re.search(pattern, text) if text else not near for text in self._lost)

    def _take(self, plugin: Plugin) -> None:
        self.add(plugin.nodes, plugin.name)
        if plugin not in self._plugins:
            self._plugins.append(plugin)

    def _load_installed(self) -> None:
        if not self._pending:
            return
        self._pending = False
        for name, value, distribution in installed_entries():
            try:
                self._take(load_installed(value, distribution))
            except PluginError as error:
                self._problems.append(PluginProblem(f"{name} ({value})", error.message, error.detail))


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except (OSError, ValueError):
        return ""


def _is_ours(module: str) -> bool:
    return module.split(".")[0] == "picktree"


def installed_entries() -> tuple[tuple[str, str, str], ...]:
    """Return name, value and distribution of each entry point of installed plug-ins."""
    return _installed(tuple(map(_place, sys.path)))


def _place(folder: str) -> tuple[str, int]:
    """Return a folder in which Python searches, with the time of its last change, ns."""
    try:
        return folder, os.stat(folder or ".").st_mtime_ns
    except OSError:
        return folder, 0


@lru_cache(maxsize=4)
def _installed(places: tuple[tuple[str, int], ...]) -> tuple[tuple[str, str, str], ...]:
    """Return the entry points of plug-ins in these places.

    The built-in entry comes first: when two offer the same ID, the foreign plug-in fails.
    """
    found = sorted(entry_points(group=GROUP), key=lambda e: (not _is_ours(e.value), e.name, e.value))
    return tuple((e.name, e.value, f"{e.dist.name} {e.dist.version}" if e.dist else "") for e in found)
