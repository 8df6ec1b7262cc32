"""Files that are written whole or not at all."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import PicktreeError
from .file_names import fitted


@contextmanager
def whole(paths: Sequence[Path], output: Path) -> Generator[list[Path]]:
    """Names beside the files to write to; the files take their own names together when all are whole.

    Where a name is that of a device or a pipe, it is written to itself. Raises PicktreeError, of `output`,
    when the disk refuses; nothing of what was begun remains, nor folders that were made for it.
    """
    beside: list[Path] = []
    made: list[Path] = []
    complete = False
    try:
        made += [folder for folder in (output, *output.parents) if not folder.exists()]
        for path in paths:
            hidden = path.with_name(fitted(f".unfinished-{path.name}"))
            beside.append(path if _is_special(path) else hidden)
        yield beside
        for path, written in zip(paths, beside, strict=True):
            if written != path:
                written.replace(path)
        complete = True
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise PicktreeError(f"{output} cannot be written: {reason}") from None
    finally:
        for path, written in zip(paths, beside, strict=False):
            if written != path and written.is_file():
                written.unlink()
        for folder in () if complete else made:
            with suppress(OSError):
                folder.rmdir()


def _is_special(path: Path) -> bool:
    return path.exists() and not path.is_file() and not path.is_dir()
