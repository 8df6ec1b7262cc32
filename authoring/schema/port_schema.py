"""Schema of a port: literals of its type, references, and its documentation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

from ...trees.ports import NameKind, PortDeclaration, Required
from ...world.journal import Plain
from .port_wording import default_words, expression_words, type_words
from .schema_parts import (
    Schema,
    bounds,
    key_reference,
    quantity,
    reference,
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
    literal = _list(port, known) if port.type.many else _literal(port, known)
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
            unit = "s" if port.unit == "ms" else port.unit
            said = {"patternErrorMessage": f"a {type_words(port)}, or a reference"}
            return quantity(unit, or_reference=True) | said | bounds(port.within)
        case "float":
            return share(or_reference=True) | bounds(port.within)
        case "int":
            return _or_reference("integer", "a whole number, or a reference") | bounds(port.within)
        case "bool":
            return _or_reference("boolean", "true or false, or a reference")
        case "expression":
            return {"type": ["string", "boolean", "number"], "minLength": 1}
        case "any":
            text = text_or_reference()
            return {"pattern": text["pattern"], "patternErrorMessage": text["patternErrorMessage"]}


def _list(port: PortDeclaration, known: ProposedNames) -> Schema:
    item = _item(port, _choices(port, known))
    return reference() | {"type": ["string", "array"], "items": item}


def _item(port: PortDeclaration, choices: Sequence[Plain] | None) -> Schema:
    """Return the schema of a list's element, which is no reference."""
    if choices is not None:
        return {"enum": list(choices)} if choices else {"not": {}}
    match port.type.name:
        case "string" | "object":
            return {"type": "string"}
        case "float" if port.unit:
            unit = "s" if port.unit == "ms" else port.unit
            return quantity(unit) | bounds(port.within)
        case "float":
            return share() | bounds(port.within)
        case "int":
            return {"type": "integer"} | bounds(port.within)
        case "bool":
            return {"type": "boolean"}
        case "expression":
            return {"type": ["string", "boolean", "number"]}
        case "any":
            return {}


def _or_reference(kind: str, said: str) -> Schema:
    """Return the schema of a value other than a text; a text is then a reference."""
    return reference() | {"type": ["string", kind], "patternErrorMessage": said}


def _choices(port: PortDeclaration, known: ProposedNames) -> Sequence[Plain] | None:
    if port.choices is not None:
        return port.choices
    if port.names is not None and known.all and port.names in known.names:
        return known.names[port.names]
    return None
