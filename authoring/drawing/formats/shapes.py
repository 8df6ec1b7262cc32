"""Cards, pills, edges and frames as SVG. What a viewer shows and what is written to a file is drawn here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from ..chart import ChartNode, Symbol
from ..layout.cards import (
    HEAD_LINE,
    ICON_ROOM,
    LEAST,
    LINE,
    PADDING,
    PILL_LINE,
    SIDE,
    Card,
    Header,
    Line,
    Pill,
)
from ..layout.frames import Edge
from ..symbols import MEANINGS
from .icons import use
from .markup import escape

_ROUND: Final = {"condition": 13, "subtree": 3, "control": 3, "decorator": 8, "action": 5}


def classes(node: ChartNode) -> str:
    """Kind of the node, and whether it is there to recover from failures."""
    return f"{node.kind} recovers" if node.symbol == "recover" else node.kind


def card_svg(card: Card) -> str:
    """The card's box and texts, with its upper left corner at 0, 0."""
    node = card.node
    radius = LEAST // 2 if node.written_as_list else _ROUND[node.kind]
    box = f'<rect class="box" width="{card.width}" height="{card.height}" rx="{radius}"/>'
    if node.written_as_list:
        return box + use(node.symbol, (LEAST - 14) / 2, (LEAST - 14) / 2)
    return box + _texts(node.symbol, card.head, card.lines) + _flag(node, card.width)


def header_svg(header: Header, call: ChartNode | None, width: int) -> str:
    """The bar on top of a frame of that width, and its texts."""
    bar = f'<path class="bar" d="M1 {header.height}V8a7 7 0 0 1 7-7H{width - 8}'
    bar += f'a7 7 0 0 1 7 7V{header.height}z"/>'
    return bar + header_texts(header, call)


def header_texts(header: Header, call: ChartNode | None = None) -> str:
    """What stands in the bar of a frame."""
    flag = _flag(call, header.width) if call is not None else ""
    return _texts("subtree", header.head, header.lines) + flag


def pill_svg(pill: Pill) -> str:
    """The label of a branch, with its upper left corner at 0, 0."""
    radius = min(pill.height / 2, 9)
    rows = "".join(
        f'<text x="{pill.width / 2:g}" y="{PILL_LINE * index + 13}">{escape(line)}</text>'
        for index, line in enumerate(pill.lines)
    )
    box = f'<rect width="{pill.width}" height="{pill.height}" rx="{radius:g}"/>'
    return f'<g class="pill {pill.role}">{box}{rows}</g>'


def edge_svg(edge: Edge) -> str:
    """Level to the end of the column, over to the child's height, and on through its label."""
    bend = (edge.to_x - edge.turn) / 2
    over = f"C{edge.turn + bend:g} {edge.y} {edge.turn + bend:g} {edge.to_y} {edge.to_x} {edge.to_y}"
    if edge.y == edge.to_y:
        over = f"H{edge.to_x}"
    return f'<path class="edge {edge.role}" d="M{edge.x} {edge.y}H{edge.turn}{over}H{edge.body_x}"/>'


def tooltip(node: ChartNode) -> str:
    """What a viewer shows while the pointer rests on a node."""
    title = f"{node.id} {node.given_name}".strip() if not node.given_name.startswith("#") else node.name
    rows = [f"{title} ({MEANINGS[node.symbol]})"]
    rows += [node.doc.partition("\n\n")[0].replace("\n", " ")] if node.doc else []
    rows += [f"{rule.key}: {rule.text}" for rule in node.before]
    rows += [f"{port.key}: {port.value} – {port.doc}" for port in node.ports]
    rows += [f"{port.key}: {port.value} by default – {port.doc}" for port in node.defaults]
    rows += [f"{rule.key}: {rule.text}" for rule in node.after]
    rows += [f"may fail with {', '.join(node.causes)}"] if node.causes else []
    rows += [f"breakpoint: {node.breakpoint}"] if node.breakpoint else []
    rows += [node.place] if node.place else []
    return "\n".join(rows)


def _texts(symbol: Symbol, head: Sequence[Line], lines: Sequence[Line]) -> str:
    top = (LEAST - 14) / 2
    found = [use(symbol, SIDE - 1, top)]
    for index, line in enumerate(head):
        found.append(_text(line, SIDE + ICON_ROOM, HEAD_LINE * index + 17))
    below = max(HEAD_LINE * len(head) + 2 * PADDING, LEAST)
    for index, line in enumerate(lines):
        found.append(_text(line, SIDE, below + LINE * index + 8))
    return "".join(found)


def _text(line: Line, x: float, y: int) -> str:
    spans = "".join(
        f'<tspan class="{span.look}" x="{x + span.x:g}">{escape(span.text)}{_gap(line, index)}</tspan>'
        for index, span in enumerate(line.spans)
    )
    arrow = "" if line.arrow is None else use("out", x + line.arrow, y - 11).replace("icon", "icon arrow", 1)
    return f'{arrow}<text y="{y}">{spans}</text>'


def _gap(line: Line, index: int) -> str:
    """A space between what is beside one another, for whoever copies the text."""
    return " " if index + 1 < len(line.spans) else ""


def _flag(node: ChartNode, width: int) -> str:
    if node.breakpoint is None:
        return ""
    x = width - 11
    return (
        f'<circle class="flag" cx="{x}" cy="13" r="5.5"><title>breakpoint: {node.breakpoint}</title></circle>'
    )
