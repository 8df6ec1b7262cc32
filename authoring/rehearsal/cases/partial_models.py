"""What the readers of a cases file share: parts of models that may be unreadable."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from typing import TypeVar

from ....files.models.validation import Unread

T = TypeVar("T")


def or_else(read: Callable[[], T], default: T) -> T:
    """A part of a model, or the default where it could not be read; the fault is reported already."""
    try:
        return read()
    except Unread:
        return default


def entries(mapping: Mapping[str, T]) -> dict[str, T]:
    """The entries of a mapping that could be read."""
    found: dict[str, T] = {}
    for key in mapping:
        with suppress(Unread):
            found[key] = mapping[key]
    return found


def those_read(found: Iterable[T | None]) -> Iterator[T]:
    return (one for one in found if one is not None)
