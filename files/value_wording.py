"""Values in the words of a fault, and suggestions for values that do not fit."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from itertools import islice

_CURLY = "“”„‟‘’‚‛«»"
_MAX_COMPARED_NAMES = 1000
"""Names that are looked at; each costs some microseconds."""
_MIN_LIST_SIMILARITY = 0.75
"""Similarity from which a hint may have several names, 0 … 1."""
MAX_NEAR_NAMES = 3
"""Number of near names in a hint about a missing file."""


def suggest_name(name: str, known: Iterable[str], *, most: int = 1) -> str:
    """Return a hint: "did you mean 'Grasp'?", "known: a, b, c", or "" without known names.

    `most`: number of near names that the hint may have, as "did you mean 'a', 'b' or 'c'?".
    """
    names = list(dict.fromkeys(islice(known, _MAX_COMPARED_NAMES)))
    if len(name) > 2 and name[0] in _CURLY and name[-1] in _CURLY and name[1:-1] in names:
        return f"these quotes are part of the text: write {name[1:-1]}"
    lowered = {n.lower(): n for n in reversed(names)}
    # difflib is quadratic in the length: a name of 10,000 letters is no typo.
    short = name[:60].lower()
    close = difflib.get_close_matches(short, lowered, n=most, cutoff=_MIN_LIST_SIMILARITY) if most > 1 else []
    close = close or difflib.get_close_matches(short, lowered, n=1, cutoff=0.6)
    if close:
        *others, last = (repr(lowered[each]) for each in close)
        return f"did you mean {', '.join(others)} or {last}?" if others else f"did you mean {last}?"
    if not names:
        return ""
    shown = names if len(names) <= 25 else [*names[:25], "…"]
    return f"known: {', '.join(shown)}"


def describe(value: object) -> str:
    """Return a value in the words of a fault: `'yes'`, `3`, `a list`, `nothing`."""
    match value:
        case None:
            return "nothing"
        case bool():
            return str(value).lower()
        case int():
            return f"{value}" if abs(value) < 10**20 else "a number of many digits"
        case float():
            return f"{value}"
        case str():
            return repr(value if len(value) <= 40 else value[:37] + "...")
        case list() | tuple():
            return "a list"
        case _:
            return "a mapping"


def listed(words: Iterable[str], most: int | None = None, last: str = "and") -> str:
    """Return the words as one list; words beyond `most` are counted.

    >>> listed(["at", "node", "time"], last="or")
    'at, node or time'
    >>> listed(["a", "b", "c", "d"], 3)
    'a, b and 2 more'
    """
    shown = list(words)
    if most is not None and len(shown) > most:
        shown = [*shown[: most - 1], f"{len(shown) - most + 1} more"]
    return f" {last} ".join(filter(None, (", ".join(shown[:-1]), *shown[-1:])))


_TRUE, _FALSE = ("yes", "y", "on"), ("no", "n", "off")
_GROUPED = re.compile(r"[-+]?[0-9][0-9_]*(?:\.[0-9_]*)?")
_PLAIN = re.compile(r"[-+]?[0-9]+(?:\.[0-9]+)?")
_BINARY = re.compile(r"[-+]?0b[01_]+")
_COMMA = re.compile(r"[-+]?[0-9]+,[0-9]+")


def suggest_boolean(value: object) -> str:
    """Return a hint for a text that YAML 1.1, or another language, reads as true or false.

    >>> suggest_boolean("Yes"), suggest_boolean("maybe")
    ('write true', '')
    """
    word = value.lower() if isinstance(value, str) else ""
    if word in (*_TRUE, "true"):
        return "write true"
    return "write false" if word in (*_FALSE, "false") else ""


def suggest_number(value: object) -> str:
    """Return a hint for a text that YAML 1.1, or another language, reads as a number.

    >>> suggest_number("1_000"), suggest_number("0b101"), suggest_number("0,5"), suggest_number("ten")
    ('write 1000', 'write 5', 'write 0.5', '')
    >>> suggest_number("3")
    'without quotes: 3'
    """
    if not isinstance(value, str) or len(value) > 40:
        return ""
    text = value.strip().strip(_CURLY)
    if _PLAIN.fullmatch(text):
        return f"without quotes: {text}"
    if _BINARY.fullmatch(text) and text[-1] != "_":
        return f"write {int(text.replace('_', ''), 2)}"
    if "_" in text and _GROUPED.fullmatch(text):
        return f"write {text.replace('_', '')}"
    return f"write {text.replace(',', '.')}" if _COMMA.fullmatch(text) else ""
