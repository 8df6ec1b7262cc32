"""Files of a mission: its includes and plug-ins, on disk or as a log recorded them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Final, Protocol

from picktree.files import PicktreeError, file_system, suggest_name
from picktree.files.yaml import Document, read_document

LIBRARY: Final = Path(__file__).parent / "library"
"""Folder of the sub-trees that come with picktree."""


IN_LIBRARY: Final = "library/"


class MissionFiles(Protocol):
    """Source of included files by name: `common.yaml`, `parts/bins.yaml`, or `library/recovery`.

    A name is relative to the mission's folder and never leads out of it.
    """

    def document(self, name: str) -> Document:
        """Return the file. Raises PicktreeError for a missing file, FileError for an unreadable one."""
        ...


class FilesOnDisk:
    """Files in the mission's folder, and the library.

    `unsaved`: texts that an editor holds, by path; they count before those on the disk.
    """

    def __init__(self, folder: Path, unsaved: Mapping[Path, str] | None = None) -> None:
        self._folder = folder
        self._unsaved = {path.absolute(): text for path, text in (unsaved or {}).items()}

    def document(self, name: str) -> Document:
        path = path_of(name, self._folder)
        text = self._unsaved.get(path.absolute())
        if text is not None:
            return read_document(path, "mission", text)
        if not file_system.is_file(path):
            raise PicktreeError(_missing(name, self._folder))
        if not name.startswith(IN_LIBRARY) and not _inside(path, self._folder):
            raise PicktreeError(f"{name!r} leads out of the mission's folder by a symbolic link")
        return read_document(path, "mission")


class RecordedFiles:
    """Texts of included files from a log, by the names under which the mission includes them."""

    def __init__(self, texts: Mapping[str, str], folder: Path) -> None:
        self._texts, self._folder = texts, folder

    def document(self, name: str) -> Document:
        if name not in self._texts:
            raise PicktreeError(f"the record holds no file {name!r}")
        return read_document(path_of(name, self._folder), "mission", self._texts[name])


def path_of(name: str, folder: Path) -> Path:
    """Return the path of a file by the name under which a mission in `folder` includes it."""
    if name.startswith(IN_LIBRARY) and not name.endswith((".yaml", ".yml")):
        return LIBRARY / f"{name.removeprefix(IN_LIBRARY)}.yaml"
    return folder / name


def name_of(path: Path, folder: Path) -> str:
    """Return the name under which a mission in `folder` includes a file: the inverse of `path_of`."""
    if path.parent == LIBRARY:
        return f"{IN_LIBRARY}{path.stem}"
    return path.relative_to(folder).as_posix()


def library_names() -> tuple[str, ...]:
    """Return the names that are valid after `library/`."""
    return file_system.shipped_names(LIBRARY)


@lru_cache(maxsize=1)
def library_trees() -> tuple[tuple[str, str], ...]:
    """Return the sub-trees that come with picktree, each with the name under which it is included."""
    found: list[tuple[str, str]] = []
    for name in library_names():
        file = f"{IN_LIBRARY}{name}"
        trees = read_document(path_of(file, LIBRARY), "mission").data.get("trees")
        found += [(tree, file) for tree in (trees if isinstance(trees, dict) else {})]
    return tuple(found)


def _inside(path: Path, folder: Path) -> bool:
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # a circle of symbolic links
        return False


def _missing(name: str, folder: Path) -> str:
    if path_of(name, folder).parent == LIBRARY:
        wanted = name.removeprefix(IN_LIBRARY)
        return f"the library has no {wanted!r} ({suggest_name(wanted, library_names())})"
    return f"there is no file {name!r} beside the mission"
