"""Parts of schemas, and their form for JSON Schema draft 07."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Final, TypeAlias, cast

from picktree.files import quantities
from picktree.files.yaml import FORMAT, KINDS
from picktree.trees import Range, references

NULL: Schema = {"type": "null"}


def tidy(raw: Schema) -> Schema:
    """Convert to draft-07: numbers with units, null next to a type, no generated titles and defaults."""
    found: Schema = {}
    for key, value in raw.items():
        match key:
            case "title" | "default" | "unit" | "prefixItems":
                pass
            case "$ref":
                found |= ref(model_name(str(value).rpartition("/")[2]))
            case "anyOf" | "oneOf" | "allOf":
                found[key] = [tidy(part) for part in schemas(value)]
            case "items" | "additionalProperties" | "propertyNames" if value not in (True, False):
                found[key] = tidy(schema(value))
            case "patternProperties":
                ((pattern, values),) = schema(value).items()
                found |= {"propertyNames": {"pattern": pattern}, "additionalProperties": tidy(schema(values))}
            case _:
                found[key] = value
    if "prefixItems" in raw:
        found |= _tuple([tidy(part) for part in schemas(raw["prefixItems"])])
    if "unit" in raw:
        unit = str(raw["unit"])
        message = (
            f'in {unit}, or with a unit, as "{quantities.example(unit)}"'
            if unit
            else f"as {quantities.example(unit)}"
        )
        found |= {"pattern": quantity_pattern(unit), "patternErrorMessage": f"a number {message}"}
    return _with_null(found)


def model_name(name: str) -> str:
    """Return a definition's name from that of its model class."""
    return name.removeprefix("_").removesuffix("File")


def schema(value: object) -> Schema:
    """Return a sub-schema, empty for the `true` of "anything"."""
    return dict(cast("Schema", value)) if isinstance(value, dict) else {}


def schemas(value: object) -> list[Schema]:
    return [schema(part) for part in cast("list[object]", value)] if isinstance(value, list) else []


def unless_null(raw: Schema) -> Schema:
    """Return the schema of an optional value without null."""
    parts = schemas(raw.get("anyOf"))
    return parts[0] if len(parts) == 2 and parts[1] == NULL else raw


def _tuple(parts: list[Schema]) -> Schema:
    if all(part == parts[0] for part in parts):
        return {"items": parts[0]}
    return {"items": parts, "additionalItems": False}


def _with_null(found: Schema) -> Schema:
    """Merge `anyOf: [X, null]` into X with one more type or value, where possible."""
    one = unless_null(found)
    if one is found:
        return found
    rest: Schema = {key: value for key, value in found.items() if key != "anyOf"} | one
    if "enum" in one:
        rest.pop("type", None)
        return rest | {"enum": [*cast("list[object]", one["enum"]), None]}
    kinds = one.get("type")
    if kinds is None:
        return found
    names = cast("list[object]", kinds) if isinstance(kinds, list) else [kinds]
    return rest | {"type": [*names, "null"]}


Schema: TypeAlias = dict[str, object]
"""JSON Schema, or a part of one."""

DRAFT: Final = "http://json-schema.org/draft-07/schema#"
_END = r"(?![\s\S])"
"""End of the text: in Python `$` also matches before a last line break."""
_ID = r"[A-Za-z_][A-Za-z0-9_]*"
ID_PATTERN: Final = f"^{_ID}{_END}"
NAME_PATTERN: Final = r"^[^/#\u0000-\u001f]{1,60}" + _END
"""Pattern of a node's name, and of a case."""
REFERENCE: Final = rf"\{{@?{_ID}(?:\.(?:{'|'.join(references.ATTRIBUTES)}))*\}}"
_LITERAL = rf"(?!\{{[\s\S]*\}}{_END})"
"""Pattern of a text that is not in braces."""
_NUMBER = r"\s*[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?\s*"
REFERENCE_RULE: Final = (
    'a reference is "{key}" or "{key.attribute}", the attribute one of '
    + ", ".join(references.ATTRIBUTES)
    + '; an expression is "{= key + 1}"'
)
_READ = rf"(?:{REFERENCE}|\{{=[\s\S]*\S[\s\S]*\}})"
"""Pattern of a text that gives an input a value when the node starts: a reference or an expression."""


def to_text(schema: Schema) -> str:
    """Return the schema as a file's text."""
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def ref(name: str) -> Schema:
    return {"$ref": f"#/definitions/{name}"}


def if_bare() -> Schema:
    """Return the rule that a text is the bare ID of a node.

    It comes first: rules shared by all nodes would give it their title.
    """
    return {"if": {"type": "string"}, "then": ref("bare")}


def header(kind: str) -> dict[str, Schema]:
    """Return the schema of the two keys at the top of every file."""
    return {
        "picktree": {"const": FORMAT, "description": "The version of the format of the file."},
        "kind": {"const": kind, "description": f"Kind of the file: {', '.join(KINDS[:-1])} or {KINDS[-1]}."},
    }


def text_or_reference() -> Schema:
    """Return the schema of any text; in braces only a reference is valid."""
    return {
        "type": "string",
        "pattern": f"^(?:{_READ}{_END}|{_LITERAL})",
        "patternErrorMessage": REFERENCE_RULE,
    }


def reference() -> Schema:
    """Return the schema of a reference, or of an expression in its place."""
    return {"type": "string", "pattern": f"^{_READ}{_END}", "patternErrorMessage": REFERENCE_RULE}


def key_reference() -> Schema:
    """Return the schema of an output's key."""
    return {
        "type": "string",
        "pattern": rf"^\{{{_ID}\}}{_END}",
        "patternErrorMessage": 'an output needs a key to write to, as "{key}"',
    }


def quantity_pattern(unit: str, *, or_reference: bool = False) -> str:
    """Return the pattern of a text that is a number with a unit like `unit`, or a bare number."""
    units = "|".join(map(escaped, quantities.spellings(unit)))
    form = rf"{_NUMBER}(?:{units})?\s*"
    return f"^(?:{form}|{_READ}){_END}" if or_reference else f"^{form}{_END}"


def share(*, or_reference: bool = False) -> Schema:
    """Return the schema of a number without a unit, or of a text in percent."""
    form = rf"{_NUMBER}%\s*"
    return {
        "type": ["string", "number"],
        "pattern": f"^(?:{form}|{_READ}){_END}" if or_reference else f"^{form}{_END}",
        "patternErrorMessage": 'a number, or a share, as "50 %"'
        + (", or a reference" if or_reference else ""),
    }


def quantity(unit: str, *, or_reference: bool = False) -> Schema:
    """Return the schema of a number in `unit`, or of a text with a unit."""
    return {
        "type": ["string", "number"],
        "pattern": quantity_pattern(unit, or_reference=or_reference),
        "patternErrorMessage": f'a number in {unit}, or with a unit, as "{quantities.example(unit)}"',
    }


def bounds(within: Range) -> Schema:
    """Return the bounds of a bare number; a schema cannot check those of a text with a unit."""
    found: Schema = {"minimum": within.least, "maximum": within.most, "exclusiveMinimum": within.above}
    return {key: value for key, value in found.items() if value is not None}


def escaped(text: str) -> str:
    """Return the text as a pattern, in the syntax that Python and JavaScript (flag u) share."""
    return re.sub(r"[\\^$.*+?()\[\]{}|]", r"\\\g<0>", text)


_PRESENT: Schema = {"not": {"type": "null"}}


def exactly_one(keys: Sequence[str]) -> list[Schema]:
    """Return the rules that exactly one of the keys is given; the later ones of several are marked."""
    named = ", ".join(keys)
    too_much: Schema = {"type": "null", "errorMessage": f"only one of {named} may be given"}
    found = [one_needed(keys, f"one of {named} is missing")]
    for n, key in enumerate(keys[:-1]):
        presence: Schema = {"required": [key], "properties": {key: _PRESENT}}
        found.append({"if": presence, "then": {"properties": dict.fromkeys(keys[n + 1 :], too_much)}})
    return found


def one_needed(keys: Sequence[str], sentence: str) -> Schema:
    """Return the rule that at least one of the keys is given; `sentence` is the error."""
    none: Schema = {"not": {"anyOf": [{"required": [key]} for key in keys]}}
    return {"if": none, "then": {"required": [keys[0]], "errorMessage": sentence}}


def belonging(keys: Sequence[str], owner: str, other: str) -> list[Schema]:
    """Return the rule that the keys belong to `owner` and are invalid next to `other`."""
    presence: Schema = {"required": [other], "properties": {other: _PRESENT}}
    wrong: Schema = {key: {"type": "null", "errorMessage": f"'{key}' belongs to '{owner}'"} for key in keys}
    return [{"if": presence, "then": {"properties": wrong}}]
