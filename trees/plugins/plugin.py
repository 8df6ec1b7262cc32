"""A plug-in: a Python file beside the mission, or an installed module, that offers nodes."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import re
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from ...files.shipped_files import is_file
from ...world.causes import known_causes, restore_causes
from ..mission import Plugin
from .plugin_import import PluginError, importing
from .plugin_nodes import offered

_DOTTED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")
_LAST = "__picktree_run__"
"""Under this name a file's module keeps what was run."""


def load_plugin(plugin: str, folder: Path) -> Plugin:
    """A Python file in `folder` (`wave.py`), or a module by its name. Raises PluginError."""
    return _file(plugin, folder) if plugin.endswith(".py") else _named(plugin, folder)


def load_installed(module: str, distribution: str = "") -> Plugin:
    """What an entry point names: a module, or `module:attribute`. Raises PluginError."""
    name, _, attribute = module.partition(":")
    with importing(name):
        found = importlib.import_module(name)
        nodes = offered(found, name, attribute or "NODES")
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
    """Whether the missing module is the one that was asked for or one that contains it."""
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
        name = f"picktree_plugin_{path.stem}_{hashlib.sha256(bytes(path)).hexdigest()[:8]}"
        with _replaced(name) as before:
            module = _run(name, path, source, before)
            nodes = offered(module, plugin, "NODES")
    return Plugin(plugin, nodes, path, source)


@dataclass(frozen=True, slots=True)
class _Run:
    """A file as it was run: the same text is not run again, an edited one replaces it with its causes."""

    digest: str
    causes: frozenset[str]


@contextmanager
def _replaced(name: str) -> Generator[ModuleType | None]:
    """The module that has the name now; it comes back when what is inside fails."""
    before = sys.modules.get(name)
    try:
        yield before
    except BaseException:
        sys.modules.pop(name, None)
        if before is not None:
            sys.modules[name] = before
        raise


def _run(name: str, path: Path, source: bytes, before: ModuleType | None) -> ModuleType:
    """The file's module. Two missions that name the same file share its classes, as with an import."""
    digest = hashlib.sha256(source).hexdigest()
    last: _Run | None = getattr(before, _LAST, None)
    if before is not None and last is not None:
        if last.digest == digest:
            return before
        restore_causes({n: cause for n, cause in known_causes().items() if n not in last.causes})
    kept = known_causes()
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    exec(compile(source, str(path), "exec"), vars(module))
    setattr(module, _LAST, _Run(digest, frozenset(known_causes()) - frozenset(kept)))
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
