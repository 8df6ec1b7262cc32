"""Schema of patch files, which are merged into another file of their kind: nothing is required, null
removes."""

from __future__ import annotations

from typing import cast

from .schema_parts import NULL, Schema, ref, schema, schemas


def patch(full: Schema) -> Schema:
    """Return the schema of a patch for values with the schema `full` (RFC 7396).

    Lists are replaced as a whole, so their content is not partial.
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
                # Rules over several keys hold for the merged whole only.
                parts = [patch(part) for part in schemas(value) if "if" not in part]
                found |= {key: parts} if parts else {}
            case "markdownDescription":
                # The base scene may supply a required key.
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
