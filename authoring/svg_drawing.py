"""SVG of a chart: its cards, labels, edges and frames as shapes, and a self-contained file for light and
dark screens.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape as _escape
from pathlib import Path
from string import Template
from typing import Final, Literal, TypeAlias

from picktree.trees import NodeStatus

from .mission_chart import MEANINGS, Chart, ChartNode, Symbol
from .tree_layout import (
    HEAD_LINE,
    LINE,
    MIN_CARD_HEIGHT,
    PADDING,
    PILL_LINE,
    SIDE,
    TITLE,
    TITLE_OFFSET,
    BranchLabel,
    Edge,
    Header,
    NodeCard,
    PlacedCard,
    TextLine,
    TreeFrame,
    expanded,
    frame_of,
    page,
    width,
)

_UNFIT = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def escape(text: str) -> str:
    """Escape text for XML elements and attributes; invalid characters become a replacement character.

    >>> escape('a < "b"')
    'a &lt; &quot;b&quot;'
    """
    return _escape(_UNFIT.sub("\ufffd", text))


Icon: TypeAlias = Symbol | Literal["out"]
_RING = "M7 1.8a5.2 5.2 0 1 1 0 10.4a5.2 5.2 0 1 1 0-10.4z"
_STROKES: Final[Mapping[Icon, str]] = {
    "action": "M4 2.8l7 4.2l-7 4.2z",
    "branch": "M1.5 7h3.2l3.6-4h4.2M4.7 7l3.6 4h4.2",
    "clock": f"{_RING}M7 4.2v2.8l2 1.4",
    "condition": f"{_RING}M4.7 7.1l1.6 1.7l3.1-3.6",
    "control": "M3 3h8v8h-8z",
    "decorator": "M7 1.8l5.2 5.2l-5.2 5.2l-5.2-5.2z",
    "fallback": "M4.4 4.9a2.6 2.6 0 1 1 3.9 2.2c-.9.6-1.3 1-1.3 2M7 11.6v.6",
    "force": "M7 2.2v6.4M7 11.2v.6",
    "loop": "M11.8 7a4.8 4.8 0 1 1-1.6-3.6M10.6 1v2.8h-2.8",
    "not": "M2.5 5h9v4.5",
    "out": "M1.5 7h10M8.2 3.8l3.3 3.2l-3.3 3.2",
    "parallel": "M1.5 4.2h9.5M8.8 2l2.4 2.2l-2.4 2.2M1.5 9.8h9.5M8.8 7.6l2.4 2.2l-2.4 2.2",
    "recover": f"{_RING}M7 4.2v5.6M4.2 7h5.6",
    "sequence": "M1.5 7h10.5M8.6 3.6l3.6 3.4l-3.6 3.4",
    "subtree": "M5.2 1.5h3.6v3h-3.6zM1.2 9.5h3.6v3h-3.6zM9.2 9.5h3.6v3h-3.6zM7 4.5v2.4M3 9.5v-2.6h8v2.6",
}


def definitions(icons: Iterable[Icon]) -> str:
    """Return the symbols for `use`, in one order whatever the order of the icons."""
    return "".join(
        f'<symbol id="i-{icon}" viewBox="0 0 14 14"><path d="{_STROKES[icon]}"/></symbol>'
        for icon in sorted(set(icons))
    )


def use(icon: Icon, x: float, y: float) -> str:
    return f'<use href="#i-{icon}" class="icon" x="{x:g}" y="{y:g}" width="14" height="14"/>'


ALL_ICONS: Final[tuple[Icon, ...]] = tuple(_STROKES)
PAGE_FOLDER: Final = Path(__file__).parent / "page"
LIGHT_COLOURS: Final[Mapping[str, str]] = {
    "paper": "#f6f7f9", "sheet": "#ffffff", "bar": "#eef1f5", "rim": "#c5ccd6", "ink": "#1d2433",
    "muted": "#5f6b7c", "edge": "#8f9bad",
    "action": "#ffffff", "action_rim": "#7a8699",
    "condition": "#e7f0fd", "condition_rim": "#5388d6",
    "control": "#e9edf3", "control_rim": "#66748a",
    "decorator": "#f2ecfc", "decorator_rim": "#9474d4",
    "subtree": "#e3f3ea", "subtree_rim": "#3f9467",
    "cure": "#fff0df", "cure_rim": "#d27a1e", "cure_ink": "#8a4a05",
    "choice": "#e7f0fd", "choice_rim": "#5388d6", "choice_ink": "#1f4f94",
    "reference": "#0a5cbf", "output": "#8226b0", "rule": "#8a5a00", "stop": "#d92d20",
    "success": "#12915a", "success_fill": "#d9f4e5", "failure": "#d92d20", "failure_fill": "#fde3e1",
    "running": "#1668e3", "running_fill": "#dbe9ff", "skipped": "#8f9bad", "found": "#ffd54a",
}  # fmt: skip
DARK_COLOURS: Final[Mapping[str, str]] = {
    "paper": "#13161b", "sheet": "#1a1e25", "bar": "#222833", "rim": "#3b4454", "ink": "#e5e9f0",
    "muted": "#9aa6b6", "edge": "#66738a",
    "action": "#20262f", "action_rim": "#78859a",
    "condition": "#1c2a40", "condition_rim": "#5c90dc",
    "control": "#2a313d", "control_rim": "#8592a8",
    "decorator": "#2a2438", "decorator_rim": "#a58ae0",
    "subtree": "#1b3027", "subtree_rim": "#52ab7d",
    "cure": "#3a2a17", "cure_rim": "#e0913e", "cure_ink": "#f5bd80",
    "choice": "#1c2a40", "choice_rim": "#5c90dc", "choice_ink": "#a9c8f5",
    "reference": "#79b4ff", "output": "#d39af5", "rule": "#e3b35a", "stop": "#ff6b5e",
    "success": "#3ecf8e", "success_fill": "#143626", "failure": "#ff6b5e", "failure_fill": "#421d1b",
    "running": "#62a0ff", "running_fill": "#172f55", "skipped": "#66738a", "found": "#b98a00",
}  # fmt: skip


def style(name: Literal["drawing", "page"]) -> str:
    """Return the CSS of the drawing or page, in both themes.

    It has no variables, which not all SVG viewers know.
    """
    template = Template((PAGE_FOLDER / f"{name}.css").read_text(encoding="utf-8"))
    dark = template.substitute(DARK_COLOURS)
    coloured = "\n".join(
        line for line, plain in zip(dark.splitlines(), template.template.splitlines(), strict=True)
        if "$" in plain
    )  # fmt: skip
    return f"{template.substitute(LIGHT_COLOURS)}@media (prefers-color-scheme: dark) {{\n{coloured}\n}}\n"


_CORNER_RADII: Final = {"condition": 13, "subtree": 3, "control": 3, "decorator": 8, "action": 5}


def classes(node: ChartNode) -> str:
    """Return the CSS classes of a node: its kind, and whether it recovers from failures."""
    return f"{node.kind} recovers" if node.symbol == "recover" else node.kind


def card_svg(card: NodeCard) -> str:
    """Return the card's box and texts as SVG, with the upper left corner at (0, 0)."""
    node = card.node
    radius = MIN_CARD_HEIGHT // 2 if node.written_as_list else _CORNER_RADII[node.kind]
    box = f'<rect class="box" width="{card.width}" height="{card.height}" rx="{radius}"/>'
    if node.written_as_list:
        return box + use(node.symbol, (MIN_CARD_HEIGHT - 14) / 2, (MIN_CARD_HEIGHT - 14) / 2)
    return box + _texts(node.symbol, card.head, card.lines) + _flag(node, card.width)


def header_svg(header: Header, call: ChartNode | None, width: int) -> str:
    """Return the bar on top of a frame of that width, with its texts."""
    bar = f'<path class="bar" d="M1 {header.height}V8a7 7 0 0 1 7-7H{width - 8}'
    bar += f'a7 7 0 0 1 7 7V{header.height}z"/>'
    return bar + header_texts(header, call)


def header_texts(header: Header, call: ChartNode | None = None) -> str:
    """Return the texts in the bar of a frame."""
    flag = _flag(call, header.width) if call is not None else ""
    return _texts("subtree", header.head, header.lines) + flag


def pill_svg(pill: BranchLabel) -> str:
    """Return the label of a branch as SVG, with the upper left corner at (0, 0)."""
    radius = min(pill.height / 2, 9)
    rows = "".join(
        f'<text x="{pill.width / 2:g}" y="{PILL_LINE * index + 13}">{escape(line)}</text>'
        for index, line in enumerate(pill.lines)
    )
    box = f'<rect width="{pill.width}" height="{pill.height}" rx="{radius:g}"/>'
    return f'<g class="pill {pill.role}">{box}{rows}</g>'


def edge_svg(edge: Edge) -> str:
    """Return an edge as SVG: level to the column's end, over to the child's height, through its label."""
    bend = (edge.to_x - edge.turn) / 2
    over = f"C{edge.turn + bend:g} {edge.y} {edge.turn + bend:g} {edge.to_y} {edge.to_x} {edge.to_y}"
    if edge.y == edge.to_y:
        over = f"H{edge.to_x}"
    return f'<path class="edge {edge.role}" d="M{edge.x} {edge.y}H{edge.turn}{over}H{edge.body_x}"/>'


def tooltip(node: ChartNode) -> str:
    """Return the text that a viewer shows while the pointer rests on a node."""
    rows = [f"{node.title} ({MEANINGS[node.symbol]})"]
    rows += [node.doc.partition("\n\n")[0].replace("\n", " ")] if node.doc else []
    rows += [f"{rule.key}: {rule.text}" for rule in node.before]
    rows += [f"{port.key}: {port.value} – {port.doc}" for port in node.ports]
    rows += [f"{port.key}: {port.value} by default – {port.doc}" for port in node.defaults]
    rows += [f"{rule.key}: {rule.text}" for rule in node.after]
    rows += [f"may fail with {', '.join(node.causes)}"] if node.causes else []
    rows += [f"breakpoint: {node.breakpoint}"] if node.breakpoint else []
    rows += [node.place] if node.place else []
    return "\n".join(rows)


def _texts(symbol: Symbol, head: Sequence[TextLine], lines: Sequence[TextLine]) -> str:
    top = (MIN_CARD_HEIGHT - 14) / 2
    found = [use(symbol, SIDE - 1, top)]
    for index, line in enumerate(head):
        found.append(_text(line, SIDE + TITLE_OFFSET, HEAD_LINE * index + 17))
    below = max(HEAD_LINE * len(head) + 2 * PADDING, MIN_CARD_HEIGHT)
    for index, line in enumerate(lines):
        found.append(_text(line, SIDE, below + LINE * index + 8))
    return "".join(found)


def _text(line: TextLine, x: float, y: int) -> str:
    spans = "".join(
        f'<tspan class="{span.look}" x="{x + span.x:g}">{escape(span.text)}</tspan>' for span in line.spans
    ).replace("</tspan><tspan", " </tspan><tspan")  # copied text has spaces between its parts
    arrow = "" if line.arrow is None else use("out", x + line.arrow, y - 11).replace("icon", "icon arrow", 1)
    return f'{arrow}<text y="{y}">{spans}</text>'


def _flag(node: ChartNode, width: int) -> str:
    if node.breakpoint is None:
        return ""
    title = f"<title>breakpoint: {node.breakpoint}</title>"
    return f'<circle class="flag" cx="{width - 11}" cy="13" r="5.5">{title}</circle>'


PAGE_MARGIN: Final = 24
_TITLE_HEIGHT: Final = 62
"""Height of the title and the line below it, px."""
_LEGEND_HEIGHT: Final = 26
_LEGEND_GAP: Final = 18.0


def svg(chart: Chart, *, expand: bool = False, statuses: Mapping[str, NodeStatus] | None = None) -> str:
    """Return the drawing. `expand`: each call is expanded at its place, instead of one drawing per tree.

    `statuses`, by the nodes' paths in the running tree, colours an expanded drawing.
    """
    frames = [expanded(chart)] if expand else [frame_of(tree) for tree in chart.trees]
    sheet = page([(frame.width, frame.height) for frame in frames])
    drawn = [
        _Drawing(statuses or {}, links=not expand).frame(
            frame, PAGE_MARGIN + spot.x, _TITLE_HEIGHT + spot.y, frame.tree.name
        )
        for frame, spot in zip(frames, sheet.spots, strict=True)
    ]
    legend = _legend(chart)
    remark = " · ".join(
        filter(
            None, (chart.file, chart.scene and f"scene {chart.scene}", chart.goal and f"goal {chart.goal}")
        )
    )
    heading = round(max(width(chart.title, 20.0, "bold"), width(remark, 11.0)))
    legend_width = round(sum(_entry_width(MEANINGS[symbol]) for symbol in legend))
    across = max(sheet.width, heading, legend_width) + 2 * PAGE_MARGIN
    down = _TITLE_HEIGHT + sheet.height + PAGE_MARGIN + _LEGEND_HEIGHT
    rows = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="drawing" viewBox="0 0 {across} {down}" '
        f'width="{across}" height="{down}">',
        f"<title>{escape(chart.title)}</title>",
        f"<style>\n{style('drawing')}</style>",
        f"<defs>{definitions([*legend, 'out'])}</defs>",
        f'<rect class="ground" width="{across}" height="{down}"/>',
        f'<text class="heading" x="{PAGE_MARGIN}" y="30">{escape(chart.title)}</text>',
        f'<text class="remark" x="{PAGE_MARGIN}" y="48">{escape(remark)}</text>',
        *drawn,
        _legend_svg(legend, down - 18),
        "</svg>\n",
    ]
    return "\n".join(rows)


class _Drawing:
    def __init__(self, statuses: Mapping[str, NodeStatus], *, links: bool) -> None:
        self._statuses = statuses
        self._links = links

    def frame(self, frame: TreeFrame, x: int, y: int, path: str) -> str:
        """Return a frame as SVG. `path`: path of the sub-tree's node in the running tree."""
        called = frame.call is not None
        look = " called" if called else ""
        mark = "" if called else f' id="tree-{frame.tree.name}"'
        title = f"<title>{escape(tooltip(frame.call))}</title>" if frame.call is not None else ""
        rows = [
            f'<g class="frame{look}{self._status(path)}"{mark} transform="translate({x} {y})">',
            f'<rect class="sheet" width="{frame.width}" height="{frame.height}" rx="8"/>',
            f'<g class="subtree">{title}{header_svg(frame.header, frame.call, frame.width)}</g>',
            *(edge_svg(edge) for edge in frame.edges()),
            *(part for tile in frame.tiles for part in self._tile(tile, f"{path}/{tile.path}")),
            "</g>",
        ]
        return "\n".join(rows)

    def _tile(self, tile: PlacedCard, path: str) -> Iterator[str]:
        if tile.pill is not None:
            top = tile.middle - tile.pill.height // 2
            yield f'<g transform="translate({tile.x} {top})">{pill_svg(tile.pill)}</g>'
        if isinstance(tile.body, TreeFrame):
            yield self.frame(tile.body, tile.body_x, tile.body_y, path)
        else:
            yield self._card(tile.body, tile.body_x, tile.body_y, path)

    def _card(self, card: NodeCard, x: int, y: int, path: str) -> str:
        node = card.node
        inner = f"<title>{escape(tooltip(node))}</title>{card_svg(card)}"
        if node.calls and self._links:
            inner = f'<a href="#tree-{node.calls}">{inner}</a>'
        look = f"node {classes(node)}{self._status(path)}"
        return f'<g class="{look}" data-path="{escape(path)}" transform="translate({x} {y})">{inner}</g>'

    def _status(self, path: str) -> str:
        status = self._statuses.get(path)
        return "" if status is None else f" {status.value.lower()}"


def _legend(chart: Chart) -> list[Symbol]:
    """Return the symbols in use, in a fixed order."""
    used = {node.symbol for tree in chart.trees for node in tree.root.iterate()} | {"subtree"}
    return [symbol for symbol in MEANINGS if symbol in used]


def _legend_svg(symbols: list[Symbol], y: int) -> str:
    rows: list[str] = []
    x = float(PAGE_MARGIN)
    for symbol in symbols:
        text = MEANINGS[symbol]
        rows.append(f'{use(symbol, x, y - 11)}<text class="remark" x="{x + 19:g}" y="{y}">{text}</text>')
        x += _entry_width(text)
    return f'<g class="legend">{"".join(rows)}</g>'


def _entry_width(text: str) -> float:
    return round(19 + width(text, TITLE) + _LEGEND_GAP)
