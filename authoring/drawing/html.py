"""Chart as one HTML file: the tree can be folded, zoomed and searched, and shows details."""

from __future__ import annotations

from string import Template
from typing import Final, TypeAlias

import orjson

from .cards import card, header, pill
from .chart import MEANINGS, Branch, Chart, ChartNode, ChartPort, ChartTree, Rule
from .shapes import (
    ALL_ICONS,
    PAGE_FOLDER,
    card_svg,
    classes,
    definitions,
    escape,
    header_texts,
    page_style,
    pill_svg,
    style,
    use,
)
from .text import text

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
        style=f"{style()}{page_style()}",
        legend=_legend(),
        text=escape(text(chart)),
        chart=_script_json(chart_json(chart, expand=expand)),
        script="".join(scripts),
    )


def chart_json(chart: Chart, *, expand: bool = False) -> dict[str, Json]:
    """Return the data that `PicktreeDrawing` of viewer.js draws: trees by name, each node with its card as
    SVG."""
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
    about = _node(chart, Branch("", "child", call), 0)
    about["header"] = {"svg": header_texts(top), "width": top.width, "height": top.height}
    return {"call": about, "root": _node(chart, Branch("", "child", tree.root), 0)}


def _node(chart: Chart, branch: Branch, room: int) -> dict[str, Json]:
    """Return a node's data. `room`: width of the widest label among its siblings, px."""
    node, drawn, label = branch.node, card(branch.node), pill(branch)
    rooms = [below.width for b in node.branches if (below := pill(b)) is not None]
    found: dict[str, Json] = {
        "id": node.id,
        "name": node.name,
        "title": _title(node),
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
        "ports": [_port(port) for port in node.ports],
        "defaults": [_port(port) for port in node.defaults],
        "before": [_rule(rule) for rule in node.before],
        "after": [_rule(rule) for rule in node.after],
        "causes": list(node.causes),
        "uses": list(node.uses),
        "breakpoint": node.breakpoint,
        "words": _words(branch),
        "children": [_node(chart, below, max(rooms, default=0)) for below in node.branches],
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


def _title(node: ChartNode) -> str:
    name = node.given_name
    return f"{node.id}{'' if name[:1] in ('', '#') else ' '}{name}"


def _port(port: ChartPort) -> Json:
    return {"key": port.key, "value": port.value, "role": port.role, "doc": port.doc}


def _rule(rule: Rule) -> Json:
    return {"key": rule.key, "value": rule.text, "role": "rule", "doc": ""}


def _words(branch: Branch) -> str:
    """Return the text that a search in the page looks through, in lower case."""
    node = branch.node
    parts = [branch.label, node.id, node.name, *node.causes, *node.uses]
    for port in node.ports:
        parts += [port.key, port.value]
    for rule in (*node.before, *node.after):
        parts += [rule.key, rule.text]
    return " ".join(parts).lower()


def _legend() -> str:
    rows = "".join(
        '<li><svg class="drawing" viewBox="0 0 14 14" aria-hidden="true">'
        f"{use(symbol, 0, 0)}</svg>{meaning}</li>"
        for symbol, meaning in MEANINGS.items()
    )
    return f"<ul>{rows}</ul>"


def _script_json(found: dict[str, Json]) -> str:
    """Return JSON that cannot end the script element around it."""
    return orjson.dumps(found).decode("utf-8").replace("</", "<\\/").replace("<!--", "\\u003c!--")
