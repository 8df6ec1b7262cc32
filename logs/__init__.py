"""The record of a run: what it holds, how it is written, and how it is read."""

from __future__ import annotations


def __getattr__(name: str) -> object:
    """Return the analyst's `Run` under its old name."""
    from ..moved import ALIASES

    return ALIASES.find(__name__, name)
