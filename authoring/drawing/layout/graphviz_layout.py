"""Layout of one tree's boxes by Graphviz: left to right, children below one another."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

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
