"""The reference as text for a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator

from ...trees.declaration import COMMON_KEYS
from .node_reference import TITLES, CauseEntry, NodeEntry, PortEntry, SlotEntry
from .port_wording import listed

WIDTH = 100


def table(nodes: Iterable[NodeEntry]) -> str:
    """All nodes by kind, a line each."""
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
    """Everything about one node."""
    parts = [f"{node.id} ({node.kind})", _wrapped(node.doc)]
    for title, ports in (("Inputs", node.inputs), ("Outputs", node.outputs)):
        if ports:
            parts.append("\n".join((title, *(line for port in ports for line in _port(port)))))
    if node.slots:
        lines = (line for slot in node.slots for line in _slot(slot))
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
    """What a port takes, in a line."""
    if port.direction == "out":
        return f"{port.type}; written to a key of the blackboard"
    choices = "one of " + ", ".join(port.choices) if port.choices else port.type
    default = "required" if port.required else f"default {port.default}"
    return "; ".join(filter(None, (choices, port.bounds, default)))


def _port(port: PortEntry) -> Iterator[str]:
    yield f"  {port.key}: {facts(port)}"
    yield _wrapped(port.doc, 6)
    if port.may_use:
        yield _wrapped(port.may_use, 6)


def _slot(slot: SlotEntry) -> Iterator[str]:
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
        textwrap.fill(paragraph, WIDTH, initial_indent=space, subsequent_indent=space)
        for paragraph in text.split("\n\n")
    )
