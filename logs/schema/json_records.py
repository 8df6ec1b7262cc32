"""JSON encoding of records, and the JSON Schemas with which a viewer offers their fields.

Record of the arithmetic that a run was computed with: libraries, their kernels, and a probe computation.

Processes whose records agree give the same run for the same seed, as far as a probe can show it. It
is metadata of the log, outside of the digest. `arithmetic_probe` makes the one of this process.
"""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any, Final, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import orjson

if TYPE_CHECKING:
    from pydantic import TypeAdapter


PREFIXES: Final = ("version of ", "kernels of ", "probe of ", "departure of ")
"""Prefixes of a flat table's entries, in the order of the fields."""


def _no_words() -> dict[str, str]:
    return {}


@dataclass(frozen=True)
class Arithmetic:
    """Properties that decide about the last bit of a floating-point number; empty where they were not
    recorded."""

    versions: Mapping[str, str] = field(default_factory=_no_words)
    """Version of each library that computes, of glibc and of Python."""
    kernels: Mapping[str, str] = field(default_factory=_no_words)
    """Kernels in use by library."""
    probe: Mapping[str, str] = field(default_factory=_no_words)
    """Fingerprint of a small computation with each library."""
    departures: Mapping[str, str] = field(default_factory=_no_words)
    """Reason why a library computed with other kernels than in every other process, by library."""

    def __bool__(self) -> bool:
        return bool(self.versions)

    def words(self) -> dict[str, str]:
        """Return the record as a flat table, for metadata and tables of results."""
        return {
            prefix + name: value
            for prefix, part in zip(PREFIXES, self._parts, strict=True)
            for name, value in part.items()
        }

    @property
    def _parts(self) -> tuple[Mapping[str, str], ...]:
        return self.versions, self.kernels, self.probe, self.departures

    @classmethod
    def from_words(cls, words: Mapping[str, str]) -> Arithmetic:
        """Parse a flat table made by `words`; other entries of the table are ignored."""
        return cls(*({k.removeprefix(p): v for k, v in words.items() if k.startswith(p)} for p in PREFIXES))


def arithmetic_difference(recorded: Arithmetic, now: Arithmetic, where: str = "here") -> str:
    """Return a sentence that names what differs between two arithmetics, empty when nothing does.

    `where` says where the second one computes. Other kernels count only where the probe differs, too. A known
    reason for other kernels comes first.
    """
    if not recorded or not now:
        return "arithmetic not recorded: the log is of an older version"
    known = recorded.departures.items() ^ now.departures.items()
    differing = [
        f"{name} {reason}{'' if recorded.departures.get(name) == reason else f' {where}'}"
        for name, reason in sorted(known)
    ]
    differing += _pairs(recorded.versions, now.versions, where)
    # A computation that only another version of picktree probes with says nothing.
    probes = [name for name, digest in recorded.probe.items() if now.probe.get(name, digest) != digest]
    if probes:
        differing += _pairs(recorded.kernels, now.kernels, where)
        if not differing:
            differing = [f"other results of {' and '.join(probes)} {where}"]
    return f"recorded with other arithmetic ({'; '.join(differing)}): the runs may part" if differing else ""


def _pairs(recorded: Mapping[str, str], now: Mapping[str, str], where: str) -> list[str]:
    return [
        f"{name} {value}, {where} {now.get(name, 'none')}"
        for name, value in recorded.items()
        if now.get(name) != value
    ]


R = TypeVar("R")

_SCALARS: dict[object, str] = {
    str: "string",
    int: "integer",
    float: "number",
    bool: "boolean",
    types.NoneType: "null",
}


def encode(record: object) -> bytes:
    """Encode a record as one line of JSON. Raises TypeError for values that JSON cannot express."""
    return orjson.dumps(record, option=orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_NON_STR_KEYS)


def decode(kind: type[R], data: bytes) -> R:
    """Decode a record of that kind. Unknown fields of a younger log are ignored.

    Raises ValueError when a field is missing or has another type.
    """
    record: R = record_adapter(kind).validate_json(data)
    return record


@cache
def record_adapter(kind: type) -> TypeAdapter[Any]:
    """Build the reader of a kind of record, once in a process: it takes milliseconds."""
    from pydantic import TypeAdapter  # needed for reading only, and slow to import

    return TypeAdapter(kind)


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
            "properties": {name: said for name, said in fields.items() if is_viewable(said)},
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


def is_viewable(said: Mapping[str, object]) -> bool:
    """Whether every viewer reads a field of that schema: it has one type, and no list within a list."""
    items = said.get("items")
    if isinstance(items, Mapping):
        inner = cast("Mapping[str, object]", items)
        return inner.get("type", "array") != "array"
    return isinstance(said.get("type"), str)
