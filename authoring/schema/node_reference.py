"""Reference of nodes: the single source of the terminal's page, of JSON and of docs/nodes.md, with the
wording of ports.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain, combinations
from typing import Final

from picktree.files import example, listed
from picktree.trees import (
    COMMON_KEYS,
    NODES,
    Kind,
    Name,
    Node,
    NodeDeclaration,
    PortDeclaration,
    PortValues,
    Required,
    Skill,
    SlotDeclaration,
)
from picktree.world import Cause, Plain, world_facts

_TYPE_WORDS: dict[Name, str] = {
    "string": "text", "int": "whole number", "float": "number", "bool": "true or false",
    "object": "id of an object", "expression": "expression", "any": "any value",
}  # fmt: skip
_LIST_TYPE_WORDS: dict[Name, str] = {
    "string": "list of texts", "int": "list of whole numbers", "float": "list of numbers",
    "bool": "list of true or false", "object": "list of ids of objects", "expression": "list of expressions",
    "any": "list",
}  # fmt: skip
_NAME_WORDS = {
    "camera": "name of a camera of the scene",
    "pose": "name of a pose of the robot",
    "bin": "name of a bin of the scene",
    "tote": "name of a tote of the scene, or of a fixture with a heap on it",
    "hole": "name of a hole of the scene, or of a fixture with holes",
    "fixture": "name of a fixture or bin of the scene",
    "kind": "name of a kind of the scene's catalogue",
    "colour": "name of a colour",
    "planner": "name of a planner",
}
_ASSIGNMENTS = "Assignments such as `tries := tries + 1`, separated by `;`. They are executed when the node "
COMMON_DOCS: Mapping[str, str] = {
    "name": "Name of the node in pictures, logs and paths. Default: its ID.",
    "_failureIf": "An expression: when it holds before the node starts, the node is FAILURE and does not "
    "start.",
    "_successIf": "An expression: when it holds before the node starts, the node is SUCCESS and does not "
    "start.",
    "_skipIf": "An expression: when it holds before the node starts, the node is SKIPPED, as if it were "
    "absent.",
    "_while": "An expression, checked at every tick: when it does not hold, the node is halted and SKIPPED.",
    "_onHalted": _ASSIGNMENTS + "is halted while it runs.",
    "_onFailure": _ASSIGNMENTS + "ends in FAILURE.",
    "_onSuccess": _ASSIGNMENTS + "ends in SUCCESS.",
    "_post": _ASSIGNMENTS + "ends, whatever the outcome.",
    "breakpoint": "Stop of `picktree run --debug`: `before` the node starts, or `after` its end.",
}
"""Documentation of the keys that every node may have."""


def type_words(port: PortDeclaration) -> str:
    """Return a port's type in words: `number in m, or as "30 mm"`, `name of a camera of the scene`."""
    if port.names is not None and not port.type.many:
        words = _NAME_WORDS[port.names]
    else:
        words = (_LIST_TYPE_WORDS if port.type.many else _TYPE_WORDS)[port.type.name]
    if port.unit:
        words += f" in {port.unit}"
        shown = "2 s" if port.unit == "ms" else example(port.unit)
        words += f', or as "{shown}"' if port.direction == "in" else ""
    elif port.type.name == "float" and not port.type.many and port.direction == "in":
        words += ', or as "50 %"'
    return f"{words}, or null" if port.type.optional else words


def default_words(port: PortDeclaration) -> str:
    """Return the default in a file's syntax; `none` when it means "not given", empty without a default."""
    match port.default:
        case Required():
            return ""
        case None | "" | []:
            return "none"
        case bool() as flag:
            return str(flag).lower()
        case int() | float() as number:
            return f"{number:g} {port.unit}" if port.unit else f"{number:g}"
        case other:
            return str(other)


def expression_words(port: PortDeclaration) -> str:
    """Return the names that an expression may use; empty for other ports."""
    if port.type.name != "expression":
        return ""
    return f"of the blackboard's keys and the facts {', '.join(world_facts.FACTS)}"


def uses_words(node: NodeDeclaration) -> str:
    """Return the used resources, as `arm and gripper`; empty for none."""
    return listed([str(resource.value) for resource in node.uses])


def hand_words(node: NodeDeclaration) -> str:
    """Return a sentence about the hand after success; empty when the node does not change it."""
    match node.hand_after:
        case "full":
            return "After success the hand holds the object."
        case "empty":
            return "After success the hand is empty."
        case "kept":
            return "An object in the hand after success is in a safe place."
        case "unchanged":
            return ""


def unwrapped(doc: str) -> str:
    """Return a docstring without line breaks inside its paragraphs."""
    paragraphs = re.split(r"\n\s*\n", doc)
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)


_MAX_COMBINED_KEYS = 10
"""Maximum number of a node's optional keys whose combinations are all tried."""


@dataclass(frozen=True, slots=True)
class RequiredOneOf:
    """Keys of which the node needs at least one; `sentence` is its error message without any."""

    keys: tuple[str, ...]
    sentence: str


def required_one_of(node: type[Node]) -> RequiredOneOf | None:
    """Return the keys of which the node needs one, by its own check; None without such a rule."""
    declaration = node.declaration
    every = (*declaration.ports, *declaration.slots)
    required = [part.key for part in every if part.required]
    optional = [part.key for part in every if not part.required]
    sentence = _key_error(node, required)
    if not sentence or len(optional) > _MAX_COMBINED_KEYS:
        return None
    cures = tuple(key for key in optional if not _key_error(node, (*required, key)))
    others = [key for key in optional if key not in cures]
    subsets = chain.from_iterable(combinations(others, size) for size in range(len(others) + 1))
    if cures and all(_key_error(node, (*required, *some)) for some in subsets):
        return RequiredOneOf(cures, sentence)
    return None


def _key_error(node: type[Node], keys: Collection[str]) -> str:
    """Return the node's error when only these keys are given; empty without an error."""
    found = node.check_ports(PortValues(frozenset(keys)))
    return next((wrong for wrong in found if isinstance(wrong, str)), "")


TITLES: Final[Mapping[Kind, str]] = {
    "action": "Actions",
    "condition": "Conditions",
    "control": "Control nodes",
    "decorator": "Decorators",
    "subtree": "Sub-trees",
}
"""Titles of the kinds of nodes, in the order of the reference."""


@dataclass(frozen=True, slots=True)
class PortEntry:
    """Input or output."""

    key: str
    direction: str
    """Direction: "in" or "out"."""
    type: str
    """Type in words: `number in N, or as "20 N"`."""
    doc: str
    required: bool
    default: str
    """Default in a file's syntax; empty without a default."""
    unit: str
    choices: tuple[str, ...]
    names: str
    """Kind of name in scene or robot (camera, pose, bin, …); empty: no name."""
    bounds: str
    may_use: str
    """Names that an expression may use; empty for other ports."""


@dataclass(frozen=True, slots=True)
class SlotEntry:
    """Slot for children."""

    key: str
    form: str
    doc: str
    required: bool


@dataclass(frozen=True, slots=True)
class CauseEntry:
    """Cause with which the node itself may fail; a family has `members`."""

    name: str
    sentence: str
    remedy: str
    members: tuple[CauseEntry, ...] = ()


@dataclass(frozen=True, slots=True)
class NodeEntry:
    """Node with its ports, slots and causes."""

    id: str
    kind: str
    summary: str
    doc: str
    ports: tuple[PortEntry, ...]
    slots: tuple[SlotEntry, ...]
    causes: tuple[CauseEntry, ...]
    uses: tuple[str, ...]
    hand_after: str
    """Sentence about the hand after success, empty when the hand does not change."""
    limit: str
    """Sentence about the simulated time limit; empty without a limit."""
    rule: str
    """Rule that relates several keys; empty without a rule."""
    example: str

    @property
    def inputs(self) -> tuple[PortEntry, ...]:
        return tuple(port for port in self.ports if port.direction == "in")

    @property
    def outputs(self) -> tuple[PortEntry, ...]:
        return tuple(port for port in self.ports if port.direction == "out")


def node_entry(node: NodeDeclaration, causes: Iterable[Cause], of: type[Node] | None = None) -> NodeEntry:
    """Return a node's entry. `causes`: all known ones, for families. `of`: its class; None: a sub-tree."""
    needed = required_one_of(of) if of is not None else None
    known = tuple(causes)
    doc = unwrapped(node.doc)
    return NodeEntry(
        node.id,
        node.kind,
        _first_sentence(doc),
        doc,
        tuple(_port_entry(port) for port in node.ports),
        tuple(_slot_entry(slot) for slot in node.slots),
        tuple(_cause_or_family(cause, known) for cause in node.causes),
        tuple(str(resource.value) for resource in node.uses),
        hand_words(node),
        of.limit_words() if of is not None and issubclass(of, Skill) else "",
        f"{needed.sentence[0].upper()}{needed.sentence[1:]}." if needed else "",
        node.example,
    )


def cause_entry(cause: Cause) -> CauseEntry:
    return CauseEntry(cause.name, cause.sentence, cause.remedy)


def _port_entry(port: PortDeclaration) -> PortEntry:
    choices: Iterable[Plain] = port.choices or ()
    return PortEntry(
        port.key,
        port.direction,
        type_words(port),
        port.doc,
        port.required,
        "" if isinstance(port.default, Required) else default_words(port),
        port.unit or "",
        tuple(map(str, choices)),
        port.names or "",
        port.within.words(),
        expression_words(port),
    )


def _slot_entry(slot: SlotDeclaration) -> SlotEntry:
    match slot.arity:
        case "one":
            form = "a node, or a list of nodes that is run as a Sequence"
        case "many" if slot.least == slot.most:
            form = f"a list of {slot.least} nodes"
        case "many" if slot.most is not None:
            form = f"a list of {slot.least} to {slot.most} nodes"
        case "many":
            form = "a list of nodes" if slot.least <= 1 else f"a list of at least {slot.least} nodes"
        case "table" if slot.of == "cause":
            form = "a mapping: a cause, a family of causes as grasp.*, or *; and what handles it"
        case "table":
            form = "a mapping: a value, and the node for it"
    return SlotEntry(slot.key, form, slot.doc, slot.required)


def _cause_or_family(cause: object, known: tuple[Cause, ...]) -> CauseEntry:
    if isinstance(cause, Cause):
        return cause_entry(cause)
    prefix = f"{cause}".removesuffix("*")
    members = tuple(cause_entry(one) for one in known if one.name.startswith(prefix))
    return CauseEntry(f"{cause}", "any of the family", "", members)


def _first_sentence(doc: str) -> str:
    found = re.match(r".*?[.!?](?=\s|$)", doc)
    return found[0] if found else doc.partition("\n")[0]


def _by_title(nodes: tuple[NodeEntry, ...]) -> Iterator[tuple[str, list[NodeEntry]]]:
    for kind, title in TITLES.items():
        if found := [node for node in nodes if node.kind == kind]:
            yield title, found


TEXT_WIDTH = 100


def table(nodes: Iterable[NodeEntry]) -> str:
    """Return all nodes by kind, one per line."""
    entries = tuple(nodes)
    width = max((len(node.id) for node in entries), default=0)
    lines: list[str] = []
    for title, of_kind in _by_title(entries):
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
        lines = (line for cause in node.causes for line in _cause_lines(cause, 2))
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


def _cause_lines(cause: CauseEntry, indent: int) -> Iterator[str]:
    sentence = f"{cause.sentence} First remedy: {cause.remedy}." if cause.remedy else cause.sentence
    yield " " * indent + f"{cause.name}: {sentence}"
    for member in cause.members:
        yield from _cause_lines(member, indent + 2)


def _wrapped(text: str, indent: int = 0) -> str:
    space = " " * indent
    return "\n\n".join(
        textwrap.fill(paragraph, TEXT_WIDTH, initial_indent=space, subsequent_indent=space)
        for paragraph in text.split("\n\n")
    )


_LANGUAGE = frozenset(node.declaration.id for node in NODES)
_HEAD = (
    "# Nodes",
    "All nodes of a mission: each node with its ports, its children, and the causes with which it "
    "may fail. This page is written by `make docs` from the declarations in the code; `picktree nodes NAME` "
    "shows the same in a terminal, also of plug-ins' nodes and of a mission's sub-trees (`--mission FILE`).",
    "A node is a mapping with one key, its ID, and its ports below: `GoTo: {pose: home}`. One that needs no "
    "port may be written as the bare ID: `GoTo`. Children are a list below the node, or at `do:` where it "
    "has ports as well; a single child needs no list: `Inverter: {Condition: {if: holding}}`. "
    'A value is a literal, or a reference to a key of the blackboard: `"{item}"`, or to an attribute of the '
    'object whose id is there: `"{item.colour}"`.',
)


def markdown(nodes: Iterable[NodeEntry], causes: Iterable[Cause]) -> str:
    """Return the whole reference as Markdown."""
    entries = tuple(nodes)
    lines = ["\n\n".join(_HEAD), ""]
    for title, of_kind in _by_title(entries):
        lines += [f"**{title}**: " + ", ".join(f"[{n.id}](#{n.id.lower()})" for n in of_kind), ""]
    lines += ["## Every node", "", "Keys of every node, sub-trees included.", ""]
    lines += ["| key | meaning |", "|---|---|"]
    lines += [f"| `{key}` | {_cell(doc)} |" for key, doc in COMMON_DOCS.items()]
    for title, of_kind in _by_title(entries):
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
        yield from (_port_row(port) for port in node.ports)
    if node.slots:
        yield ""
        yield "| children | are | what they do |"
        yield "|---|---|---|"
        yield from (_slot_row(slot) for slot in node.slots)
    if node.rule:
        yield ""
        yield node.rule
    if node.causes:
        yield ""
        yield "Fails with " + listed([_linked(cause) for cause in node.causes]) + "."
    sentences = [f"Uses {listed(list(node.uses))}."] if node.uses else []
    sentences += [node.hand_after] if node.hand_after else []
    sentences += [node.limit] if node.limit else []
    if sentences:
        yield ""
        yield " ".join(sentences)
    if node.example:
        yield ""
        yield "```yaml"
        yield node.example
        yield "```"


def _port_row(port: PortEntry) -> str:
    takes = port.type if not port.choices else "one of " + ", ".join(f"`{choice}`" for choice in port.choices)
    takes = "; ".join(filter(None, (takes, port.bounds, port.may_use)))
    default = "*required*" if port.required else "*output*" if port.direction == "out" else port.default
    return f"| `{port.key}` | {_cell(takes)} | {_cell(default)} | {_cell(port.doc)} |"


def _slot_row(slot: SlotEntry) -> str:
    form = slot.form if slot.required else f"{slot.form}; may be left out"
    return f"| `{slot.key}` | {_cell(form)} | {_cell(slot.doc)} |"


def _linked(cause: CauseEntry) -> str:
    family = cause.name.split(".")[0]
    return f"[`{cause.name}`](#family-{family})"


def _causes(causes: Iterable[CauseEntry]) -> Iterator[str]:
    yield (
        "Causes of failures. A cause may be a key under `when:` of a [Recover](#recover); so may its family, "
        "as `grasp.*`, and `*` for all but `internal.error`."
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
