"""Values of a log as short text."""

from __future__ import annotations

import json
from typing import cast

LONGEST = 90
"""Characters; more are cut."""


def value_text(value: object) -> str:
    """As JSON, cut when it is long; numbers with six digits; nothing for None.

    >>> value_text({"width": 0.0312345678, "held": True})
    '{"width": 0.0312346, "held": true}'
    """
    if value is None:
        return "–"
    if isinstance(value, str):
        return _cut(value)
    return _cut(json.dumps(_rounded(value), ensure_ascii=False, default=str))


def _rounded(value: object) -> object:
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, list):
        return [_rounded(one) for one in cast("list[object]", value)]
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in cast("dict[str, object]", value).items()}
    return value


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"
