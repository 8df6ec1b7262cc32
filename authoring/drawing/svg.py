"""Chart as a self-contained SVG file for light and dark screens, with selectable text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from ...trees.status import NodeStatus
from .cards import TITLE, NodeCard, width
from .chart import MEANINGS, Chart, Symbol
from .frames import PlacedCard, TreeFrame, expanded, frame_of, page
from .shapes import (
    card_svg,
    classes,
    definitions,
    edge_svg,
    escape,
    header_svg,
    pill_svg,
    style,
    tooltip,
    use,
)

PAGE_MARGIN: Final = 24
_TITLE_HEIGHT: Final = 62
"""Height of the title and the line below it, px."""
_LEGEND_HEIGHT: Final = 26
"""Height of the legend, px."""
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
    across = max(sheet.width, _heading_width(chart), _legend_width(legend)) + 2 * PAGE_MARGIN
    down = _TITLE_HEIGHT + sheet.height + PAGE_MARGIN + _LEGEND_HEIGHT
    rows = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="drawing" viewBox="0 0 {across} {down}" '
        f'width="{across}" height="{down}">',
        f"<title>{escape(chart.title)}</title>",
        f"<style>\n{style()}</style>",
        f"<defs>{definitions([*legend, 'out'])}</defs>",
        f'<rect class="ground" width="{across}" height="{down}"/>',
        f'<text class="heading" x="{PAGE_MARGIN}" y="30">{escape(chart.title)}</text>',
        f'<text class="remark" x="{PAGE_MARGIN}" y="48">{escape(_remark(chart))}</text>',
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


def _remark(chart: Chart) -> str:
    parts = [chart.file]
    parts += [f"scene {chart.scene}"] if chart.scene else []
    parts += [f"goal {chart.goal}"] if chart.goal else []
    return " · ".join(parts)


def _heading_width(chart: Chart) -> int:
    return round(max(width(chart.title, 20.0, "bold"), width(_remark(chart), 11.0)))


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


def _legend_width(symbols: list[Symbol]) -> int:
    return round(sum(_entry_width(MEANINGS[symbol]) for symbol in symbols))


def _entry_width(text: str) -> float:
    return round(19 + width(text, TITLE) + _LEGEND_GAP)
