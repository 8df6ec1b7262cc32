"""JSON Schema of records, reduced to what every viewer reads."""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Mapping
from typing import (
    TYPE_CHECKING,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

if TYPE_CHECKING:
    pass


_SCALARS: dict[object, str] = {
    str: "string",
    int: "integer",
    float: "number",
    bool: "boolean",
    types.NoneType: "null",
}


def schema(kind: type) -> dict[str, object]:
    """Return the JSON Schema (2020-12) of a dataclass, reduced to the features that viewers understand.

    There are no references, as viewers resolve none. Lichtblick's reader cannot express some fields: any
    value, a list of lists. They are only listed as required, because with their schema the viewer refuses
    the whole topic; see `is_viewable`.
    """
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": kind.__name__,
        **value_schema(kind),
    }


def value_schema(kind: object) -> dict[str, object]:
    """Return the JSON Schema of a value of that type; empty for a type of any value."""
    if kind in _SCALARS:
        return {"type": _SCALARS[kind]}
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        hints = get_type_hints(kind)
        names = [f.name for f in dataclasses.fields(kind)]
        fields = {name: value_schema(hints[name]) for name in names}
        return {
            "type": "object",
            "properties": {
                name: field_schema for name, field_schema in fields.items() if is_viewable(field_schema)
            },
            "required": names,
        }
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is tuple:
        return {"type": "array", "items": value_schema(arguments[0])}
    if isinstance(origin, type) and issubclass(origin, Mapping):
        # without `properties` viewers refuse it
        free: dict[str, object] = {"type": "object", "properties": {}}
        return (
            free if arguments[1] is object else {**free, "additionalProperties": value_schema(arguments[1])}
        )
    if origin in (Union, types.UnionType):
        arms = [value_schema(each) for each in arguments]
        if all(arm.keys() == {"type"} for arm in arms):
            return {"type": [arm["type"] for arm in arms]}
        return {"anyOf": arms} if all(arms) else {}
    return {}


def is_viewable(field_schema: Mapping[str, object]) -> bool:
    """Whether every viewer reads a field of that schema: it has one type, and no list within a list."""
    items = field_schema.get("items")
    if isinstance(items, Mapping):
        inner = cast("Mapping[str, object]", items)
        return inner.get("type", "array") != "array"
    return isinstance(field_schema.get("type"), str)
