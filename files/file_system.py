"""File system: names that it permits, files written whole or not at all, and files found by a shipped
name or beside another file.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Final

from .errors import PicktreeError
from .value_wording import MAX_NEAR_NAMES, suggest_name

MAX_NAME_BYTES: Final = 255
"""Maximum length of a name on the file systems of Linux, macOS and Windows, bytes."""
_MAX_SUFFIX_BYTES: Final = 12
_DIGEST_LENGTH: Final = 16


def fitted(name: str, limit: int = MAX_NAME_BYTES) -> str:
    """Return the name, cut to `limit` bytes. A hash of it and its suffix end a name that was cut.

    >>> fitted("log.mcap.part")
    'log.mcap.part'
    >>> fitted("n" * 300 + ".html", 40)
    'nnnnnnnnnnnnnnnnnn-8c155a0a630fc43e.html'
    """
    data = os.fsencode(name)
    if len(data) <= limit:
        return name
    suffix = os.fsencode(Path(name).suffix)
    suffix = suffix if len(suffix) <= _MAX_SUFFIX_BYTES else b""
    digest = hashlib.sha256(data).hexdigest()[:_DIGEST_LENGTH].encode()
    kept = data[: limit - len(suffix) - len(digest) - 1].decode(errors="ignore").encode()
    return os.fsdecode(kept + b"-" + digest + suffix)


def is_utf8(name: str | Path) -> bool:
    return shown(name) == str(name)


def shown(name: str | Path) -> str:
    r"""Return a name for people: bytes that are not UTF-8 as `\xe9`."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


def require_utf8(name: str | Path) -> None:
    """Raise PicktreeError for a name that is not UTF-8: reports, tables and JSON could not name it."""
    if not is_utf8(name):
        raise PicktreeError(f"{shown(name)}: the name is not UTF-8; rename it")


@contextmanager
def whole(paths: Sequence[Path], output: Path) -> Generator[list[Path]]:
    """Yield temporary names to write to; at the end all files take their own names together.

    A device or a pipe is written directly. Raises PicktreeError for `output` when the disk refuses; partial
    files and new folders are then removed.
    """
    beside: list[Path] = []
    made: list[Path] = []
    complete = False
    try:
        made += [folder for folder in (output, *output.parents) if not folder.exists()]
        for path in paths:
            hidden = path.with_name(fitted(f".unfinished-{path.name}"))
            special = path.exists() and not path.is_file() and not path.is_dir()
            beside.append(path if special else hidden)
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


ROOT: Final = Path(__file__).resolve().parent.parent
"""Folder of the package `picktree`. In a checkout it contains tests, examples and documents, too."""
OTHER_PACKAGE: Final = "picktree_cell"
"""Package in the checkout that is installed beside picktree."""
EXAMPLES: Final = ROOT / "examples"
"""Shipped missions, with cases and faults in folders below."""


@cache
def rooms() -> tuple[str, ...]:
    """Return the names of the top-level packages, sorted. Only they have an `__init__.py`: tests and examples
    have none. The package `picktree_cell` beside them is no part of picktree."""
    found = (file.parent.name for file in ROOT.glob("*/__init__.py"))
    return tuple(sorted(name for name in found if name != OTHER_PACKAGE))


def find_file(name_or_path: str, folder: Path, beside: Path | None, what: str) -> Path:
    """`three_bins` is a shipped file of `folder`; anything with a suffix or a slash is a path.

    A path counts from `beside` (a file or its folder), else from the working directory. Raises PicktreeError.
    """
    at = beside.parent if beside is not None and not is_folder(beside) else beside
    if "\x00" in name_or_path or not name_or_path:
        raise PicktreeError(f"{name_or_path!r} is not the name of a {what}")
    if "/" in name_or_path or name_or_path.endswith((".yaml", ".yml")):
        path = at / name_or_path if at is not None else Path(name_or_path)
        if not is_file(path):
            raise PicktreeError(f"there is no {what} file {path}")
        return path
    shipped = folder / f"{name_or_path}.yaml"
    if is_file(shipped):
        return shipped
    own = at / f"{name_or_path}.yaml" if at is not None else Path(f"{name_or_path}.yaml")
    if is_file(own):
        return own
    hint = suggest_name(name_or_path, shipped_names(folder))
    raise PicktreeError(f"unknown {what} {name_or_path!r}" + (f" ({hint})" if hint else ""))


def example_file(name_or_path: str | PathLike[str], folder: str = "", what: str = "mission") -> Path:
    """Return the file of a name or path that a person gave: `sort_by_colour` is a shipped example.

    `folder`: its folder below `EXAMPLES`. A file of that name in the working directory comes first. A text
    with a slash or a suffix is a path, which need not exist. Raises PicktreeError, with near names, for a
    name that is neither, also for one with the suffix .yaml.
    """
    found = known_file(name_or_path, folder)
    path = Path(name_or_path)
    if found is not None or path.suffix not in ("", ".yaml") or path.name != str(name_or_path):
        return found or path
    known = dict.fromkeys((*shipped_names(Path()), *shipped_names(EXAMPLES / folder)))
    hint = suggest_name(path.name.removesuffix(".yaml"), known, most=MAX_NEAR_NAMES)
    if path.suffix and not hint.startswith("did"):
        return path
    raise PicktreeError(f"there is no {what} {str(path)!r}, neither a file here nor an example ({hint})")


def known_file(name_or_path: str | PathLike[str], folder: str = "") -> Path | None:
    """Return the file, folder or shipped example of a name or path; None when it is missing."""
    path, file = Path(name_or_path), f"{name_or_path}.yaml"
    if is_file(path) or is_folder(path):
        return path
    own, example = Path(file), EXAMPLES / folder / file
    if path.suffix or path.name != str(name_or_path):
        return None
    return own if is_file(own) else example if is_file(example) else None


def is_file(path: Path) -> bool:
    """Whether this is a file; False also for an impossible path (too long, with a null byte)."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Whether this is a folder; False also for an impossible path."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def shipped_names(folder: Path) -> tuple[str, ...]:
    """Return the names of the shipped files of a folder, sorted."""
    return tuple(sorted(path.stem for path in folder.glob("*.yaml")))
