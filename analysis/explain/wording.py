"""Wording of an explanation: times, distances, places and counts as text, and wrapped lines."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence

from picktree.files import listed

WIDTH = 96
"""Width of the text, columns."""


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
    """Return `between 14.0 and 15.0 s`, or `at 14.0 s` for equal times: the log has samples."""
    first, last = f"{start:.1f}", f"{end:.1f}"
    return f"at {start:.2f} s" if first == last else f"between {first} and {last} s"


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
    """Return lines of up to `WIDTH` columns: the first begins with `first`, the others with `rest`."""
    lines = textwrap.wrap(
        _UNIT_SPACE.sub("\N{NO-BREAK SPACE}", text),
        WIDTH,
        initial_indent=first,
        subsequent_indent=first if rest is None else rest,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines]


_UNIT_SPACE = re.compile(r"(?<=\b[xy]) (?=-?\d)|(?<=\d) (?=(?:s|m|cm|mm|N)\b)")
"""Spaces at which no line is broken: between a number and its unit."""
