"""Plain values: what may stand on the blackboard and in a saved state."""

from __future__ import annotations

import math
from typing import cast

from ...world.journal import Plain

_LARGEST = 2**63 - 1
"""A log holds 64 bits."""


def plain_copy(value: object) -> Plain:
    """A deep copy that shares nothing. Raises TypeError for what is not plain, ValueError for NaN."""
    match value:
        case None | bool():
            return value
        case int():
            if not -_LARGEST <= value <= _LARGEST:
                raise ValueError("the number is too large")
            return int(value)
        case str():
            return str(value)
        case float():
            if not math.isfinite(value):
                raise ValueError(f"{value} is not a finite number")
            return float(value)
        case list() | tuple():
            return [plain_copy(item) for item in cast("list[object]", value)]
        case dict():
            entries = cast("dict[object, object]", value)
            return {str(key): plain_copy(item) for key, item in entries.items()}
        case _:
            raise TypeError(f"a {type(value).__name__} is not a plain value")
