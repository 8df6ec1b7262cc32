"""JSON encoding of records, and the JSON Schemas with which a viewer offers their fields."""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import orjson

R = TypeVar("R")

if TYPE_CHECKING:
    from pydantic import TypeAdapter

# Adapters are slow to make, so there is one for each kind of record.
_adapters: dict[type, TypeAdapter[Any]] = {}

_SCALARS: dict[object, str] = {str: "string", int: "integer", float: "number", bool: "boolean"}


def encode(record: object) -> bytes:
    """Encode a record as one line of JSON. Raises TypeError for values that JSON cannot express."""
    return orjson.dumps(record, option=orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_NON_STR_KEYS)


def decode(kind: type[R], data: bytes) -> R:
    """Decode a record of that kind. Unknown fields of a younger log are ignored.

    Raises ValueError when a field is missing or has another type.
    """
    from pydantic import TypeAdapter  # needed for reading only, and slow to import

    adapter = _adapters.get(kind)
    if adapter is None:
        adapter = _adapters[kind] = TypeAdapter(kind)
    record: R = adapter.validate_json(data)
    return record


def schema(kind: type) -> dict[str, object]:
    """Return the JSON Schema (2020-12) of a dataclass, reduced to the features that viewers understand.

    There are no references, as viewers resolve none. Lichtblick's reader cannot express some fields: any
    value, a list of lists. They are only listed as required, because with their schema the viewer refuses
    the whole topic; see `_sayable`.
    """
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": kind.__name__, **_of(kind)}


def _of(kind: object) -> dict[str, object]:
    if kind in _SCALARS:
        return {"type": _SCALARS[kind]}
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        hints = get_type_hints(kind)
        names = [f.name for f in dataclasses.fields(kind)]
        fields = {name: _of(hints[name]) for name in names}
        return {
            "type": "object",
            "properties": {name: said for name, said in fields.items() if _sayable(said)},
            "required": names,
        }
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is tuple:
        return {"type": "array", "items": _of(arguments[0])}
    if isinstance(origin, type) and issubclass(origin, Mapping):
        # without `properties` viewers refuse it
        free: dict[str, object] = {"type": "object", "properties": {}}
        return free if arguments[1] is object else {**free, "additionalProperties": _of(arguments[1])}
    if origin in (Union, types.UnionType):
        raise TypeError(f"{kind}: a field of the log has one type")
    return {}


def _sayable(said: Mapping[str, object]) -> bool:
    """Whether every viewer reads a field of that schema: it has a type, and no list within a list."""
    items = said.get("items")
    if isinstance(items, Mapping):
        inner = cast("Mapping[str, object]", items)
        return inner.get("type", "array") != "array"
    return "type" in said
