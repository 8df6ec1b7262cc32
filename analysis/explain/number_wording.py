"""Numbers and places as sentences say them."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence

from ...files.value_wording import listed

WIDTH = 96
"""Columns of the text."""


def distance(metres: float) -> str:
    """`1.2 m`, `12 cm`, `8 mm`."""
    if metres >= 0.995:
        return f"{metres:.1f} m"
    return f"{metres * 100:.0f} cm" if metres >= 0.0195 else f"{metres * 1000:.0f} mm"


def seconds(time: float) -> str:
    return f"{time:.2f} s"


def listed_times(found: Sequence[float]) -> str:
    """`2.00 s, 4.50 s and 1 more`"""
    return listed([seconds(time) for time in found], 3)


def between(start: float, end: float) -> str:
    """`between 14.0 and 15.0 s`: the truth is in the log now and then."""
    return f"between {start:.1f} and {end:.1f} s"


def listed_spans(spans: Iterable[tuple[float, float]]) -> str:
    """`between 2.0 and 3.5 s and at 7.10 s`"""
    return listed(
        [between(*span) if span[1] - span[0] > 0.1 else f"at {seconds(span[0])}" for span in spans], 3
    )


def force(newtons: float) -> str:
    return f"{newtons:.1f} N" if newtons < 9.95 else f"{newtons:.0f} N"


def place(position: Sequence[float]) -> str:
    """`x 0.47, y 0.15 m`"""
    x, y = (round(c, 2) + 0.0 for c in position[:2])  # no minus before a zero
    return f"x {x:.2f}, y {y:.2f} m"


def times(number: int) -> str:
    return {1: "once", 2: "twice"}.get(number, f"{number} times")


def counted(number: int, one: str, many: str = "") -> str:
    """`1 item`, `3 items`."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def wrapped(text: str, first: str, rest: str | None = None) -> list[str]:
    """Lines of at most `WIDTH` columns that begin with `first`, all but the first of them with `rest`."""
    lines = textwrap.wrap(
        _TOGETHER.sub("\N{NO-BREAK SPACE}", text),
        WIDTH,
        initial_indent=first,
        subsequent_indent=first if rest is None else rest,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines]


_TOGETHER = re.compile(r"(?<=\b[xy]) (?=-?\d)|(?<=\d) (?=(?:s|m|cm|mm|N)\b)")
"""Spaces at which no line ends: between a number and its unit."""
