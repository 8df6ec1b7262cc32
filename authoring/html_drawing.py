"""Drawing of a chart as an HTML page that unfolds, searches and zooms."""

from __future__ import annotations

from string import Template
from typing import Final, TypeAlias

import orjson

from .mission_chart import (
    MEANINGS,
    Branch,
    Chart,
    ChartNode,
    ChartPort,
    ChartTree,
    Rule,
)
from .svg_drawing import (
    ALL_ICONS,
    PAGE_FOLDER,
    card_svg,
    classes,
    definitions,
    escape,
    header_texts,
    pill_svg,
    style,
    use,
)
from .text_drawing import text
from .tree_layout import card, header, pill

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
