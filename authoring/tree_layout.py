"""Layout of a drawing: cards with their text lines and sizes, px, and their places,
by Graphviz or in columns.
"""

from __future__ import annotations

import math
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal, TypeAlias

from .mission_chart import Branch, BranchRole, Chart, ChartNode, ChartPort, ChartTree, Rule

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


COLUMN_GAP: Final = 44
"""Distance between columns, px."""
ROW_GAP: Final = 10
"""Distance between boxes of a column, px."""
_PER_INCH: Final = 72.0


@dataclass(frozen=True, slots=True)
class LayoutBox:
    """Box to be placed; `parent` is the index of an earlier box, None for the root."""

    width: int
    height: int
    parent: int | None


@dataclass(frozen=True, slots=True)
class BoxPosition:
    """Upper left corner of a box, and start of its column, px."""

    x: int
    y: int


def lay_out_boxes(boxes: Sequence[LayoutBox]) -> tuple[BoxPosition, ...]:
    """Return a position for each box: without overlaps, with 0 as the least coordinate of each axis.

    Boxes of the same depth form one column, aligned left. Graphviz gets the tree turned by 90 degrees. Its
    top-down layout keeps the order of children, and allows boxes of different heights in a rank.
    """
    from pygraphviz import AGraph

    depths = _depths(boxes)
    columns = [0] * (max(depths) + 1)
    for box, depth in zip(boxes, depths, strict=True):
        columns[depth] = max(columns[depth], box.width)
    families = Counter(box.parent for box in boxes)
    graph = AGraph(
        directed=True, strict=False, ordering="out", splines="false",
        nodesep=f"{ROW_GAP / _PER_INCH:.6f}", ranksep=f"{COLUMN_GAP / _PER_INCH:.6f}",
    )  # fmt: skip
    # An only child is level with its parent. Without labels Graphviz needs no font, and so prints nothing
    # about missing fonts.
    graph.node_attr.update(shape="box", fixedsize="true", label="", margin="0")
    for index, (box, depth) in enumerate(zip(boxes, depths, strict=True)):
        graph.add_node(
            index, width=f"{box.height / _PER_INCH:.6f}", height=f"{columns[depth] / _PER_INCH:.6f}"
        )
        if box.parent is not None:
            graph.add_edge(box.parent, index, weight="1" if families[box.parent] > 1 else "8")
    graph.layout(prog="dot")
    middles = [float(graph.get_node(index).attr["pos"].partition(",")[0]) for index in range(len(boxes))]
    tops = [middle - box.height / 2 for middle, box in zip(middles, boxes, strict=True)]
    lefts = [sum(columns[:depth]) + COLUMN_GAP * depth for depth in depths]
    return tuple(BoxPosition(x, round(y - min(tops))) for x, y in zip(lefts, tops, strict=True))


def _depths(boxes: Sequence[LayoutBox]) -> list[int]:
    depths: list[int] = []
    for box in boxes:
        depths.append(0 if box.parent is None else depths[box.parent] + 1)
    return depths


FRAME_GAP: Final = 28
_TARGET_ASPECT_RATIO: Final = 1.5
"""Target ratio of width to height of a page."""


@dataclass(frozen=True, slots=True)
class FramePage:
    spots: tuple[BoxPosition, ...]
    width: int
    height: int


def page(sizes: Sequence[tuple[int, int]]) -> FramePage:
    """Return the page nearest to a screen's shape among those with one column, two, and so on."""
    pages = [_in_columns(sizes, count) for count in range(1, len(sizes) + 1)]
    return min(
        pages,
        key=lambda p: max(
            p.width / p.height / _TARGET_ASPECT_RATIO, p.height * _TARGET_ASPECT_RATIO / p.width
        ),
    )


def _in_columns(sizes: Sequence[tuple[int, int]], count: int) -> FramePage:
    columns: list[list[int]] = [[] for _ in range(count)]
    depths = [0] * count
    tops: list[int] = []
    for index, (_, height) in enumerate(sizes):
        shortest = depths.index(min(depths))
        columns[shortest].append(index)
        tops.append(depths[shortest])
        depths[shortest] += height + FRAME_GAP
    widths = [max((sizes[index][0] for index in column), default=0) for column in columns]
    lefts = {
        index: sum(widths[:number]) + FRAME_GAP * number
        for number, column in enumerate(columns)
        for index in column
    }
    spots = tuple(BoxPosition(lefts[index], tops[index]) for index in range(len(sizes)))
    return FramePage(spots, sum(widths) + FRAME_GAP * (count - 1), max(depths) - FRAME_GAP)


INSET: Final = 16
"""Distance between a frame and its content, px."""


@dataclass(frozen=True, slots=True)
class PlacedCard:
    """Node at its place: `x`, `y` of its label, or of its body without a label, within the frame, px."""

    path: str
    """Path of the node within its tree: `Repeat/Sequence/Observe`."""
    pill: BranchLabel | None
    room: int
    """Width for the labels of the node and its siblings, px, so that the bodies are aligned."""
    body: NodeCard | TreeFrame
    x: int
    y: int
    height: int
    parent: int | None
    role: BranchRole

    @property
    def body_x(self) -> int:
        return self.x + self.room

    @property
    def body_y(self) -> int:
        return self.y + (self.height - self.body.height) // 2

    @property
    def middle(self) -> int:
        return self.y + self.height // 2


@dataclass(frozen=True)
class TreeFrame:
    """Tree with its header; `call` is the node that it replaces, None for a separate tree."""

    tree: ChartTree
    call: ChartNode | None
    header: Header
    tiles: tuple[PlacedCard, ...]

    @cached_property
    def width(self) -> int:
        across = max(tile.body_x + tile.body.width for tile in self.tiles) + INSET
        return max(across, self.header.width + 2 * (INSET // 2))

    @cached_property
    def height(self) -> int:
        down = max(tile.y + tile.height for tile in self.tiles) + INSET
        return down + down % 2

    def edges(self) -> Iterator[Edge]:
        for tile in self.tiles:
            if tile.parent is not None:
                above = self.tiles[tile.parent]
                start = above.body_x + above.body.width
                yield Edge(
                    start, above.middle, tile.x - COLUMN_GAP, tile.x, tile.middle, tile.role, tile.body_x
                )


@dataclass(frozen=True, slots=True)
class Edge:
    """Edge from a parent's right side straight to `turn`, then over to the child, through its label."""

    x: int
    y: int
    turn: int
    to_x: int
    to_y: int
    role: BranchRole
    body_x: int


def frame_of(tree: ChartTree) -> TreeFrame:
    """Return a tree's frame with its calls as cards."""
    return _Framing(None).frame(tree, None)


def expanded(chart: Chart) -> TreeFrame:
    """Return the frame of the chart's first tree with every call expanded."""
    return _Framing(chart).frame(chart.trees[0], None)


@dataclass(frozen=True, slots=True)
class _Step:
    """Node, the branch that leads to it, and the index of its parent among all steps."""

    node: ChartNode
    branch: Branch | None
    parent: int | None
    path: str


class _Framing:
    def __init__(self, chart: Chart | None) -> None:
        self._chart = chart
        self._tiles: dict[str, tuple[PlacedCard, ...]] = {}
        """Placed cards by tree: each tree is laid out once, wherever it is called."""

    def frame(self, tree: ChartTree, call: ChartNode | None) -> TreeFrame:
        if tree.name not in self._tiles:
            self._tiles[tree.name] = self._lay_out(tree)
        head = header(tree, call)
        top = head.height + INSET
        tiles = tuple(_shifted(tile, INSET, top) for tile in self._tiles[tree.name])
        return TreeFrame(tree, call, head, tiles)

    def _lay_out(self, tree: ChartTree) -> tuple[PlacedCard, ...]:
        steps = list(_steps(tree.root))
        pills = [pill(step.branch) if step.branch else None for step in steps]
        rooms = _rooms([step.parent for step in steps], pills)
        bodies = [self._body(step.node) for step in steps]
        boxes = [
            LayoutBox(room + body.width, max(body.height, label.height if label else 0), step.parent)
            for step, label, room, body in zip(steps, pills, rooms, bodies, strict=True)
        ]
        return tuple(
            PlacedCard(
                step.path, label, room, body, spot.x, spot.y, box.height, step.parent,
                step.branch.role if step.branch else "child",
            )
            for step, label, room, body, box, spot in zip(
                steps, pills, rooms, bodies, boxes, lay_out_boxes(boxes), strict=True
            )
        )  # fmt: skip

    def _body(self, node: ChartNode) -> NodeCard | TreeFrame:
        if self._chart is None or not node.calls:
            return card(node)
        return self.frame(self._chart.tree(node.calls), node)


def _steps(root: ChartNode) -> Iterator[_Step]:
    """Yield all nodes, parents first."""
    waiting = [_Step(root, None, None, root.name)]
    count = 0
    while waiting:
        step = waiting.pop()
        yield step
        number, count = count, count + 1
        waiting += [
            _Step(branch.node, branch, number, f"{step.path}/{branch.node.name}")
            for branch in reversed(step.node.branches)
        ]


def _rooms(parents: Sequence[int | None], pills: Sequence[BranchLabel | None]) -> list[int]:
    """Return the width before each body, px: 0, or that of the widest label among its siblings."""
    widest: dict[int | None, int] = {}
    for parent, label in zip(parents, pills, strict=True):
        if label is not None:
            widest[parent] = max(widest.get(parent, 0), label.width + PILL_GAP)
    return [widest[parent] if label is not None else 0 for parent, label in zip(parents, pills, strict=True)]


def _shifted(tile: PlacedCard, x: int, y: int) -> PlacedCard:
    return replace(tile, x=tile.x + x, y=tile.y + y)
