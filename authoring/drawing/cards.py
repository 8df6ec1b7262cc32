"""Cards: text lines and size of a node's box, px, and estimated widths of texts.

Widths are computed without fonts, which differ between machines and are missing on servers. They are those of
DejaVu Sans, one of the widest fonts that browsers fall back to; other fonts need less room.
"""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from .chart import Branch, BranchRole, ChartNode, ChartPort, ChartTree, Rule

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
_FIRST_CHARACTER_CODE = 32
"""Code of the first character in the tables, which hold thousandths of the font size."""
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
    """Return the number of characters that fit, at least 1."""
    table, room = _TABLES[face], most * 1000 / size
    for index, character in enumerate(text):
        room -= _em(character, table)
        if room < 0:
            return max(index, 1)
    return len(text)


def _em(character: str, table: tuple[int, ...]) -> int:
    index = ord(character) - _FIRST_CHARACTER_CODE
    if 0 <= index < len(table):
        return table[index]
    if unicodedata.combining(character):
        return 0
    return 1000 if unicodedata.east_asian_width(character) in "WFA" else 850


SpanClass: TypeAlias = Literal["id", "name", "key", "literal", "reference", "output", "rule", "doc", "label"]

TITLE: Final = 12.0
SMALL: Final = 11.0
HEAD_LINE: Final = 16
LINE: Final = 15
PADDING: Final = 5
SIDE: Final = 9
ICON: Final = 14
TITLE_OFFSET: Final = 21
"""Distance from the icon's left edge to the title, px."""
MIN_CARD_HEIGHT: Final = 26
"""Height of a card without lines, px."""
PILL_LINE: Final = 14
PILL_SIDE: Final = 8
PILL_GAP: Final = 12
_MAX_TEXT_WIDTH: Final = 240.0
"""Maximum width of a text before it is broken, px."""
_MOST_LABEL: Final = 190.0
_FLAG_ROOM: Final = 16
_SIZES: Final[dict[SpanClass, tuple[float, Face]]] = {
    "id": (TITLE, "bold"), "name": (TITLE, "regular"), "key": (SMALL, "regular"), "rule": (SMALL, "mono"),
    "literal": (SMALL, "mono"), "reference": (SMALL, "mono"), "output": (SMALL, "mono"),
    "doc": (SMALL, "regular"), "label": (SMALL, "bold"),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class TextSpan:
    """Part of a line; `x` counts from the line's start, px."""

    text: str
    look: SpanClass
    x: float


@dataclass(frozen=True, slots=True)
class TextLine:
    spans: tuple[TextSpan, ...]
    arrow: float | None = None
    """Position of an output's arrow, px; None: no arrow."""

    @property
    def width(self) -> float:
        return max((span.x + _width(span.text, span.look) for span in self.spans), default=0.0)


@dataclass(frozen=True, slots=True)
class BranchLabel:
    """Label of a branch, drawn before the card."""

    lines: tuple[str, ...]
    role: BranchRole
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class NodeCard:
    """Box of a node: head lines next to the icon, then ports, conditions and assignments."""

    node: ChartNode
    head: tuple[TextLine, ...]
    lines: tuple[TextLine, ...]
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Header:
    """Head of a tree's frame: name and ports of the tree, or those of the calling node."""

    name: str
    head: tuple[TextLine, ...]
    lines: tuple[TextLine, ...]
    width: int
    height: int


def card(node: ChartNode) -> NodeCard:
    if node.written_as_list:
        return NodeCard(node, (), (), MIN_CARD_HEIGHT, MIN_CARD_HEIGHT)
    head, lines = _head(node), _lines(node)
    flag = _FLAG_ROOM if node.breakpoint else 0
    return NodeCard(node, head, lines, _across(head, lines, flag), _down(head, lines))


def pill(branch: Branch) -> BranchLabel | None:
    """Return the label of a branch; None for a plain child."""
    if not branch.label:
        return None
    lines = wrapped(branch.label, _MOST_LABEL, SMALL, "bold")
    across = max(_width(line, "label") for line in lines) + 2 * PILL_SIDE
    return BranchLabel(lines, branch.role, math.ceil(across), PILL_LINE * len(lines) + 4)


def header(tree: ChartTree, call: ChartNode | None = None) -> Header:
    """Return the head of a tree's frame: on its own, or in place of `call`."""
    if call is not None:
        head, lines = _head(call), _lines(call)
    else:
        head = (TextLine((TextSpan(tree.name, "id", 0.0),)),)
        about = wrapped(tree.doc, _MAX_TEXT_WIDTH, SMALL, lines=3) if tree.doc else ()
        lines = (
            *(TextLine((TextSpan(part, "doc", 0.0),)) for part in about),
            *(line for port in tree.ports for line in _port(port, doc=port.doc)),
        )
    flag = _FLAG_ROOM if call is not None and call.breakpoint else 0
    return Header(tree.name, head, lines, _across(head, lines, flag), _down(head, lines))


def _head(node: ChartNode) -> tuple[TextLine, ...]:
    title, name = node.id, node.given_name
    if name and _width(f"{title} {name}", "id") <= _MAX_TEXT_WIDTH:
        x = _width(title, "id") + (1.0 if name.startswith("#") else 5.0)
        return (TextLine((TextSpan(title, "id", 0.0), TextSpan(name, "name", x))),)
    broken = [
        TextLine((TextSpan(part, "id", 0.0),)) for part in wrapped(title, _MAX_TEXT_WIDTH, TITLE, "bold")
    ]
    if name:
        broken += [TextLine((TextSpan(part, "name", 0.0),)) for part in wrapped(name, _MAX_TEXT_WIDTH, TITLE)]
    return tuple(broken)


def _lines(node: ChartNode) -> tuple[TextLine, ...]:
    found = [line for rule in node.before for line in _rule(rule)]
    found += [line for port in node.ports for line in _port(port)]
    found += [line for rule in node.after for line in _rule(rule)]
    return tuple(found)


def _rule(rule: Rule) -> list[TextLine]:
    return _entry(TextSpan(rule.key, "key", 0.0), rule.text, "rule", arrow=False)


def _port(port: ChartPort, doc: str = "") -> list[TextLine]:
    output = port.role == "output"
    key = TextSpan(port.key if output else f"{port.key}:", "key", 0.0)
    lines = _entry(key, port.value, port.role, arrow=output)
    if doc:
        lines += [
            TextLine((TextSpan(part, "doc", 12.0),)) for part in wrapped(doc, _MAX_TEXT_WIDTH, SMALL, lines=2)
        ]
    return lines


def _entry(key: TextSpan, text: str, look: SpanClass, *, arrow: bool) -> list[TextLine]:
    """Return the lines of a key with its value next to it."""
    size, face = _SIZES[look]
    at = _width(key.text, key.look) + 5.0
    x = at + (ICON + 2 if arrow else 0)
    first, *more = wrapped(text, max(_MAX_TEXT_WIDTH - x, 110.0), size, face)
    return [
        TextLine((key, TextSpan(first, look, x)), at if arrow else None),
        *(TextLine((TextSpan(part, look, x),)) for part in more),
    ]


def _across(head: tuple[TextLine, ...], lines: tuple[TextLine, ...], flag: int) -> int:
    title = TITLE_OFFSET + max(line.width for line in head) + flag
    return math.ceil(max([title, *(line.width for line in lines)]) + 2 * SIDE)


def _down(head: tuple[TextLine, ...], lines: tuple[TextLine, ...]) -> int:
    """Return the height of a box, px; even, so that level boxes have their middles at the same pixel."""
    below = LINE * len(lines) + PADDING - 2 if lines else 0
    height = max(HEAD_LINE * len(head) + 2 * PADDING, MIN_CARD_HEIGHT) + below
    return height + height % 2


def _width(text: str, look: SpanClass) -> float:
    size, face = _SIZES[look]
    return width(text, size, face)
