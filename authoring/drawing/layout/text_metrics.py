"""How wide a text is, without asking for fonts: they differ between machines, and a server has none.

The widths are those of DejaVu Sans, which is among the widest fonts that browsers fall back to: in other
fonts a text takes less room than it was given.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping
from typing import Final, Literal, TypeAlias

Face: TypeAlias = Literal["regular", "bold", "mono"]

_REGULAR = (
    318, 401, 460, 838, 636, 950, 780, 275, 390, 390, 500, 838, 318, 361, 318, 337, 636, 636, 636, 636, 636,
    636, 636, 636, 636, 636, 337, 337, 838, 838, 838, 531, 1000, 684, 686, 698, 770, 632, 575, 775, 752,
    295, 295, 656, 557, 863, 748, 787, 603, 787, 695, 635, 611, 732, 684, 989, 685, 611, 685, 390, 337, 390,
    838, 500, 500, 613, 635, 550, 635, 615, 352, 635, 634, 278, 278, 579, 278, 974, 634, 612, 635, 635, 411,
    521, 392, 634, 592, 818, 592, 592, 525, 636, 337, 636, 838,
)  # fmt: skip
_BOLD = (
    348, 456, 521, 838, 696, 1002, 872, 306, 457, 457, 523, 838, 380, 415, 380, 365, 696, 696, 696, 696,
    696, 696, 696, 696, 696, 696, 400, 400, 838, 838, 838, 580, 1000, 774, 762, 734, 830, 683, 683, 821,
    837, 372, 372, 775, 637, 995, 837, 850, 733, 850, 770, 720, 682, 812, 774, 1103, 771, 724, 725, 457,
    365, 457, 838, 500, 500, 675, 716, 593, 716, 678, 435, 716, 712, 343, 343, 665, 343, 1042, 712, 687,
    716, 716, 493, 595, 478, 712, 652, 924, 645, 652, 582, 712, 365, 712, 838,
)  # fmt: skip
_FIRST = 32
"""The code of the first character of the tables, which hold thousandths of the font's size."""
_TABLES: Final[Mapping[Face, tuple[int, ...]]] = {"regular": _REGULAR, "bold": _BOLD, "mono": (602,) * 95}


def width(text: str, size: float, face: Face = "regular") -> float:
    """Pixels that the text takes on one line at most, for a font of that size.

    >>> round(width("Grasp", 10.0, "mono"), 2)
    30.1
    """
    table = _TABLES[face]
    return sum(_em(character, table) for character in text) * size / 1000


def wrapped(text: str, most: float, size: float, face: Face = "regular", lines: int = 3) -> tuple[str, ...]:
    """The text in lines no wider than `most`, broken at spaces where it can be; the rest becomes an ellipsis.

    >>> wrapped("battery < 20 and charger", 80, 10, "mono", lines=2)
    ('battery < 20', 'and charger')
    """
    found: list[str] = []
    rest = text
    while rest:
        count = _fitting(rest, most, size, face)
        if count >= len(rest):
            return (*found, rest)
        if len(found) == lines - 1:
            return (*found, rest[: max(count - 1, 1)].rstrip() + "…")
        space = rest.rfind(" ", 0, count + 1)
        cut = space if space > count // 2 else count
        found.append(rest[:cut].rstrip())
        rest = rest[cut:].lstrip()
    return tuple(found) or ("",)


def _fitting(text: str, most: float, size: float, face: Face) -> int:
    """How many characters fit, one at least."""
    table, room = _TABLES[face], most * 1000 / size
    for index, character in enumerate(text):
        room -= _em(character, table)
        if room < 0:
            return max(index, 1)
    return len(text)


def _em(character: str, table: tuple[int, ...]) -> int:
    index = ord(character) - _FIRST
    if 0 <= index < len(table):
        return table[index]
    if unicodedata.combining(character):
        return 0
    return 1000 if unicodedata.east_asian_width(character) in "WFA" else 850
