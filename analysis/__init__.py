"""Answers from a log: explanations, comparisons, re-simulation, reports, pictures, exports."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .run import Run

__all__ = ["Run"]


def __getattr__(name: str) -> object:
    """Import `Run` on request: most of this room is needed by few commands."""
    if name == "Run":
        from .run import Run

        return Run
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
