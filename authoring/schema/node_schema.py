"""Schema of a node: its ports with literals and references, all forms of its children, its documentation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

from picktree.trees import (
    AUTOREMAP,
    BREAKPOINT,
    COMMON_KEYS,
    POSTCONDITIONS,
    PRECONDITIONS,
    NameKind,
    NodeDeclaration,
    PortDeclaration,
    Required,
    SlotDeclaration,
)
from picktree.world import Cause, Plain

from .node_reference import (
    COMMON_DOCS,
    RequiredOneOf,
    default_words,
    expression_words,
    hand_words,
    type_words,
    unwrapped,
    uses_words,
)
from .schema_parts import (
    ID_PATTERN,
    NAME_PATTERN,
    Schema,
    bounds,
    escaped,
    if_bare,
    key_reference,
    one_needed,
    quantity,
    ref,
    reference,
    schemas,
    share,
    text_or_reference,
)

_EXAMPLES: dict[str, list[str]] = {"object": ["{item}"], "bin": ["{item.destination}"]}
"""Common values by type of port, or by kind of name."""


@dataclass(frozen=True, slots=True)
class ProposedNames:
    """Names of cameras, poses and bins: all of the mission's scene and robot (`all`), or proposals."""

    names: Mapping[NameKind, tuple[str, ...]] = field(default_factory=dict[NameKind, tuple[str, ...]])
    all: bool = False


def port_schema(port: PortDeclaration, known: ProposedNames) -> Schema:
    """Return the schema of a port of a node or of a sub-tree."""
    described: Schema = {"description": port.doc} if port.doc else {}
    described["markdownDescription"] = port_markdown(port)
    if port.direction == "out":
        return key_reference() | {"examples": ["{" + port.key + "}"]} | described
    found = _input(port, known) | described
    if not isinstance(port.default, Required) and port.default not in (None, "", []):
        # Next to the type, language servers would insert the default whenever the node is chosen.
        found["allOf"] = [{"default": port.default}]
    return found


def port_markdown(port: PortDeclaration) -> str:
    """Return the text shown when the pointer is over the port."""
    facts = [type_words(port), port.within.words(), expression_words(port)]
    if port.direction == "out":
        facts = [f"output: {type_words(port)}", 'a key of the blackboard, as "{key}"']
    elif port.required:
        facts.append("required")
    else:
        facts.append(f"default: {default_words(port)}")
    line = "; ".join(filter(None, facts))
    return f"{port.doc}\n\n*{line}*" if port.doc else f"*{line}*"


def _input(port: PortDeclaration, known: ProposedNames) -> Schema:
    kind = port.type.name
    if port.type.many:
        literal = reference() | {"type": ["string", "array"], "items": _item(port, _choices(port, known))}
    else:
        literal = _literal(port, known)
    if "anyOf" in literal:
        return literal
    if port.type.optional and "type" in literal:
        types = literal["type"]
        literal["type"] = [*(cast("list[str]", types) if isinstance(types, list) else [types]), "null"]
    examples = [] if port.type.many else [*_EXAMPLES.get(port.names or kind, [])]
    if port.names is not None:
        examples += known.names.get(port.names, ())
    return literal | ({"examples": examples} if examples else {})


def _literal(port: PortDeclaration, known: ProposedNames) -> Schema:
    """Return the schema of a literal, or of a reference in its place."""
    if port.takes in ("key", "assignments"):
        return reference() if port.takes == "key" else {"type": "string", "minLength": 1}
    choices = _choices(port, known)
    if choices is not None:
        usual: Schema = {"examples": _EXAMPLES[port.names]} if port.names in _EXAMPLES else {}
        # An enum must not be empty, as in a scene without holes.
        named: list[Schema] = [{"enum": list(choices)}] if choices else []
        alternatives: list[Schema] = [
            *named,
            reference() | usual | {"description": "a reference to the blackboard"},
        ]
        if port.default == "":
            alternatives.append({"type": "string", "maxLength": 0})
        return {"anyOf": [*alternatives, {"type": "null"}] if port.type.optional else alternatives}
    match port.type.name:
        case "string" | "object":
            return text_or_reference()
        case "float" if port.unit:
            return _number(port, or_reference=True) | {
                "patternErrorMessage": f"a {type_words(port)}, or a reference"
            }
        case "float":
            return _number(port, or_reference=True)
        case "int":
            return _or_reference("integer", "a whole number, or a reference") | bounds(port.within)
        case "bool":
            return _or_reference("boolean", "true or false, or a reference")
        case "expression":
            return {"type": ["string", "boolean", "number"], "minLength": 1}
        case "any":
            text = text_or_reference()
            return {"pattern": text["pattern"], "patternErrorMessage": text["patternErrorMessage"]}


def _item(port: PortDeclaration, choices: Sequence[Plain] | None) -> Schema:
    """Return the schema of a list's element, which is no reference."""
    if choices is not None:
        return {"enum": list(choices)} if choices else {"not": {}}
    match port.type.name:
        case "string" | "object":
            return {"type": "string"}
        case "float":
            return _number(port)
        case "int":
            return {"type": "integer"} | bounds(port.within)
        case "bool":
            return {"type": "boolean"}
        case "expression":
            return {"type": ["string", "boolean", "number"]}
        case "any":
            return {}


def _number(port: PortDeclaration, *, or_reference: bool = False) -> Schema:
    unit = "s" if port.unit == "ms" else port.unit
    found = quantity(unit, or_reference=or_reference) if unit else share(or_reference=or_reference)
    return found | bounds(port.within)


def _or_reference(kind: str, message: str) -> Schema:
    """Return the schema of a value other than a text; a text is then a reference."""
    return reference() | {"type": ["string", kind], "patternErrorMessage": message}


def _choices(port: PortDeclaration, known: ProposedNames) -> Sequence[Plain] | None:
    if port.choices is not None:
        return port.choices
    if port.names is not None and known.all and port.names in known.names:
        return known.names[port.names]
    return None


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
        names = {"pattern": ID_PATTERN, "patternErrorMessage": "this is not the ID of a node or a sub-tree"}
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
        message = "a node of this name needs ports or children"
        return {"pattern": pattern, "patternErrorMessage": message}

    def only_child(self, owner: str, keys: list[str]) -> Schema:
        """Return the rule for a mapping without `do`, in which a key other than the owner's `keys` is the
        child.

        An unknown key in lower case may be a sub-tree, unless another key names the child.
        """
        message = f"{owner} has no such port, and there is no such node"
        own = "|".join(map(escaped, keys))
        ids = (*self.nodes, *self.trees)
        if self.closed:
            known = "|".join(map(escaped, (*keys, *ids)))
            return {"propertyNames": {"pattern": f"^(?:{known}){_END}", "patternErrorMessage": message}}
        child = "|".join((f"[A-Z]{_WORD}", *(escaped(name) for name in ids if not "A" <= name[0] <= "Z")))
        not_own = f"(?!(?:{own}){_END})"
        return {
            "if": {"propertyNames": {"not": {"pattern": f"^{not_own}(?:{child}){_END}"}}},
            "then": {
                "patternProperties": {
                    f"^{not_own}": {"type": ["object", "array", "string", "null"], "errorMessage": message}
                }
            },
            "else": {
                "propertyNames": {"pattern": f"^(?:{own}|{child}){_END}", "patternErrorMessage": message}
            },
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
    """Return the schema of the body of a sub-tree's call; `doc`: the tree's description."""
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
    docs: Schema = {"description": slot.doc}
    most: Schema = {"maxItems": slot.most} if slot.most is not None else {}
    match slot.arity:
        case "one":
            return {"allOf": [ref("child")]} | docs
        case "many" if slot.least > 1:
            return {"type": "array", "items": ref("node"), "minItems": slot.least} | most | docs
        case "many":
            return {"allOf": [ref("child")]} | most | docs
        case "table" if slot.of == "cause":
            return {"allOf": [ref("causes")]} | docs
        case "table":
            return {
                "type": "object",
                "minProperties": 1,
                "propertyNames": {"pattern": NAME_PATTERN},
                "additionalProperties": ref("child"),
            } | docs


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
