"""Entries of the node reference: the single source of the terminal's page, of JSON, and of docs/nodes.md."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from itertools import chain, combinations
from typing import Final

from ...trees.declaration import Kind, NodeDeclaration
from ...trees.node import Node
from ...trees.port_types import PortValues
from ...trees.ports import PortDeclaration, Required, SlotDeclaration
from ...trees.skill import Skill
from ...world.causes import Cause
from ...world.journal import Plain
from .port_wording import default_words, expression_words, hand_words, type_words, unwrapped

_MAX_COMBINED_KEYS = 10
"""Maximum number of a node's optional keys whose combinations are all tried."""


@dataclass(frozen=True, slots=True)
class RequiredOneOf:
    """Keys of which the node needs at least one; `sentence` is its error message without any."""

    keys: tuple[str, ...]
    sentence: str


def required_one_of(node: type[Node]) -> RequiredOneOf | None:
    """Return the keys of which the node needs one, by its own check; None when there are none."""
    declaration = node.declaration
    every = (*declaration.ports, *declaration.slots)
    required = [part.key for part in every if part.required]
    optional = [part.key for part in every if not part.required]
    sentence = _key_error(node, required)
    if not sentence or len(optional) > _MAX_COMBINED_KEYS:
        return None
    cures = tuple(key for key in optional if not _key_error(node, (*required, key)))
    others = [key for key in optional if key not in cures]
    if cures and all(_key_error(node, (*required, *some)) for some in _subsets(others)):
        return RequiredOneOf(cures, sentence)
    return None


def _key_error(node: type[Node], keys: Collection[str]) -> str:
    """Return the node's error when just these keys are given; empty when there is none."""
    found = node.check_ports(PortValues(frozenset(keys)))
    return next((wrong for wrong in found if isinstance(wrong, str)), "")


def _subsets(keys: list[str]) -> Iterable[tuple[str, ...]]:
    return chain.from_iterable(combinations(keys, size) for size in range(len(keys) + 1))


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
    """One input or output."""

    key: str
    direction: str
    """Direction: "in" or "out"."""
    type: str
    """Type in words: `number in N, or as "20 N"`."""
    doc: str
    required: bool
    default: str
    """Default as a file writes it; empty when there is none."""
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
    """One node."""

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
    """Sentence about the simulated time limit; empty when there is none."""
    rule: str
    """Rule that relates several keys; empty when there is none."""
    example: str

    @property
    def inputs(self) -> tuple[PortEntry, ...]:
        return tuple(port for port in self.ports if port.direction == "in")

    @property
    def outputs(self) -> tuple[PortEntry, ...]:
        return tuple(port for port in self.ports if port.direction == "out")


def node_entry(node: NodeDeclaration, causes: Iterable[Cause], of: type[Node] | None = None) -> NodeEntry:
    """Return a node's entry. `causes`: all known causes, for families. `of`: its class; None for a
    sub-tree."""
    needed = required_one_of(of) if of is not None else None
    known = tuple(causes)
    doc = unwrapped(node.doc)
    return NodeEntry(
        node.id,
        node.kind,
        _first_sentence(doc),
        doc,
        tuple(_port(port) for port in node.ports),
        tuple(_slot(slot) for slot in node.slots),
        tuple(_cause(cause, known) for cause in node.causes),
        tuple(str(resource.value) for resource in node.uses),
        hand_words(node),
        of.limit_words() if of is not None and issubclass(of, Skill) else "",
        f"{needed.sentence[0].upper()}{needed.sentence[1:]}." if needed else "",
        node.example,
    )


def cause_entry(cause: Cause) -> CauseEntry:
    return CauseEntry(cause.name, cause.sentence, cause.remedy)


def _port(port: PortDeclaration) -> PortEntry:
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


def _slot(slot: SlotDeclaration) -> SlotEntry:
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


def _cause(cause: object, known: tuple[Cause, ...]) -> CauseEntry:
    if isinstance(cause, Cause):
        return cause_entry(cause)
    prefix = f"{cause}".removesuffix("*")
    members = tuple(cause_entry(one) for one in known if one.name.startswith(prefix))
    return CauseEntry(f"{cause}", "any of the family", "", members)


def _first_sentence(doc: str) -> str:
    found = re.match(r".*?[.!?](?=\s|$)", doc)
    return found[0] if found else doc.partition("\n")[0]
