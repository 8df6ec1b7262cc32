"""What the list of failures shows: the explanation of the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass

from ....logs.episodes.episode_counts import CauseCount
from ...run import Run
from ..page_data.packing import Packable, Section


def pack_failures(run: Run) -> Section:
    """All of `run.explanation`, field by field, with the causes of its episodes in `causes`."""
    explanation = run.explanation
    named = {field.name: plain(getattr(explanation, field.name)) for field in fields(explanation)}
    causes = explanation.recovery.causes
    return Section("failures", {**named, "causes": [_counted(each) for each in causes]})


def _counted(found: CauseCount) -> dict[str, Packable]:
    """How often a cause was seen and cured, what that cost, and in words by what."""
    total = found.total
    return {
        "cause": found.cause,
        "seen": total.seen,
        "cured": total.cured,
        "seconds": total.seconds,
        "told": found.to_text(),
    }


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
