"""Libraries that only some installations have."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager

from ..world.errors import PicktreeError


@contextmanager
def extra(name: str, library: str, what: str) -> Generator[None]:
    """Around the import of what needs `library`: without it, a PicktreeError that says how to get it.

    >>> with extra("video", "av", "A video"):
    ...     raise ModuleNotFoundError("No module named 'av'", name="av")
    Traceback (most recent call last):
        ...
    picktree.world.errors.PicktreeError: A video needs the extra 'video': pip install 'picktree[video]'
    """
    try:
        yield
    except ImportError as error:
        if error.name is None or error.name.split(".")[0] != library:
            raise
        raise PicktreeError(f"{what} needs the extra '{name}': pip install 'picktree[{name}]'") from None
