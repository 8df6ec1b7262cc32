"""Files that are laid on another of their kind: nothing in them is required, and null takes away."""

from __future__ import annotations

from typing import cast

from .draft_07 import NULL, schema, schemas
from .schema_parts import Schema, ref


def patch(full: Schema) -> Schema:
    """The schema of what may be laid on something of which `full` is the schema (RFC 7396).

    Lists replace as a whole, so what stands in them is not partial.
    """
    found: Schema = {}
    for key, value in full.items():
        match key:
            case "required" | "minProperties":
                pass
            case "$ref":
                name = str(value).rpartition("/")[2]
                return {"anyOf": [ref(patched(name)), NULL]}
            case "properties":
                found[key] = {name: patch(schema(part)) for name, part in schema(value).items()}
            case "additionalProperties" if value not in (True, False):
                found[key] = patch(schema(value))
            case "anyOf" | "allOf":
                # What keys have to do with one another can be said of the whole only.
                parts = [patch(part) for part in schemas(value) if "if" not in part]
                found |= {key: parts} if parts else {}
            case "markdownDescription":
                # What a scene requires, its base may have given.
                found[key] = str(value).replace("; required*", "*").replace("\n\n*required*", "")
            case "type":
                found[key] = _with_null(value)
            case "enum" if isinstance(value, list):
                found[key] = [*value, *([] if None in value else [None])]
            case _:
                found[key] = value
    return found


def patched(name: str) -> str:
    return f"{name}Patch"


def _with_null(kinds: object) -> list[object]:
    names: list[object] = [*cast("list[object]", kinds)] if isinstance(kinds, list) else [kinds]
    return names if "null" in names else [*names, "null"]
