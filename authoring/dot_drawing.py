"""Drawing of a chart as DOT, the language of Graphviz."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from picktree.trees import Kind

from .mission_chart import (
    CHARACTERS,
    BranchRole,
    Chart,
    ChartNode,
    ChartTree,
)
from .svg_drawing import (
    LIGHT_COLOURS,
    escape,
)
from .text_drawing import port_text

_SHAPES: Final[Mapping[Kind, str]] = {
    "action": 'shape=box, style="rounded,filled"',
    "condition": 'shape=box, style="rounded,filled", peripheries=2',
    "control": "shape=box, style=filled",
    "decorator": 'shape=box, style="rounded,filled"',
    "subtree": "shape=component, style=filled",
}


_EDGES: Final[Mapping[BranchRole, str]] = {
    "child": "",
    "choice": f'color="{LIGHT_COLOURS["choice_rim"]}", fontcolor="{LIGHT_COLOURS["choice_ink"]}"',
    "cure": f'style=dashed, color="{LIGHT_COLOURS["cure_rim"]}", fontcolor="{LIGHT_COLOURS["cure_ink"]}"',
}


def dot(chart: Chart, *, expand: bool = False) -> str:
    """Return the chart as DOT: trees as clusters. A call points to its tree, or with `expand` contains it."""
    rows = [
        f"digraph {_quoted(chart.title)} {{",
        "  graph [ordering=out, compound=true, nodesep=0.15, ranksep=0.4, fontsize=14,"
        f' fontname="Helvetica", labeljust=l, labelloc=t, label={_label([chart.title, chart.file])}]',
        '  node [fontname="Helvetica", fontsize=11, margin="0.12,0.06", height=0.3]',
        '  edge [fontname="Helvetica", fontsize=10, arrowsize=0.6, color="#66748a"]',
    ]
    drawn = chart.trees[:1] if expand else chart.trees
    rows += [f"  {line}" for tree in drawn for line in _cluster(chart, tree, tree.name, None, expand)]
    rows += [] if expand else [f"  {line}" for tree in drawn for line in _calls(chart, tree.root, tree.name)]
    return "\n".join([*rows, "}\n"])


def _cluster(chart: Chart, tree: ChartTree, path: str, call: ChartNode | None, expand: bool) -> Iterator[str]:
    """Yield the lines of a tree's cluster. `path`: path of the tree's node in the running tree."""
    yield f"subgraph {_quoted(f'cluster {path}')} {{"
    ports = tree.ports if call is None else call.ports
    label = _label([f"{CHARACTERS['subtree']} {tree.name}", *map(port_text, ports)])
    colours = f'fillcolor="{LIGHT_COLOURS["bar"]}", color="#c5ccd6"'
    yield f'  graph [label={label}, style="rounded,filled", {colours}]'
    yield from (f"  {line}" for line in _node(chart, tree.root, f"{path}/{tree.root.name}", expand))
    yield "}"


def _node(chart: Chart, node: ChartNode, path: str, expand: bool) -> Iterator[str]:
    called = chart.tree(node.calls) if node.calls else None
    if called is not None and expand:
        yield from _cluster(chart, called, path, node, expand)
        return
    attributes = f"label={_label(_texts(node))}, {_SHAPES[node.kind]}, {_colours(node)}"
    attributes += f", tooltip={_label([*([node.doc] if node.calls else []), node.place])}"
    attributes += f', color="{LIGHT_COLOURS["stop"]}", penwidth=2' if node.breakpoint else ""
    yield f"{_quoted(path)} [{attributes}]"
    for branch in node.branches:
        below = f"{path}/{branch.node.name}"
        yield from _node(chart, branch.node, below, expand)
        yield _edge(chart, path, below, branch.node, branch.label, branch.role, expand)


def _calls(chart: Chart, node: ChartNode, above: str) -> Iterator[str]:
    """Yield the edges to called trees. They are outside the clusters: inside, they would draw the root in."""
    path = f"{above}/{node.name}"
    if node.calls:
        called = chart.tree(node.calls)
        root = _quoted(f"{called.name}/{called.root.name}")
        head = _quoted(f"cluster {called.name}")
        yield f"{_quoted(path)} -> {root} [lhead={head}, style=dotted, constraint=false]"
    for branch in node.branches:
        yield from _calls(chart, branch.node, path)


def _edge(
    chart: Chart, above: str, below: str, node: ChartNode, label: str, role: BranchRole, expand: bool
) -> str:
    parts = [f"label={_label([label], centred=True)}"] if label else []
    parts += [_EDGES[role]] if _EDGES[role] else []
    if node.calls and expand:
        parts.append(f"lhead={_quoted(f'cluster {below}')}")
        while node.calls:
            node = chart.tree(node.calls).root
            below = f"{below}/{node.name}"
    attributes = f" [{', '.join(parts)}]" if parts else ""
    return f"{_quoted(above)} -> {_quoted(below)}{attributes}"


def _texts(node: ChartNode) -> list[str]:
    symbol = CHARACTERS[node.symbol]
    if node.written_as_list:
        return [symbol]
    before, after = ([f"{rule.key}: {rule.text}" for rule in rules] for rules in (node.before, node.after))
    stop = [f"breakpoint: {node.breakpoint}"] if node.breakpoint else []
    return [f"{symbol} {node.title}", *before, *map(port_text, node.ports), *after, *stop]


def _colours(node: ChartNode) -> str:
    name = "cure" if node.symbol == "recover" else node.kind
    return f'fillcolor="{LIGHT_COLOURS[name]}", color="{LIGHT_COLOURS[f"{name}_rim"]}"'


def _label(lines: list[str], *, centred: bool = False) -> str:
    """Return a label of left-aligned lines; Graphviz reads entities in labels."""
    end = "" if centred or len(lines) == 1 else "\\l"
    text = "".join(escape(line).replace("\\", "\\\\") + end for line in lines)
    return f'"{text}"'


def _quoted(name: str) -> str:
    return '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'
