"""Assignments of postconditions: `key = expression` or `key := expression`, several with `;`."""

from __future__ import annotations

import re

from ..world.files.expressions import Expression, ExpressionError
from .mission import Assignment

_PARTS = re.compile(r"""(?:'[^']*'|"[^"]*"|[^;'"])+|['"]""")
_ASSIGNMENT = re.compile(r"\s*([A-Za-z_]\w*)\s*:?=(?!=)", re.ASCII)
MAX_ASSIGNMENTS = 20


def parse_assignments(text: str) -> tuple[Assignment, ...]:
    """Raises ExpressionError with the character at which it goes wrong."""
    found: list[Assignment] = []
    for part in _PARTS.finditer(text):
        if not part[0].strip():
            continue
        match = _ASSIGNMENT.match(part[0])
        if match is None:
            raise ExpressionError("an assignment is 'key = expression' or 'key := expression'", part.start())
        if len(found) == MAX_ASSIGNMENTS:
            raise ExpressionError(f"more than {MAX_ASSIGNMENTS} assignments", part.start())
        try:
            found.append(Assignment(match[1], Expression.parse(part[0][match.end() :])))
        except ExpressionError as error:
            raise ExpressionError(str(error), part.start() + match.end() + error.offset) from None
    if not found:
        raise ExpressionError("there is no assignment")
    return tuple(found)
