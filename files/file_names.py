"""Names of files: as long as file systems permit, and in UTF-8."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Final

from .errors import PicktreeError

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
