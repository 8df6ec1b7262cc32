"""Files that runs depend on: modules of picktree and of benchmarks/ that a process has loaded, and files of
the checkout that it opened.

Results are kept with these files and a digest of their contents. They are old when one of the files has
changed, whatever else has.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import re
import sys
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, cast

from picktree.files.file_system import rooms
from picktree.session import sources

ROOT = Path(__file__).resolve().parent.parent
KEPT = "dependencies.json"
"""File in a campaign's folder: the files of its runs, by their digest."""
MACHINERY = frozenset(
    f"benchmarks/{name}"
    for name in (
        *("_campaign.py", "_campaign_results.py", "_dependencies.py", "_evidence.py"),
        *("_soaking.py", "_soak_report.py", "evidence.json", "evidence.py"),
    )
)
"""Files that deal runs out, and count or watch them: no run depends on them."""
_COMMAND_FILES = ("apps/cli/", "session/")
"""Folders that commands of picktree need beside `sources`."""
_ATTACHED = "apps/cli/attach.py"
"""Command in them that no campaign starts: it looks at a run from another process."""
_IMPORT = re.compile(r"^\s*(?:from|import) ((?:picktree[.\w]*)|(?:_\w+))", re.MULTILINE)
_listeners: list[set[str]] = []
"""Sets into which opened files are written; `_hear` cannot be taken away again."""
_hears = False


@cache
def contents() -> Mapping[str, bytes]:
    """Return the bytes of each file of the checkout on which a run may depend, by path.

    They are read once: what is edited while a campaign goes on is not what its workers have loaded.
    """
    found: dict[str, bytes] = {}
    tops = [*rooms(), "benchmarks", "examples", "tests"]
    files = [*ROOT.glob("*.py"), *(file for top in tops for file in _files(ROOT / top))]
    for file in files:
        found[file.relative_to(ROOT).as_posix()] = file.read_bytes()
    return found


def _files(top: Path) -> Generator[Path]:
    for folder, folders, names in os.walk(top):
        folders[:] = sorted(set(folders) - {"results", "node_modules", "__pycache__"})
        yield from (Path(folder, name) for name in sorted(names))


def digest(files: Iterable[str]) -> str:
    """Return a digest of the contents of files, as they were when this process first asked."""
    known = [(file, content(file)) for file in sorted(files)]
    return hashlib.sha256(repr(known).encode()).hexdigest()[:12]


def bytes_digest(files: Iterable[str]) -> str:
    """Return a digest of files as they are now, comments and docstrings included: `digest` parses all code,
    which takes longer than a short run."""
    found = hashlib.sha256()
    for file in sorted(files):
        path = ROOT / file
        found.update(f"{file}\0".encode() + (path.read_bytes() if path.is_file() else b"") + b"\0")
    return found.hexdigest()


def content(file: str) -> str:
    """Return the digest of a file by its path, as it was when this process first asked; empty when there is
    none.

    Comments and docstrings of Python code do not count.
    """
    if file in contents():
        return _kept(file)
    path = ROOT / file
    return _digest(file, path.read_bytes()) if path.is_file() else ""


@cache
def _kept(file: str) -> str:
    return _digest(file, contents()[file])


def _digest(file: str, data: bytes) -> str:
    return hashlib.sha256(_code(data) if file.endswith(".py") else data).hexdigest()[:12]


def _code(source: bytes) -> bytes:
    """Return what is run of Python source, in the form of its syntax tree; the source if it has none."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):
        return source
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = [each for each in node.body if not _is_docstring(each)]
    return ast.dump(tree).encode()


def _is_docstring(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


@contextmanager
def opened() -> Generator[set[str]]:
    """Give a set that is filled with what this process opens to read, and commands of picktree it starts."""
    global _hears
    if not _hears:
        sys.addaudithook(_hear)
        _hears = True
    contents()  # opens all files, most of which no run needs
    found: set[str] = set()
    _listeners.append(found)
    try:
        yield found
    finally:
        _listeners.remove(found)


def _hear(event: str, words: tuple[Any, ...]) -> None:
    if not _listeners:
        return
    new: list[str] = []
    if event == "open":
        path, _, flags = words
        if isinstance(path, str | bytes | os.PathLike) and not (flags or 0) & os.O_ACCMODE:
            new = [os.path.abspath(os.fsdecode(cast("str", path)))]
    elif event == "subprocess.Popen" and "picktree" in [str(word) for word in words[1] or ()]:
        new = [str(ROOT / file) for file in _of_commands()]
    for listener in _listeners:
        listener.update(new)


def used(opened: Iterable[str] = (), modules: Mapping[str, object] | None = None) -> list[str]:
    """Return the files on which a run of this process depends.

    Workers load more than each run needs: of what no run depends on (`sources` leaves it out), only what the
    benchmark imports itself is counted.

    opened: what `opened` gave. modules: those of this process unless given.
    """
    loaded = [
        getattr(module, "__file__", None)
        for module in list((sys.modules if modules is None else modules).values())
    ]
    paths = {os.path.relpath(file, ROOT) for file in [*loaded, *opened] if file}
    found = {path for path in paths if path in contents()} - MACHINERY
    own = {path for path in found if path.startswith("benchmarks/")}
    wanted = _folders(own)
    return sorted(
        path
        for path in found
        if path in sources() or not path.endswith(".py") or path in own or path.startswith(wanted)
    )


def of_program(program: Path) -> list[str]:
    """Return the files on which runs of a program depend for all that can be told without a run."""
    own: set[str] = set()
    waiting = [os.path.relpath(program, ROOT)]
    while waiting:
        if (path := waiting.pop()) not in own:
            own.add(path)
            parts = (f"benchmarks/{name}.py" for name in _imports(path) if name.startswith("_"))
            waiting += [part for part in parts if part in contents()]
    own -= MACHINERY
    imported = (path for path in contents() if path.endswith(".py") and path.startswith(_folders(own)))
    return sorted((own | set(_of_commands()) | set(imported)) - {_ATTACHED})


def _of_commands() -> Iterable[str]:
    more = (path for path in contents() if path.endswith(".py") and path.startswith(_COMMAND_FILES))
    return [*sources(), *(path for path in more if path != _ATTACHED)]


def _folders(programs: Iterable[str]) -> tuple[str, ...]:
    """Return the folders of the modules of picktree that programs import."""
    modules = (name.split(".")[1:] for path in programs for name in _imports(path))
    folders = ("/".join(parts if (ROOT.joinpath(*parts)).is_dir() else parts[:-1]) for parts in modules)
    return tuple(sorted({f"{folder}/" for folder in folders if folder}))


def _imports(path: str) -> list[str]:
    return _IMPORT.findall((ROOT / path).read_text(encoding="utf-8"))


class Dependencies:
    """File of a campaign's folder with the files that its runs depend on."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / KEPT
        self._files: dict[str, list[str]] = {}
        if self._path.exists():
            self._files = json.loads(self._path.read_text(encoding="utf-8"))

    def add(self, files: Iterable[str]) -> str:
        """Keep the files of a run, and return their digest."""
        code = digest(files := sorted(files))
        if self._files.get(code) != files:
            self._files[code] = files
            beside = self._path.with_suffix(".part")
            beside.write_text(json.dumps(self._files, indent=1) + "\n", encoding="utf-8")
            beside.replace(self._path)
        return code

    def hold(self, code: str) -> bool:
        """Whether files with this digest are known, and none of them has changed."""
        return code in self._files and digest(self._files[code]) == code

    @property
    def changed(self) -> bool:
        """Whether a file of any run has changed."""
        return not all(map(self.hold, self._files))

    def clear(self) -> None:
        """Forget all files."""
        self._files.clear()

    @property
    def files(self) -> list[str]:
        """Files of all runs whose files have not changed."""
        return sorted({file for code, files in self._files.items() if self.hold(code) for file in files})
