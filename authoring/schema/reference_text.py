"""Text of the node reference, for the terminal and for docs/nodes.md."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator

from ...files.value_wording import listed
from ...trees.controls import NODES
from ...trees.declaration import COMMON_KEYS
from ...world.causes import Cause
from .node_reference import TITLES, CauseEntry, NodeEntry, PortEntry, SlotEntry, cause_entry
from .port_wording import COMMON_DOCS

TEXT_WIDTH = 100


def table(nodes: Iterable[NodeEntry]) -> str:
    """Return all nodes by kind, one per line."""
    entries = tuple(nodes)
    width = max((len(node.id) for node in entries), default=0)
    lines: list[str] = []
    for kind, title in TITLES.items():
        of_kind = [node for node in entries if node.kind == kind]
        if of_kind:
            lines += ["", title] if lines else [title]
            lines += [f"  {node.id:<{width}}  {node.summary}" for node in of_kind]
    return "\n".join(lines) + "\n"


def page(node: NodeEntry) -> str:
    """Return the full text about one node."""
    parts = [f"{node.id} ({node.kind})", _wrapped(node.doc)]
    for title, ports in (("Inputs", node.inputs), ("Outputs", node.outputs)):
        if ports:
            parts.append("\n".join((title, *(line for port in ports for line in _port_text(port)))))
    if node.slots:
        lines = (line for slot in node.slots for line in _slot_text(slot))
        parts.append("\n".join(("Children", *lines)))
    if node.rule:
        parts.append(_wrapped(node.rule))
    if node.causes:
        lines = (line for cause in node.causes for line in _cause(cause, 2))
        parts.append("\n".join(("Fails with", *lines)))
    if node.uses:
        parts.append(f"Uses {listed(list(node.uses))}.")
    if node.hand_after:
        parts.append(node.hand_after)
    if node.limit:
        parts.append(node.limit)
    if node.example:
        parts.append("Example\n" + textwrap.indent(node.example, "  "))
    parts.append(_wrapped(f"As every node it also takes {listed(list(COMMON_KEYS))}."))
    return "\n\n".join(parts) + "\n"


def facts(port: PortEntry) -> str:
    """Return the accepted values of a port in one line."""
    if port.direction == "out":
        return f"{port.type}; written to a key of the blackboard"
    choices = "one of " + ", ".join(port.choices) if port.choices else port.type
    default = "required" if port.required else f"default {port.default}"
    return "; ".join(filter(None, (choices, port.bounds, default)))


def _port_text(port: PortEntry) -> Iterator[str]:
    yield f"  {port.key}: {facts(port)}"
    yield _wrapped(port.doc, 6)
    if port.may_use:
        yield _wrapped(port.may_use, 6)


def _slot_text(slot: SlotEntry) -> Iterator[str]:
    yield f"  {slot.key}: {slot.form}" + ("" if slot.required else "; may be left out")
    yield _wrapped(slot.doc, 6)


def _cause(cause: CauseEntry, indent: int) -> Iterator[str]:
    said = f"{cause.sentence} First remedy: {cause.remedy}." if cause.remedy else cause.sentence
    yield " " * indent + f"{cause.name}: {said}"
    for member in cause.members:
        yield from _cause(member, indent + 2)


def _wrapped(text: str, indent: int = 0) -> str:
    space = " " * indent
    return "\n\n".join(
        textwrap.fill(paragraph, TEXT_WIDTH, initial_indent=space, subsequent_indent=space)
        for paragraph in text.split("\n\n")
    )


_LANGUAGE = frozenset(node.declaration.id for node in NODES)
_HEAD = (
    "# Nodes",
    "What may stand in a mission: each node with its ports, its children, and the causes with which it "
    "may fail. This page is written by `make docs` from the declarations in the code; `picktree nodes NAME` "
    "shows the same in a terminal, also of plug-ins' nodes and of a mission's sub-trees (`--mission FILE`).",
    "A node is a mapping with one key, its ID, and its ports below: `GoTo: {pose: home}`. One that needs no "
    "port may stand as the bare ID: `GoTo`. Children stand as a list below the node, or at `do:` where it "
    "has ports as well; a single child may stand below it by itself: `Inverter: {Condition: {if: holding}}`. "
    'A value is a literal, or a reference to a key of the blackboard: `"{item}"`, or to an attribute of the '
    'object whose id is there: `"{item.colour}"`.',
)


def markdown(nodes: Iterable[NodeEntry], causes: Iterable[Cause]) -> str:
    """Return the whole reference as Markdown."""
    entries = tuple(nodes)
    lines = ["\n\n".join(_HEAD), ""]
    for kind, title in TITLES.items():
        of_kind = [node for node in entries if node.kind == kind]
        if of_kind:
            lines += [f"**{title}**: " + ", ".join(f"[{n.id}](#{n.id.lower()})" for n in of_kind), ""]
    lines += ["## Every node", "", "What may stand under any node, sub-trees included.", ""]
    lines += ["| key | what it is |", "|---|---|"]
    lines += [f"| `{key}` | {_cell(doc)} |" for key, doc in COMMON_DOCS.items()]
    for kind, title in TITLES.items():
        of_kind = [node for node in entries if node.kind == kind]
        if of_kind:
            lines += ["", f"## {title}"]
        for node in of_kind:
            lines += ["", *_node(node)]
    lines += ["", "## Causes", "", *_causes(cause_entry(cause) for cause in causes)]
    return "\n".join(lines) + "\n"


def _node(node: NodeEntry) -> Iterator[str]:
    yield f"### {node.id}"
    yield ""
    yield node.doc
    if node.kind in ("control", "decorator") or node.id in _LANGUAGE:
        yield ""
        yield f"Tick by tick: [{node.id}](control-nodes.md#{node.id.lower()})."
    if node.ports:
        yield ""
        yield "| port | takes | default | what it is |"
        yield "|---|---|---|---|"
        yield from (_port(port) for port in node.ports)
    if node.slots:
        yield ""
        yield "| children | are | what they do |"
        yield "|---|---|---|"
        yield from (_slot(slot) for slot in node.slots)
    if node.rule:
        yield ""
        yield node.rule
    if node.causes:
        yield ""
        yield "Fails with " + listed([_linked(cause) for cause in node.causes]) + "."
    said = [f"Uses {listed(list(node.uses))}."] if node.uses else []
    said += [node.hand_after] if node.hand_after else []
    said += [node.limit] if node.limit else []
    if said:
        yield ""
        yield " ".join(said)
    if node.example:
        yield ""
        yield "```yaml"
        yield node.example
        yield "```"


def _port(port: PortEntry) -> str:
    takes = port.type if not port.choices else "one of " + ", ".join(f"`{choice}`" for choice in port.choices)
    takes = "; ".join(filter(None, (takes, port.bounds, port.may_use)))
    default = "*required*" if port.required else "*output*" if port.direction == "out" else port.default
    return f"| `{port.key}` | {_cell(takes)} | {_cell(default)} | {_cell(port.doc)} |"


def _slot(slot: SlotEntry) -> str:
    form = slot.form if slot.required else f"{slot.form}; may be left out"
    return f"| `{slot.key}` | {_cell(form)} | {_cell(slot.doc)} |"


def _linked(cause: CauseEntry) -> str:
    family = cause.name.split(".")[0]
    return f"[`{cause.name}`](#family-{family})"


def _causes(causes: Iterable[CauseEntry]) -> Iterator[str]:
    yield (
        "Why a node fails. A cause may stand under `when:` of a [Recover](#recover); so may its family, as "
        "`grasp.*`, and `*` for all but `internal.error`."
    )
    family = ""
    for cause in causes:
        first = cause.name.split(".")[0]
        if first != family:
            family = first
            yield ""
            yield f"### Family {family}"
            yield ""
            yield "| cause | what it means | first remedy |"
            yield "|---|---|---|"
        yield f"| `{cause.name}` | {_cell(cause.sentence)} | {_cell(cause.remedy)} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
