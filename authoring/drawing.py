"""Drawing of a chart in the format of a file's name: text for a terminal, an HTML page, DOT, or SVG."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from string import Template
from typing import Final, Literal, Protocol, TypeAlias

import orjson

from picktree.files import PicktreeError
from picktree.trees import Kind

from .mission_chart import (
    CHARACTERS,
    MEANINGS,
    Branch,
    BranchRole,
    Chart,
    ChartNode,
    ChartPort,
    ChartTree,
    Rule,
)
from .svg_drawing import (
    ALL_ICONS,
    LIGHT_COLOURS,
    PAGE_FOLDER,
    card_svg,
    classes,
    definitions,
    escape,
    header_texts,
    pill_svg,
    style,
    svg,
    use,
)
from .tree_layout import card, header, pill

DEFAULT_COLUMNS: Final = 100
_MIN_NODE_COLUMNS: Final = 40
"""Minimum width of a node's line at any depth, columns."""
_MIN_VALUE_COLUMNS: Final = 8
"""Minimum width of a shortened value, columns."""


def text(chart: Chart, *, columns: int = DEFAULT_COLUMNS, expand: bool = False) -> str:
    """Return the trees as text, one node per line. `expand`: each call is followed by its tree."""
    about = [chart.title, *([f"scene {chart.scene}"] if chart.scene else [])]
    rows = [_cut(" · ".join(about), columns)]
    for tree in chart.trees[:1] if expand else chart.trees:
        rows += ["", _row("", tree.name, [_port(port) for port in tree.ports], columns)]
        rows += [_cut(tree.doc, columns)] if tree.doc else []
        rows += _branches(chart, [Branch("", "child", tree.root)], "", columns, expand)
    return "\n".join(rows) + "\n"


def _branches(
    chart: Chart, branches: Sequence[Branch], indent: str, columns: int, expand: bool
) -> Iterator[str]:
    for branch in branches:
        node, last = branch.node, branch is branches[-1]
        stop = [f"● stops {node.breakpoint}"] if node.breakpoint else []
        before, after = (
            [f"[{rule.key}: {rule.text}]" for rule in rules] for rules in (node.before, node.after)
        )
        words = [*stop, *before, *map(_port, node.ports), *after]
        label = f"{branch.label}:" if branch.label else ""
        title = "" if node.written_as_list else f"{CHARACTERS[node.symbol]} {node.title}"
        yield _row(f"{indent}{'└── ' if last else '├── '}", f"{label} {title}".strip(), words, columns)
        called = [Branch("", "child", chart.tree(node.calls).root)] if expand and node.calls else []
        beyond = f"{indent}{'    ' if last else '│   '}"
        yield from _branches(chart, [*called, *node.branches], beyond, columns, expand)


def _port(port: ChartPort) -> str:
    return f"{port.key} → {port.value}" if port.role == "output" else f"{port.key}: {port.value}"


def _row(indent: str, title: str, words: Sequence[str], columns: int) -> str:
    """Return one line with the longest words shortened to fit; lines of deep nodes may be longer."""
    words = list(words)
    columns = max(columns, _cells(indent) + _MIN_NODE_COLUMNS)
    room = columns - _cells(indent) - _cells(title) - 2 * len(words)
    while words and sum(map(_cells, words)) > room:
        longest = max(range(len(words)), key=lambda index: _cells(words[index]))
        excess = sum(map(_cells, words)) - room
        size = _cells(words[longest])
        if size <= _MIN_VALUE_COLUMNS:
            break
        words[longest] = _cut(words[longest], max(size - excess, _MIN_VALUE_COLUMNS))
    return _cut("  ".join([f"{indent}{title}", *words]), columns)


def _cut(line: str, columns: int) -> str:
    """Return the line, ended by an ellipsis where it is longer than the columns."""
    if _cells(line) <= columns:
        return line
    kept, room = "", columns - 1
    for character in line:
        room -= _cells(character)
        if room < 0:
            break
        kept += character
    return f"{kept.rstrip()}…"


def _cells(line: str) -> int:
    """Return the number of terminal columns of the line."""
    return sum(
        0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in line
    )


Json: TypeAlias = "dict[str, Json] | list[Json] | str | int | bool | None"
_SCRIPTS: Final = ("libraries.js", "arranging.js", "viewer.js", "page.js")


def html(chart: Chart, *, expand: bool = False) -> str:
    """Return the self-contained page. `expand`: it opens with every sub-tree expanded."""
    template = Template((PAGE_FOLDER / "page.html").read_text(encoding="utf-8"))
    scripts = [(PAGE_FOLDER / name).read_text(encoding="utf-8") for name in _SCRIPTS]
    about = [chart.file, f"scene {chart.scene}" if chart.scene else "", chart.goal]
    return template.substitute(
        title=escape(chart.title),
        remark=escape(" · ".join(part for part in about if part)),
        style=style("drawing") + style("page"),
        legend=_legend(),
        text=escape(text(chart)),
        # Nothing in the JSON may end the script element around it.
        chart=orjson.dumps(chart_json(chart, expand=expand))
        .decode("utf-8")
        .replace("</", "<\\/")
        .replace("<!--", "\\u003c!--"),
        script="".join(scripts),
    )


def chart_json(chart: Chart, *, expand: bool = False) -> dict[str, Json]:
    """Return the data that `PicktreeDrawing` of viewer.js draws: trees by name, nodes with cards as SVG."""
    return {
        "title": chart.title,
        "expand": expand,
        "order": [tree.name for tree in chart.trees],
        "definitions": definitions(ALL_ICONS),
        "trees": {tree.name: _tree(chart, tree) for tree in chart.trees},
    }


def _tree(chart: Chart, tree: ChartTree) -> dict[str, Json]:
    # The frame of an uncalled tree needs a node, too: that of the whole run.
    call = ChartNode(
        tree.name, tree.name, "subtree", "subtree", tree.place, tree.doc, tree.name, ports=tree.ports
    )
    top = header(tree)
    about = _node_json(chart, Branch("", "child", call), 0)
    about["header"] = {"svg": header_texts(top), "width": top.width, "height": top.height}
    return {"call": about, "root": _node_json(chart, Branch("", "child", tree.root), 0)}


def _node_json(chart: Chart, branch: Branch, room: int) -> dict[str, Json]:
    """Return a node's data. `room`: width of the widest label among its siblings, px."""
    node, drawn, label = branch.node, card(branch.node), pill(branch)
    rooms = [below.width for b in node.branches if (below := pill(b)) is not None]
    found: dict[str, Json] = {
        "id": node.id,
        "name": node.name,
        "title": node.title,
        "classes": classes(node),
        "meaning": MEANINGS[node.symbol],
        "role": branch.role,
        "svg": card_svg(drawn),
        "width": drawn.width,
        "height": drawn.height,
        "pill": None,
        "header": None,
        "calls": node.calls,
        "doc": node.doc,
        "place": node.place,
        "ports": [_port_json(port) for port in node.ports],
        "defaults": [_port_json(port) for port in node.defaults],
        "before": [_rule(rule) for rule in node.before],
        "after": [_rule(rule) for rule in node.after],
        "causes": list(node.causes),
        "uses": list(node.uses),
        "breakpoint": node.breakpoint,
        "words": _search_words(branch),
        "children": [_node_json(chart, below, max(rooms, default=0)) for below in node.branches],
    }
    if label is not None:
        found["pill"] = {
            "label": branch.label, "svg": pill_svg(label), "width": label.width, "height": label.height,
            "room": room,
        }  # fmt: skip
    if node.calls:
        top = header(chart.tree(node.calls), node)
        found["header"] = {"svg": header_texts(top, node), "width": top.width + 22, "height": top.height}
    return found


def _port_json(port: ChartPort) -> Json:
    return {"key": port.key, "value": port.value, "role": port.role, "doc": port.doc}


def _rule(rule: Rule) -> Json:
    return {"key": rule.key, "value": rule.text, "role": "rule", "doc": ""}


def _search_words(branch: Branch) -> str:
    """Return the text that a search in the page looks through, in lower case."""
    node = branch.node
    ports = [f"{port.key} {port.value}" for port in node.ports]
    rules = [f"{rule.key} {rule.text}" for rule in (*node.before, *node.after)]
    return " ".join([branch.label, node.id, node.name, *node.causes, *node.uses, *ports, *rules]).lower()


def _legend() -> str:
    rows = "".join(
        '<li><svg class="drawing" viewBox="0 0 14 14" aria-hidden="true">'
        f"{use(symbol, 0, 0)}</svg>{meaning}</li>"
        for symbol, meaning in MEANINGS.items()
    )
    return f"<ul>{rows}</ul>"


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
    label = _label([f"{CHARACTERS['subtree']} {tree.name}", *map(_port, ports)])
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
    return [f"{symbol} {node.title}", *before, *map(_port, node.ports), *after, *stop]


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


Suffix: TypeAlias = Literal[".svg", ".html", ".dot", ".txt"]


class _Drawer(Protocol):
    def __call__(self, chart: Chart, /, *, expand: bool = False) -> str: ...


_DRAWERS: Final[Mapping[Suffix, _Drawer]] = {".svg": svg, ".html": html, ".dot": dot, ".txt": text}


def suffix_of(name: str) -> Suffix:
    """Return the drawing format of a file name. Raises PicktreeError when there is none."""
    for suffix in _DRAWERS:
        if name.lower().endswith(suffix):
            return suffix
    raise PicktreeError(f"{name}: a picture is a file that ends in .svg, .html, .dot or .txt")


def drawing_text(chart: Chart, suffix: Suffix, *, expand: bool = False) -> str:
    """Return the text of a drawing file; equal charts give equal texts on every machine."""
    return _DRAWERS[suffix](chart, expand=expand)
