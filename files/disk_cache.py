"""Disk cache: results of slow computations, kept for later processes and found by their inputs.

The key of an entry is a hash over the content of its inputs, and over the source files and library versions
that compute it. So an entry is never out of date, and a change of any of them makes a new one. Entries are
written whole, and checked when they are read; where the disk refuses, results are computed as without a
cache. The folder is `PICKTREE_CACHE` (empty: no cache), else `picktree` in `XDG_CACHE_HOME` or `~/.cache`.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from .errors import PicktreeError
from .library_parts import library_version

if TYPE_CHECKING:
    from numpy.typing import NDArray

Arrays: TypeAlias = "Mapping[str, NDArray[Any]]"
Maker: TypeAlias = ModuleType | Path | str

VARIABLE: Final = "PICKTREE_CACHE"
MAX_BYTES: Final = 200_000_000
"""Size that the entries may have together. Beyond it, those that were used longest ago are deleted."""
_FORMAT: Final = b"picktree cache 1"
_CHECKSUM_BYTES: Final = 32
_SUFFIX: Final = ".entry"
_UNFINISHED: Final = ".part"
_MAX_RECENT: Final = 64
_recent: dict[str, bytes] = {}
"""Entries that this process used last, by name: it reads each file once, and forked processes share them."""


def cache_folder() -> Path | None:
    """Return the folder of the entries, which need not exist; None: there is no cache."""
    chosen = os.environ.get(VARIABLE)
    if chosen is not None:
        return Path(chosen) if chosen else None
    base = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(base):
        return Path(base) / "picktree"
    with suppress(RuntimeError):  # the user has no home folder
        return Path.home() / ".cache" / "picktree"
    return None


def cached_arrays(
    kind: str,
    inputs: Iterable[str | bytes | Path],
    makers: Iterable[Maker],
    compute: Callable[[], Arrays],
) -> dict[str, NDArray[Any]]:
    """Return the arrays of `compute` from the cache; compute and store them when they are missing.

    `inputs`: all data that the result depends on; a path means the content of its file. `makers`: the code
    that computes the result, as our modules or source files and names of libraries. The arrays are new and
    contiguous in either case, so that the cache cannot change a later result. Raises only the exceptions of
    `compute`.
    """
    try:
        name = _entry_name(kind, inputs, makers)
    except OSError:
        return _decoded(_encoded(compute()))
    data = _recent.pop(name, None)
    if data is None:
        folder = cache_folder()
        data = None if folder is None else _read(folder / name)
        if data is None:
            data = _encoded(compute())
            if folder is not None:
                _write(folder / name, data)
    _recent[name] = data
    while len(_recent) > _MAX_RECENT:
        del _recent[next(iter(_recent))]
    return _decoded(data)


def kept(kind: str, inputs: Iterable[str], makers: Iterable[Maker]) -> bytes | None:
    """Return the content that `keep` stored under these inputs; None without one.

    Unlike an array, it may be out of date: the content itself must state its sources.
    """
    folder = cache_folder()
    return None if folder is None else _read(folder / _entry_name(kind, inputs, makers))


def keep(kind: str, inputs: Iterable[str], makers: Iterable[Maker], data: bytes) -> None:
    """Put data into the cache, in place of the former under these inputs, as far as the disk permits."""
    folder = cache_folder()
    if folder is not None:
        _write(folder / _entry_name(kind, inputs, makers), data)


@dataclass(frozen=True, slots=True)
class CacheContent:
    """Folder of the cache (None: no cache), number of its entries, and their size in bytes."""

    folder: Path | None
    entries: int
    size: int

    def to_text(self, *, cleared: bool = False) -> str:
        """Return a line for people. `cleared`: this is the content before the deletion.

        >>> CacheContent(Path("/home/ada/.cache/picktree"), 3, 1_234_567).to_text()
        '/home/ada/.cache/picktree: 3 entries, 1.2 MB'
        """
        if self.folder is None:
            return f"no cache: {VARIABLE} is empty, or there is no home directory"
        number = "1 entry" if self.entries == 1 else f"{self.entries} entries"
        return f"{self.folder}: {number}, {self.size / 1e6:.1f} MB{', deleted' if cleared else ''}"

    def to_json_text(self) -> str:
        folder = None if self.folder is None else str(self.folder)
        content = {"folder": folder, "entries": self.entries, "bytes": self.size}
        return json.dumps(content, ensure_ascii=False, indent=2) + "\n"


def cache_content() -> CacheContent:
    folder = cache_folder()
    sizes = [size for _, size, path in _files(folder) if path.suffix == _SUFFIX]
    return CacheContent(folder, len(sizes), sum(sizes))


def clear_cache() -> CacheContent:
    """Delete all entries and return their count and size. Raises PicktreeError when one cannot be deleted."""
    before = cache_content()
    for _, _, path in _files(before.folder):
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise PicktreeError(
                f"{path} cannot be deleted: {(error.strerror or str(error)).lower()}"
            ) from None
    return before


def _entry_name(kind: str, inputs: Iterable[str | bytes | Path], makers: Iterable[Maker]) -> str:
    """Return the file name of the entry with these inputs. Raises OSError for an unreadable file."""
    key = hashlib.sha256(_FORMAT)
    for part in (kind, *inputs, *map(_maker, makers)):
        content = part.encode() if isinstance(part, str) else part
        content = content.read_bytes() if isinstance(content, Path) else content
        key.update(len(content).to_bytes(8, "little"))
        key.update(content)
    return f"{kind}-{key.hexdigest()[:40]}{_SUFFIX}"


@cache
def _maker(source: Maker) -> bytes:
    """Return an identifier of the version of this source or library."""
    if not isinstance(source, str):
        file = source if isinstance(source, Path) else Path(source.__file__ or "")
        return hashlib.sha256(file.read_bytes()).digest()
    return f"{source} {library_version(source)}".encode()


def _read(entry: Path) -> bytes | None:
    """Return an entry's content; None for a missing or damaged entry."""
    try:
        stored = entry.read_bytes()
        os.utime(entry)  # it was used now
    except OSError:
        return None
    data = stored[_CHECKSUM_BYTES:]
    return data if hashlib.sha256(data).digest() == stored[:_CHECKSUM_BYTES] else None


def _write(entry: Path, data: bytes) -> None:
    """Put an entry into its folder, as far as the disk permits."""
    unfinished = entry.with_name(f".{entry.stem}-{os.urandom(8).hex()}{_UNFINISHED}")
    with suppress(OSError):
        entry.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        try:
            unfinished.write_bytes(hashlib.sha256(data).digest() + data)
            unfinished.replace(entry)
        finally:
            unfinished.unlink(missing_ok=True)
        _trim(entry.parent)


def _trim(folder: Path) -> None:
    """Delete the entries that were used longest ago until the others have at most `MAX_BYTES`.

    A file that a killed process left unfinished is older than the entries in use, and goes with them.
    """
    files = sorted(_files(folder))
    excess = sum(size for _, size, _ in files) - MAX_BYTES
    for _, size, path in files:
        if excess <= 0:
            return
        path.unlink(missing_ok=True)
        excess -= size


def _files(folder: Path | None) -> list[tuple[int, int, Path]]:
    """Return when each of our files was used last, ns, its size and its path."""
    found: list[tuple[int, int, Path]] = []
    with suppress(OSError):
        for path in folder.iterdir() if folder is not None else ():
            if path.suffix in (_SUFFIX, _UNFINISHED):
                with suppress(OSError):  # another process has deleted it
                    state = path.stat()
                    found.append((state.st_mtime_ns, state.st_size, path))
    return found


def _encoded(arrays: Arrays) -> bytes:
    """Return arrays as bytes: a line of JSON with names, types and shapes, then their content."""
    head = [(name, array.dtype.str, array.shape) for name, array in arrays.items()]
    return b"\n".join([json.dumps(head).encode(), b"".join(array.tobytes() for array in arrays.values())])


def _decoded(data: bytes) -> dict[str, NDArray[Any]]:
    import numpy as np

    offset = data.index(b"\n") + 1
    arrays: dict[str, NDArray[Any]] = {}
    for name, kind, shape in json.loads(data[:offset]):
        stored: NDArray[Any] = np.ndarray(shape, kind, data, offset)
        offset += stored.nbytes
        arrays[name] = stored.copy()
    return arrays
