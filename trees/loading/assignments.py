"""Assignments of postconditions: `key := expression` or `key = expression`, several with `;`.

`:=` writes the key whether it was there or not; `=` only changes one that is there, as in BehaviorTree.CPP.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from ...files.expressions.expression import Expression, ExpressionError
from ..mission import Assignment

MAX_ASSIGNMENTS: Final = 20
MAX_LENGTH: Final = 4000
_PIECE = re.compile(r"""'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*"|;|[^;'"]+|['"]""", re.DOTALL)
_ASSIGNMENT = re.compile(r"\s*([A-Za-z_]\w{0,59})\s*(:?=)(?!=)", re.ASCII)
_CHANGE = re.compile(r"\s*([A-Za-z_]\w{0,59})\s*([-+*/])=", re.ASCII)


def parse_assignments(text: str) -> tuple[Assignment, ...]:
    """Raises ExpressionError with the character at which it goes wrong."""
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the assignments are longer than {MAX_LENGTH} characters")
    found: list[Assignment] = []
    for at, part in _parts(text):
        if not part.strip():
            continue
        if len(found) == MAX_ASSIGNMENTS:
            raise ExpressionError(f"more than {MAX_ASSIGNMENTS} assignments", at)
        found.append(_assignment(part, at))
    if not found:
        raise ExpressionError("there is no assignment; as 'key := expression'")
    return tuple(found)


def _parts(text: str) -> Iterator[tuple[int, str]]:
    """What stands between the `;`, each with its first character's place; a quoted `;` divides nothing."""
    start = 0
    for piece in _PIECE.finditer(text):
        if piece[0] == ";":
            yield start, text[start : piece.start()]
            start = piece.end()
    yield start, text[start:]


def _assignment(part: str, at: int) -> Assignment:
    first = at + len(part) - len(part.lstrip())
    match = _ASSIGNMENT.match(part)
    if match is None:
        change = _CHANGE.match(part)
        if change is not None:
            key, symbol = change[1], change[2]
            raise ExpressionError(f"write '{key} = {key} {symbol} …'", at + change.start(2))
        raise ExpressionError("an assignment is 'key := expression'", first)
    text = part[match.end() :]
    if not text.strip():
        raise ExpressionError(f"a value is missing after {match[2]!r}", at + match.start(2))
    begins = at + len(part) - len(text.lstrip())
    try:
        value = Expression.parse(text.strip())
    except ExpressionError as error:
        raise ExpressionError(str(error), begins + error.offset) from None
    return Assignment(match[1], value, match[2] == ":=", begins)
