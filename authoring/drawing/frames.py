"""Frames of a drawing: places of the cards, by Graphviz or in columns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

from .cards import PILL_GAP, BranchLabel, Header, NodeCard, card, header, pill
from .chart import Branch, BranchRole, Chart, ChartNode, ChartTree

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
