"""Which child of an element stands in which slot of its node, as a text: `grasp.*=1; control.timeout=2`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

_ENTRY = re.compile(r"\s*((?:[^\\;=]|\\.)*?)\s*=\s*(\d{1,6})\s*(?:;|$)")
_SPECIAL = re.compile(r"[\\;=]")


class Row(NamedTuple):
    """A label of a table and the index, from 0, of the child that stands there."""

    label: str
    child: int


def table_text(rows: Iterable[Row]) -> str:
    escaped = ((_SPECIAL.sub(r"\\\g<0>", row.label), row.child) for row in rows)
    return "; ".join(f"{label}={child}" for label, child in escaped)


def read_table(text: str) -> tuple[Row, ...]:
    """Raises ValueError."""
    rows: list[Row] = []
    at = 0
    while at < len(text):
        match = _ENTRY.match(text, at)
        if match is None or not match[1]:
            raise ValueError(f"{text[at : at + 30]!r} is not 'label=child'")
        rows.append(Row(re.sub(r"\\(.)", r"\1", match[1]), int(match[2])))
        at = match.end()
    return tuple(rows)


def indexes_text(indexes: Iterable[int]) -> str:
    return ";".join(map(str, indexes))


def read_indexes(text: str) -> tuple[int, ...]:
    """Raises ValueError."""
    if not re.fullmatch(r"\s*\d{1,6}\s*(;\s*\d{1,6}\s*)*", text, re.ASCII):
        raise ValueError(f"{text[:30]!r} is not a list of indexes, as '1;2'")
    return tuple(int(part) for part in text.split(";"))
