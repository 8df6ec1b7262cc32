"""Files that are written whole or not at all."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..errors import PicktreeError


@contextmanager
def whole(paths: Sequence[Path], output: Path) -> Generator[list[Path]]:
    """Names beside the files to write to; the files take their own names together when all are whole.

    Where a name is that of a device or a pipe, it is written to itself. Raises PicktreeError, of `output`,
    when the disk refuses, and nothing of what was begun remains.
    """
    beside = [path if _is_special(path) else path.with_name(f".unfinished-{path.name}") for path in paths]
    try:
        yield beside
        for path, written in zip(paths, beside, strict=True):
            if written != path:
                written.replace(path)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise PicktreeError(f"{output} cannot be written: {reason}") from None
    finally:
        for path, written in zip(paths, beside, strict=True):
            if written != path and written.is_file():
                written.unlink()


def _is_special(path: Path) -> bool:
    return path.exists() and not path.is_file() and not path.is_dir()
