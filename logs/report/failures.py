"""What the list of failures shows: the explanation of the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass

from ..run import Run
from .packing import Packable, Section


def pack_failures(run: Run) -> Section:
    """All of `run.explanation`, field by field."""
    return Section("failures", plain(run.explanation))


def plain(value: object) -> Packable:
    """A dataclass and what it holds as JSON: fields by name."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(below) for key, below in value.items()}  # pyright: ignore
    if isinstance(value, Sequence):
        return [plain(below) for below in value]  # pyright: ignore
    return str(value)
