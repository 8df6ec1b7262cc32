"""Reading the evidence of a failure, which a plug-in's node may have written as it likes."""

from __future__ import annotations

from typing import cast

from .explanation import FailureStory


def number(failure: FailureStory, name: str) -> float | None:
    value = failure.evidence.get(name)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def word(failure: FailureStory, name: str) -> str:
    value = failure.evidence.get(name)
    return value if isinstance(value, str) else ""


def numbers(failure: FailureStory, name: str) -> tuple[float, ...]:
    return tuple(float(v) for v in _items(failure, name) if isinstance(v, int | float))


def words(failure: FailureStory, name: str) -> tuple[str, ...]:
    return tuple(v for v in _items(failure, name) if isinstance(v, str))


def _items(failure: FailureStory, name: str) -> list[object]:
    value = failure.evidence.get(name)
    return cast("list[object]", value) if isinstance(value, list) else []
