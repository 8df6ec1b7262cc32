"""Nodes by their IDs: `nodes.Sequence`, `nodes.Grasp`, those of installed plug-ins, and of plug-in files.

`dir(picktree.nodes)` lists them. A node is made with its children and its ports by name:
`nodes.ForEach(child, in_="{items}", out="{item}")`. `help(nodes.Grasp)` shows ports, units and defaults.
"""

from __future__ import annotations

import sys
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from picktree.trees.loading import NodeRegistry


def plugin(file: str | PathLike[str]) -> ModuleType:
    """Return the module of a plug-in's file, whose nodes are its attributes.

    Raises PicktreeError for a file that is no plug-in, with the reason.
    """
    from picktree.files import PicktreeError
    from picktree.trees.loading import PluginError, load_plugin

    path = Path(file).absolute()
    try:
        loaded = load_plugin(path.name, path.parent)
    except PluginError as error:
        raise PicktreeError(f"{error.message}" + (f" ({error.hint})" if error.hint else "")) from None
    return sys.modules[loaded.nodes[0].__module__]


def _registry() -> NodeRegistry:
    from picktree.trees.loading import NodeRegistry

    return NodeRegistry()


def __dir__() -> list[str]:
    return sorted(["SubTree", "plugin", *_registry().ids()])


def __getattr__(name: str) -> type:
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "SubTree":
        from picktree.trees import runner

        return runner.SubTree
    found = _registry().find(name)
    if found is None:
        from picktree.files import suggest_name
        from picktree.trees.loading import foreign_word

        hint = foreign_word(name) or suggest_name(name, _registry().ids())
        raise AttributeError(f"there is no node {name!r} ({hint})")
    globals()[name] = found
    return found
