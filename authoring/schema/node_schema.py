"""Schema of a node: its ports, all forms of its children, its documentation."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ...trees.declaration import (
    AUTOREMAP,
    BREAKPOINT,
    COMMON_KEYS,
    POSTCONDITIONS,
    PRECONDITIONS,
    NodeDeclaration,
)
from ...trees.ports import PortDeclaration, SlotDeclaration
from ...world.causes import Cause
from .node_reference import RequiredOneOf
from .port_schema import ProposedNames, port_schema
from .port_wording import COMMON_DOCS, hand_words, unwrapped, uses_words
from .schema_parts import ID_PATTERN, NAME_PATTERN, Schema, escaped, if_bare, one_needed, ref, schemas

_END = r"(?![\s\S])"
_WORD = "[A-Za-z0-9_]*"


@dataclass(frozen=True, slots=True)
class NodeIds:
    """IDs of nodes and sub-trees. `closed`: there are no others; else a plain ID may be another sub-tree."""

    nodes: tuple[str, ...]
    trees: tuple[str, ...] = ()
    needing: tuple[str, ...] = ()
    """IDs that need a port or a child, so that the bare ID is invalid."""
    closed: bool = False

    def properties(self) -> dict[str, Schema]:
        """Return the schema of each node's body by ID."""
        found = {name: ref(f"node.{name}") for name in self.nodes}
        return found | {name: ref(f"tree.{name}") for name in self.trees}

    def single(self) -> Schema:
        """Return the schema of one node: a mapping with its ID as the only key, or the bare ID."""
        found: Schema = {
            "title": "node",
            "type": ["object", "string"],
            "properties": self.properties(),
            # Next to the properties, a count would keep language servers from proposing any in an empty line.
            "allOf": [if_bare(), {"minProperties": 1, "maxProperties": 1}],
        }
        return found | self.others()

    def others(self) -> Schema:
        """Return the rule for other keys of a mapping that holds a node."""
        if self.closed:
            return {"additionalProperties": False}
        names = {"pattern": ID_PATTERN, "patternErrorMessage": "this is no ID of a node or a sub-tree"}
        return {"propertyNames": names, "additionalProperties": ref("unknown")}

    def bare(self) -> Schema:
        """Return the rule for a bare ID: those that are valid without a body."""
        if self.closed:
            alone = [name for name in (*self.nodes, *self.trees) if name not in self.needing]
            pattern = f"^(?:{'|'.join(map(escaped, alone))}){_END}"
        elif self.needing:
            pattern = f"^(?!(?:{'|'.join(map(escaped, self.needing))}){_END})[A-Za-z_]{_WORD}{_END}"
        else:
            pattern = ID_PATTERN
        said = "no node of this name can stand without ports or children"
        return {"pattern": pattern, "patternErrorMessage": said}

    def only_child(self, owner: str, keys: list[str]) -> Schema:
        """Return the rule for a mapping without `do`, in which a key other than the owner's `keys` is the
        child.

        An unknown key in lower case may be a sub-tree, unless another key names the child.
        """
        said = f"{owner} has no such port, and there is no such node"
        own = "|".join(map(escaped, keys))
        ids = (*self.nodes, *self.trees)
        if self.closed:
            known = "|".join(map(escaped, (*keys, *ids)))
            return {"propertyNames": {"pattern": f"^(?:{known}){_END}", "patternErrorMessage": said}}
        child = "|".join((f"[A-Z]{_WORD}", *(escaped(name) for name in ids if not "A" <= name[0] <= "Z")))
        not_own = f"(?!(?:{own}){_END})"
        return {
            "if": {"propertyNames": {"not": {"pattern": f"^{not_own}(?:{child}){_END}"}}},
            "then": {
                "patternProperties": {
                    f"^{not_own}": {"type": ["object", "array", "string", "null"], "errorMessage": said}
                }
            },
            "else": {"propertyNames": {"pattern": f"^(?:{own}|{child}){_END}", "patternErrorMessage": said}},
        }


def common_definitions() -> dict[str, Schema]:
    """Return the definitions of the keys that every node may have."""
    forms: dict[str, Schema] = {
        "name": {
            "type": ["string", "null"],
            "pattern": NAME_PATTERN,
            "patternErrorMessage": "a name is a text without '/' and '#', 60 characters at most",
        },
        BREAKPOINT: {"enum": ["before", "after"]},
    }
    forms |= {key: {"type": ["string", "boolean"]} for key in PRECONDITIONS}
    forms |= {key: {"type": "string", "minLength": 1} for key in POSTCONDITIONS}
    return {
        f"key.{key}": forms[key] | {"description": doc.replace("`", ""), "markdownDescription": doc}
        for key, doc in COMMON_DOCS.items()
    }


def common_properties() -> dict[str, Schema]:
    return {key: ref(f"key.{key}") for key in COMMON_KEYS}


def node_schema(
    node: NodeDeclaration, needed: RequiredOneOf | None, ids: NodeIds, known: ProposedNames
) -> Schema:
    """Return the schema of a node's body."""
    main = node.slot("do")
    properties: dict[str, Schema] = {port.key: port_schema(port, known) for port in node.ports}
    properties |= {slot.key: slot_schema(slot) for slot in node.slots}
    properties |= common_properties()
    if main is not None and main.least <= 1:
        properties = ids.properties() | properties
    required = [p.key for p in node.ports if p.required]
    required += [s.key for s in node.slots if s.required and s is not main]
    found: Schema = {
        "title": node.id,
        "description": unwrapped(node.doc),
        "markdownDescription": node_markdown(node),
        "properties": properties,
    }
    ported = bool(required) or needed is not None
    if main is not None:
        found |= _with_main(node, main, ids, ported=ported)
    else:
        found |= {"additionalProperties": False, "type": ["object"] if ported else ["object", "null"]}
    if needed is not None:
        also = one_needed(needed.keys, f"{node.id}: {needed.sentence}")
        found |= {"allOf": [*schemas(found.get("allOf")), also]}
    return found | ({"required": required} if required else {})


_AUTOREMAP_DOC = "true: keys and ports of the sub-tree that this call does not name are the caller's keys."


def tree_schema(name: str, ports: tuple[PortDeclaration, ...], known: ProposedNames, doc: str = "") -> Schema:
    """Return the schema of the body of a sub-tree's call; `doc`: what the tree says of itself."""
    ports = tuple(port for port in ports if not port.remapped)
    required = [p.key for p in ports if p.required]
    properties: dict[str, Schema] = {port.key: port_schema(port, known) for port in ports}
    properties[AUTOREMAP] = {"type": "boolean", "description": _AUTOREMAP_DOC}
    return {
        "title": name,
        "description": doc or f"The sub-tree {name} of this mission.",
        "type": ["object"] if required else ["object", "null"],
        "properties": properties | common_properties(),
        "additionalProperties": False,
        **({"anyOf": [{"required": required}, {"required": [AUTOREMAP]}]} if required else {}),
    }


def needs_body(node: NodeDeclaration, needed: RequiredOneOf | None) -> bool:
    """Whether a bare ID is invalid."""
    keys = (*node.ports, *node.slots)
    return needed is not None or any(key.required for key in keys)


def slot_schema(slot: SlotDeclaration) -> Schema:
    """Return the schema of a slot: a node, a list of nodes, or a table of nodes."""
    said: Schema = {"description": slot.doc}
    most: Schema = {"maxItems": slot.most} if slot.most is not None else {}
    match slot.arity:
        case "one":
            return {"allOf": [ref("child")]} | said
        case "many" if slot.least > 1:
            return {"type": "array", "items": ref("node"), "minItems": slot.least} | most | said
        case "many":
            return {"allOf": [ref("child")]} | most | said
        case "table" if slot.of == "cause":
            return {"allOf": [ref("causes")]} | said
        case "table":
            return {
                "type": "object",
                "minProperties": 1,
                "propertyNames": {"pattern": NAME_PATTERN},
                "additionalProperties": ref("child"),
            } | said


def node_markdown(node: NodeDeclaration) -> str:
    """Return the text shown when the pointer is over the node."""
    parts = [unwrapped(node.doc)]
    if node.causes:
        parts.append("Fails with " + ", ".join(_cause(cause.name, cause) for cause in node.causes) + ".")
    if node.uses:
        parts.append(f"Uses {uses_words(node)}.")
    if hand_words(node):
        parts.append(hand_words(node))
    return "\n\n".join(parts)


def _cause(name: str, cause: object) -> str:
    return f"`{name}`" if isinstance(cause, Cause) else f"`{name}.*`"


def _with_main(node: NodeDeclaration, main: SlotDeclaration, ids: NodeIds, *, ported: bool) -> Schema:
    """Return the forms of the children: under `do`, as a list, or as the single key that is a node.

    ported: some port is required, so that the children cannot replace the body.
    """
    types = ["object"]
    found: Schema = {"type": types}
    if not ported:
        # A list or a bare ID is the value of `do`, without ports.
        types.append("array")
        found |= {"items": ref("node"), "minItems": max(main.least, 1)}
        if main.arity == "many" and main.most is not None:
            found["maxItems"] = main.most
        if main.least <= 1:
            types.append("string")
            found["allOf"] = [if_bare()]
        if not main.required:
            types.append("null")
    keys = [*(p.key for p in node.ports), *(s.key for s in node.slots), *COMMON_KEYS]
    nothing_else: Schema = {"propertyNames": {"enum": keys, "errorMessage": f"{node.id} has no such port"}}
    found |= {
        "if": {"propertyNames": {"enum": keys}},
        "then": {"required": ["do"]} if main.required else {},
        "else": nothing_else,
    }
    if main.least <= 1:
        found["else"] = {
            "if": {"required": ["do"]},
            "then": nothing_else,
            "else": ids.only_child(node.id, keys),
        }
    return found


def bare_docs(nodes: Iterable[NodeDeclaration]) -> Schema:
    """Return the texts shown when the pointer is over a bare ID."""
    return {
        "allOf": [
            {"if": {"const": node.id}, "then": {"title": node.id, "markdownDescription": node_markdown(node)}}
            for node in nodes
        ]
    }
