"""Where the boxes of one tree stand, left to right, children below one another. Graphviz decides."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

BESIDE: Final = 44
"""Pixels between a column and the next."""
BETWEEN: Final = 10
"""Pixels between two boxes of a column."""
_PER_INCH: Final = 72.0


@dataclass(frozen=True, slots=True)
class LayoutBox:
    """A box to be placed; `parent` is the index of an earlier box, None for the root."""

    width: int
    height: int
    parent: int | None


@dataclass(frozen=True, slots=True)
class BoxPosition:
    """The upper left corner of a box, and where its column begins; in pixels."""

    x: int
    y: int


def lay_out_boxes(boxes: Sequence[LayoutBox]) -> tuple[BoxPosition, ...]:
    """A spot for each box; no two overlap, all coordinates are at least 0, and so is one of each.

    Boxes of the same depth stand in one column, flush left. Graphviz gets the tree turned by 90 degrees: its
    top-down layout keeps the order of children, and knows a rank of boxes of different heights.
    """
    from pygraphviz import AGraph

    depths = _depths(boxes)
    columns = [0] * (max(depths) + 1)
    for box, depth in zip(boxes, depths, strict=True):
        columns[depth] = max(columns[depth], box.width)
    families = Counter(box.parent for box in boxes)
    graph = AGraph(
        directed=True, strict=False, ordering="out", splines="false",
        nodesep=f"{BETWEEN / _PER_INCH:.6f}", ranksep=f"{BESIDE / _PER_INCH:.6f}",
    )  # fmt: skip
    # An only child stands level with its parent.
    # Without labels Graphviz asks for no font, and so says nothing about fonts that are missing.
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
    lefts = [sum(columns[:depth]) + BESIDE * depth for depth in depths]
    return tuple(BoxPosition(x, round(y - min(tops))) for x, y in zip(lefts, tops, strict=True))


def _depths(boxes: Sequence[LayoutBox]) -> list[int]:
    depths: list[int] = []
    for box in boxes:
        depths.append(0 if box.parent is None else depths[box.parent] + 1)
    return depths
