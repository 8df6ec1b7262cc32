"""Loading of plug-ins: a Python file next to the mission, or an installed module, that offers nodes."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import os
import re
import sys
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TypeGuard, cast, get_args

from ...files.shipped_files import is_file
from ...world.causes import OUR_PREFIXES, Cause, Family, known_causes, restore_causes
from ..declaration import Hand, Kind, NodeDeclaration, Resource
from ..mission import Plugin
from ..node import Node
from ..tree_definition import FILE_MODULE
from .motion_calls import check_motion_calls, compiled, watched_names
from .plugin_import import PluginError, importing


def offered_nodes(module: ModuleType, plugin: str, attribute: str) -> tuple[type[Node], ...]:
    """Return the node classes that a plug-in's module lists. Raises PluginError for an invalid class."""
    nodes: object = getattr(module, attribute, None)
    if not isinstance(nodes, tuple | list):
        what = "has no" if nodes is None else "has something else as"
        own = dict.fromkeys(v.__name__ for v in vars(module).values() if _is_node(v, module))
        hint = f"write '{attribute} = ({', '.join(own)},)'" if own else f"as '{attribute} = (Wave,)'"
        raise PluginError(
            f"the plug-in {plugin!r} {what} {attribute}, a tuple of node classes", hint, code="P253"
        )
    if not nodes:
        raise PluginError(f"the plug-in {plugin!r} offers no node: its {attribute} is empty", code="P253")
    for node in cast("tuple[object, ...]", nodes):
        if not _is_node(node):
            raise PluginError(
                f"the plug-in {plugin!r}: {_shown(node)} in {attribute} is not a node class",
                "a class derived from Skill, ConditionNode or Control",
                code="P253",
            )
        _check(node, plugin)
    return cast("tuple[type[Node], ...]", tuple(cast("tuple[object, ...]", nodes)))


def _is_node(value: object, module: ModuleType | None = None) -> TypeGuard[type[Node]]:
    """Whether the value is a node class, and one that this module itself defines."""
    if not (isinstance(value, type) and issubclass(value, Node)):
        return False
    own = module is None or value.__module__ == module.__name__
    return own and isinstance(vars(value).get("declaration"), NodeDeclaration)


def _shown(value: object) -> str:
    name = value.__name__ if isinstance(value, type) else type(value).__name__
    article = "an" if name[0] in "aeiouAEIOU" else "a"
    return name if isinstance(value, type) else f"{article} {name}"


def _check(node: type[Node], plugin: str) -> None:
    """Check a node class for errors that would otherwise appear at the build or at its first failure."""
    declaration = node.declaration

    def wrong(message: str, hint: str = "") -> PluginError:
        return PluginError(f"the plug-in {plugin!r}: node {declaration.id}: {message}", hint, code="P254")

    unwritten = sorted(getattr(node, "__abstractmethods__", ()))
    if unwritten:
        raise wrong(f"it has no {unwritten[0]!r}", "as 'def run(self, world): ...', with a 'yield' in it")
    if node.on_tick is Node.on_tick:
        raise wrong("it has no 'on_tick'", "derive it from Skill and write 'run', or write 'on_tick'")
    if declaration.kind not in get_args(Kind):
        raise wrong(f"its kind {declaration.kind!r} is unknown", _one_of(Kind))
    if declaration.hand_after not in get_args(Hand):
        raise wrong(f"its hand_after {declaration.hand_after!r} is unknown", _one_of(Hand))
    if not _are(declaration.uses, Resource):
        raise wrong("'uses' is a tuple of resources", "as 'uses = (ARM, GRIPPER)'")
    if not _are(declaration.causes, Cause, Family):
        raise wrong("'causes' is a tuple of causes", "as 'causes = (grasp.MISSED, planning.ANY)'")
    if node.__init__ is not Node.__init__:
        hint = "leave it out; what a node begins with is set in 'on_start'"
        raise wrong("it has an '__init__' of its own", hint)
    for cause in declaration.causes:
        _check_cause(cause, plugin, declaration.id)


def _one_of(words: object) -> str:
    return f"one of {', '.join(get_args(words))}"


def _are(values: object, *kinds: type) -> bool:
    return isinstance(values, tuple) and all(isinstance(v, kinds) for v in cast("Iterable[object]", values))


def _check_cause(cause: Cause | Family, plugin: str, node: str) -> None:
    known = known_causes()
    where = f"the plug-in {plugin!r}: node {node}"
    if isinstance(cause, Family):
        if not any(name.startswith(f"{cause.name}.") for name in known):
            raise PluginError(f"{where}: no cause of the family '{cause}' is registered", code="P255")
    elif cause.name not in known:
        prefix = cause.name.split(".")[0]
        hint = "write 'register_cause(Cause(...))'"
        if prefix in OUR_PREFIXES:
            hint = f"the prefix {prefix!r} belongs to picktree; register it under one of your own"
        raise PluginError(f"{where}: the cause '{cause}' is not registered", hint, code="P255")
    elif known[cause.name] != cause:
        meaning = known[cause.name].sentence
        message = f"{where}: the cause '{cause}' is registered with another meaning ({meaning!r})"
        raise PluginError(message, "use what 'register_cause' returns", code="P255")


_DOTTED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")
_OURS = "picktree."
_RUN_ATTRIBUTE = "__picktree_run__"
"""Attribute under which a file's module keeps its `_Run`."""


PLUGINS_VARIABLE = "PICKTREE_PLUGINS"
"""Environment variable that is `refuse` where plug-ins of missions may not be run."""


def load_plugin(plugin: str, folder: Path) -> Plugin:
    """Load a Python file in `folder` (`wave.py`), or a module by its name. Raises PluginError.

    With `PICKTREE_PLUGINS=refuse` in the environment it runs none, and raises.
    """
    if os.environ.get(PLUGINS_VARIABLE) == "refuse":
        message = f"the plug-in {plugin!r} is not run, because nobody has said that this folder is trusted"
        raise PluginError(message, "a plug-in is a program: read it, then trust the folder", code="P262")
    return _file(plugin, folder) if plugin.endswith(".py") else _named(plugin, folder)


def load_installed(module: str, distribution: str = "") -> Plugin:
    """Load the target of an entry point: a module, or `module:attribute`. Raises PluginError."""
    name, _, attribute = module.partition(":")
    with importing(name):
        found = importlib.import_module(name)
        nodes = offered_nodes(found, name, attribute or "NODES")
        for other in dict.fromkeys(node.__module__ for node in nodes):
            if not other.startswith(_OURS):
                own = sys.modules[other]
                check_motion_calls(_source(own)[1], vars(own), other)
    return Plugin(name, nodes, *_source(found), distribution)


def _named(name: str, folder: Path) -> Plugin:
    if not _DOTTED.fullmatch(name):
        hint = "as 'my_cell.skills', or 'wave.py' for a file beside the mission"
        raise PluginError(f"{name!r} cannot be the name of a module", hint, code="P257")
    beside = f"{name}.py"
    hint = f"for the file beside the mission write {beside!r}" if is_file(folder / beside) else ""
    try:
        return load_installed(name)
    except PluginError as error:
        cause = error.__cause__
        if isinstance(cause, ModuleNotFoundError) and _is_part(cause.name, name):
            message = f"there is no plug-in {name!r}: no module of that name is installed"
            raise PluginError(message, hint, code="P257") from None
        if error.code == "P253" and hint:  # a module of Python's own may have the same name
            raise PluginError(error.message, hint, code="P253") from None
        raise


def _is_part(missing: str | None, name: str) -> bool:
    """Whether the missing module is the requested one or a package that contains it."""
    return missing is not None and (name == missing or name.startswith(f"{missing}."))


def _file(plugin: str, folder: Path) -> Plugin:
    try:
        path = (folder / plugin).resolve()
        outside = not path.is_relative_to(folder.resolve())
    except (OSError, ValueError):
        raise PluginError(f"{plugin!r} cannot be the name of a file", code="P257") from None
    if outside:
        message = f"the plug-in {plugin!r} lies outside of the mission's folder"
        raise PluginError(message, "copy it there, or install it and name its module", code="P251")
    if not is_file(path):
        raise PluginError(f"there is no plug-in {plugin!r} beside the mission", code="P257")
    with importing(plugin):
        source = path.read_bytes()
        name = f"{FILE_MODULE}{path.stem}_{hashlib.sha256(bytes(path)).hexdigest()[:8]}"
        with _replaced(name) as before:
            module = _run(name, path, source, before)
            nodes = offered_nodes(module, plugin, "NODES")
            check_motion_calls(source, vars(module), plugin)
    return Plugin(plugin, nodes, path, source)


@dataclass(frozen=True, slots=True)
class _Run:
    """Record of an executed plug-in file. An unchanged text is not run again; an edited one replaces it and
    its causes."""

    digest: str
    causes: frozenset[str]


@contextmanager
def _replaced(name: str) -> Generator[ModuleType | None]:
    """Yield the module that now has the name; restore it when the block fails."""
    before = sys.modules.get(name)
    try:
        yield before
    except BaseException:
        sys.modules.pop(name, None)
        if before is not None:
            sys.modules[name] = before
        raise


def _run(name: str, path: Path, source: bytes, before: ModuleType | None) -> ModuleType:
    """Return the file's module. Missions that name the same file share its classes, as with an import."""
    digest = hashlib.sha256(source).hexdigest()
    last: _Run | None = getattr(before, _RUN_ATTRIBUTE, None)
    if before is not None and last is not None:
        if last.digest == digest:
            return before
        restore_causes({n: cause for n, cause in known_causes().items() if n not in last.causes})
    kept = known_causes()
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    vars(module).update(watched_names())
    exec(compiled(source, path), vars(module))
    setattr(module, _RUN_ATTRIBUTE, _Run(digest, frozenset(known_causes()) - frozenset(kept)))
    return module


def _source(module: ModuleType) -> tuple[Path | None, bytes]:
    file = getattr(module, "__file__", None)
    if not isinstance(file, str) or not file.endswith(".py"):
        return None, b""
    path = Path(file)
    try:
        return path, path.read_bytes()
    except OSError:
        return None, b""
