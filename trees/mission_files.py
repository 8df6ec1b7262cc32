"""Where the files come from that a mission includes: its own folder, the built-in library, or a record."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final, Protocol

from ..errors import PicktreeError
from ..files.shipped_files import is_file, shipped_names
from ..files.yaml.document import Document, nearest, open_document, read_document

LIBRARY: Final = Path(__file__).parent / "library"
"""Sub-trees that come with picktree."""
IN_LIBRARY: Final = "library/"


class MissionFiles(Protocol):
    """Gives included files by name: `common.yaml`, `parts/bins.yaml`, or `library/recovery`.

    A name is relative to the mission's folder and never leads out of it.
    """

    def document(self, name: str) -> Document:
        """Raises PicktreeError when there is no such file, FileError when it cannot be read."""
        ...


class FilesOnDisk:
    """The files beside a mission, and the library."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def document(self, name: str) -> Document:
        path = path_of(name, self._folder)
        if not is_file(path):
            raise PicktreeError(_missing(name, self._folder))
        if not name.startswith(IN_LIBRARY) and not _inside(path, self._folder):
            raise PicktreeError(f"{name!r} leads out of the mission's folder by a symbolic link")
        return open_document(path, "mission")


class RecordedFiles:
    """The texts that a record kept, by the names under which the mission included them."""

    def __init__(self, texts: Mapping[str, str], folder: Path) -> None:
        self._texts, self._folder = texts, folder

    def document(self, name: str) -> Document:
        if name not in self._texts:
            raise PicktreeError(f"the record holds no file {name!r}")
        return read_document(self._texts[name], path_of(name, self._folder), "mission")


def path_of(name: str, folder: Path) -> Path:
    """Where the file of that name stands, or stood."""
    if name.startswith(IN_LIBRARY) and not name.endswith((".yaml", ".yml")):
        return LIBRARY / f"{name.removeprefix(IN_LIBRARY)}.yaml"
    return folder / name


def name_of(path: Path, folder: Path) -> str:
    """The name of the file at that path, for a mission in that folder: the inverse of `path_of`."""
    if path.parent == LIBRARY:
        return f"{IN_LIBRARY}{path.stem}"
    return path.relative_to(folder).as_posix()


def library_names() -> tuple[str, ...]:
    """What may stand after `library/`."""
    return shipped_names(LIBRARY)


def _inside(path: Path, folder: Path) -> bool:
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # a circle of symbolic links
        return False


def _missing(name: str, folder: Path) -> str:
    if path_of(name, folder).parent == LIBRARY:
        wanted = name.removeprefix(IN_LIBRARY)
        return f"the library has no {wanted!r} ({nearest(wanted, library_names())})"
    return f"there is no file {name!r} beside the mission"
