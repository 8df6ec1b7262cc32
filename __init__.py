"""picktree: declarative behaviour-tree skills for robot arms that sort many items for hours."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .arithmetic import pin
from .moved import install

pin()  # before any library that computes is loaded
install()

if TYPE_CHECKING:
    from .session.session import run

    __version__: str

__all__ = ["__version__", "run"]


def __getattr__(name: str) -> object:
    """Import what is asked for only then: the command line must answer at once."""
    if name == "run":
        from .session.session import run

        return run
    if name == "__version__":
        from importlib.metadata import version

        return version("picktree")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
