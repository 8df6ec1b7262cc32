"""Conversion of pydantic's schemas (draft 2020-12) to draft-07, which editors support best."""

from __future__ import annotations

from typing import cast

from ...files.quantities import example
from .schema_parts import Schema, quantity_pattern, ref

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
        said = f'in {unit}, or with a unit, as "{example(unit)}"' if unit else f"as {example(unit)}"
        found |= {"pattern": quantity_pattern(unit), "patternErrorMessage": f"a number {said}"}
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
