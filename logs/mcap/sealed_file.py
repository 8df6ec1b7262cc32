"""File that always has a complete ending behind its data, and appears under its name with its first
content."""

from __future__ import annotations

import errno
import os
import shutil
import threading
from contextlib import suppress
from pathlib import Path
from typing import Protocol

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

from ...files.errors import PicktreeError
from ...files.file_names import fitted

MIN_FREE_BYTES = 32_000_000
"""Free bytes that a new log demands: ten minutes of a run."""

_ADVICE = "make room there, or give another folder with --out"


class RawFile(Protocol):
    """Unbuffered binary file: written data is with the operating system at once."""

    def seek(self, offset: int, /) -> int: ...
    def write(self, data: memoryview, /) -> int | None: ...
    def truncate(self, size: int, /) -> int: ...
    def fileno(self) -> int: ...
    def close(self) -> None: ...


def open_raw(path: Path) -> RawFile:
    """Open a new, empty file, and lock it for as long as it is open, where the system has such locks."""
    file = path.open("w+b", buffering=0)
    if fcntl is not None:
        with suppress(OSError):  # some network disks have none
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    return file


def is_written(path: Path) -> bool:
    """Whether a process that still lives has the file open for writing, as far as locks tell."""
    if fcntl is None:
        return False
    try:
        with path.open("rb") as file:
            fcntl.flock(file.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def require_free_space(path: Path) -> None:
    """Raise PicktreeError when a log at `path` would soon fill the disk."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(path.parent).free
    except OSError as error:
        raise _unwritable(path, error) from None
    if free < MIN_FREE_BYTES:
        raise PicktreeError(
            f"{path}: only {free / 1e6:.1f} MB are free there, and a log begins with "
            f"{MIN_FREE_BYTES / 1e6:.0f} MB of "
            f"room; {_ADVICE}"
        )


class TrailerFile:
    """File of growing data, with an ending behind it that each write replaces.

    An ending is never shorter than the one before, so one write replaces it completely. The file has another
    name until `publish`. After the disk has refused, `failure` holds the error, and the file is closed with
    the ending that it had before.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.end = 0
        """Bytes of data so far; offset of the ending."""
        self.failure: PicktreeError | None = None
        self._ending = b""
        self._hidden: Path | None = path.with_name(fitted(f"{path.name}.part"))
        self._syncing = threading.Lock()
        self._unsynced = False
        self._refused: OSError | None = None
        self._file: RawFile | None = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open_raw(self._hidden)
        except OSError as error:
            raise _unwritable(path, error) from None

    @property
    def closed(self) -> bool:
        return self._file is None

    @property
    def published(self) -> bool:
        return self._hidden is None

    @property
    def size(self) -> int:
        return self.end + len(self._ending)

    def append(self, data: bytes, ending: bytes) -> None:
        """Append data and replace the ending. Raises PicktreeError when the disk refuses, or has refused
        before."""
        file = self._open()
        try:
            if self._refused is not None:
                raise self._refused
            _write(file, data + ending, self.end)
        except OSError as error:
            raise self._given_up(file, error) from None
        self.end += len(data)
        self._ending = ending
        self._unsynced = True

    def publish(self) -> None:
        """Rename the file to its final name, in place of one that had it before."""
        if self._hidden is None:
            return
        file = self._open()
        try:
            self._hidden.replace(self.path)
        except OSError as error:
            raise self._given_up(file, error) from None
        self._hidden = None

    def sync(self) -> None:
        """Wait until the disk has all that the operating system has. Any thread may call it, also during
        writes."""
        with self._syncing:
            if self._file is None or not self._unsynced:
                return
            self._unsynced = False
            try:
                os.fsync(self._file.fileno())
            except OSError as error:
                self._refused = error  # the next append gives the file up

    def finish(self) -> None:
        """Close the file after the disk has everything."""
        self.sync()
        if self._refused is not None and self._file is not None:
            raise self._given_up(self._file, self._refused) from None
        self.close()

    def close(self) -> None:
        with self._syncing:
            file, self._file = self._file, None
            if file is not None:
                file.close()
        if self._hidden is not None:
            self._hidden.unlink(missing_ok=True)
            self._hidden = None

    def _open(self) -> RawFile:
        if self._file is None:
            raise self.failure or PicktreeError(f"{self.path}: the log is closed")
        return self._file

    def _given_up(self, file: RawFile, error: OSError) -> PicktreeError:
        """Put the old ending back, so that the file opens with its former content, and close it."""
        why = error.strerror or str(error)
        if self._hidden is None:
            self.failure = PicktreeError(
                f"{self.path}: the log cannot be written any further: {why}; it keeps what it held until "
                f"then; {_ADVICE}"
            )
        else:
            self.failure = _unwritable(self.path, error)
        try:
            _write(file, self._ending, self.end)
            file.truncate(self.end + len(self._ending))
        except OSError:
            pass  # the reader recovers the file from its chunks
        self.close()
        return self.failure


def _unwritable(path: Path, error: OSError) -> PicktreeError:
    return PicktreeError(f"{path}: the log cannot be written: {error.strerror or error}; {_ADVICE}")


def _write(file: RawFile, data: bytes, offset: int) -> None:
    file.seek(offset)
    view = memoryview(data)
    while view:
        written = file.write(view)
        if not written:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        view = view[written:]
