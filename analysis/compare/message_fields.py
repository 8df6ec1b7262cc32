"""Fields of messages: the first difference of two messages of one topic, and values and names as short
text."""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass
from typing import Any, cast

import orjson

from ...logs.schema.topics import message_class

MAX_TEXT_LENGTH = 90
"""Maximum number of characters; longer texts are cut."""


def value_text(value: object) -> str:
    """Return a value as JSON text, cut when it is long; numbers with six digits; a dash for None.

    >>> value_text({"width": 0.0312345678, "held": True})
    '{"width": 0.0312346, "held": true}'
    """
    if value is None:
        return "–"
    if isinstance(value, str):
        return _shortened(value)
    return _shortened(json.dumps(_rounded(value), ensure_ascii=False, default=str))


def _rounded(value: object) -> object:
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, list):
        return [_rounded(one) for one in cast("list[object]", value)]
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in cast("dict[str, object]", value).items()}
    return value


def _shortened(text: str) -> str:
    return text if len(text) <= MAX_TEXT_LENGTH else f"{text[: MAX_TEXT_LENGTH - 1]}…"


NAME_FIELDS = ("path", "id", "name", "child_frame_id", "key", "object", "kind")
"""Fields that name an element of a list, the best first."""


@dataclass(frozen=True, slots=True)
class FieldDifference:
    path: str
    """Path of the field, such as `nodes[3].status`; empty when the values as a whole differ."""
    of: str
    """Name of the innermost list element around the field, when it has one."""
    a: object
    """Value in A; None where there is no such field or element."""
    b: object


def first_differing_field(schema: str, a: bytes, b: bytes) -> FieldDifference | None:
    """Return the first field in which two messages of a schema differ, in the order of A's fields.

    None when the values are equal and only the bytes differ. Undecodable bytes differ as a whole.

    >>> first_differing_field("picktree.Wrench", b'{"force": {"x": 1.0}}', b'{"force": {"x": 1.5}}')
    FieldDifference(path='force.x', of='', a=1.0, b=1.5)
    """
    from google.protobuf.message import DecodeError

    try:
        return first_difference_in_values(_values(schema, a), _values(schema, b))
    except (ValueError, DecodeError):
        return FieldDifference("", "", f"{len(a)} bytes", f"{len(b)} bytes")


def decode_message(schema: str, data: bytes) -> object:
    """Decode a message into JSON values; None when it is unreadable."""
    from google.protobuf.message import DecodeError

    try:
        values: object = _values(schema, data)
    except (ValueError, DecodeError):
        return None
    return values


def first_difference_in_values(a: object, b: object, path: str = "", of: str = "") -> FieldDifference | None:
    """Return the first difference of two JSON values, in the order of A's fields; None when they are equal.

    >>> a, b = {"nodes": [{"path": "Main", "status": "RUNNING"}]}, {"nodes": [{"path": "Main"}]}
    >>> first_difference_in_values(a, b)
    FieldDifference(path='nodes[0].status', of='Main', a='RUNNING', b=None)
    """
    if isinstance(a, dict) and isinstance(b, dict):
        ours, theirs = cast("dict[str, object]", a), cast("dict[str, object]", b)
        for key in dict.fromkeys((*ours, *theirs)):
            found = first_difference_in_values(
                ours.get(key), theirs.get(key), f"{path}.{key}" if path else key, of
            )
            if found is not None:
                return found
        return None
    if isinstance(a, list) and isinstance(b, list):
        ones, others = cast("list[object]", a), cast("list[object]", b)
        for n in range(max(len(ones), len(others))):
            one, other = (some[n] if n < len(some) else None for some in (ones, others))
            found = first_difference_in_values(one, other, f"{path}[{n}]", _name(one) or _name(other) or of)
            if found is not None:
                return found
        return None
    if isinstance(a, str) and isinstance(b, str) and a != b and a[:1] == b[:1] == "{":
        return _first_difference_in_text(a, b, path, of)
    if a == b and type(cast("object", a)) is type(cast("object", b)):
        return None
    return FieldDifference(path, of, cast("object", a), cast("object", b))


def _first_difference_in_text(a: str, b: str, path: str, of: str) -> FieldDifference | None:
    """Compare two texts that are JSON themselves, as the records in an entity's metadata."""
    try:
        found = first_difference_in_values(orjson.loads(a), orjson.loads(b), path, of)
    except ValueError:
        found = None
    return found or FieldDifference(path, of, a, b)


def _name(element: object) -> str:
    if not isinstance(element, dict):
        return ""
    fields = cast("dict[str, object]", element)
    return next((str(fields[name]) for name in NAME_FIELDS if isinstance(fields.get(name), str)), "")


def _values(schema: str, data: bytes) -> Any:
    """Decode a message into JSON values, with length and check sum for bytes.

    Raises ValueError or DecodeError for data that is no message of the schema.
    """
    from google.protobuf.json_format import MessageToDict

    kind = message_class(schema)
    if kind is None:
        return orjson.loads(data)
    message = kind.FromString(data)
    values = MessageToDict(
        message, preserving_proto_field_name=True, always_print_fields_with_no_presence=True
    )
    for field in kind.DESCRIPTOR.fields:
        if field.type == field.TYPE_BYTES:
            held: bytes = getattr(message, field.name)
            values[field.name] = f"{len(held)} bytes, CRC-32 {zlib.crc32(held):08x}"
    return values
