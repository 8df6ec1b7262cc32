"""Sources of a key's value, what is known of it before anything runs, and whether it fits an input."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final, cast

from ..files.expressions.type_inference import (
    ANY,
    BOOL,
    FLOAT,
    INT,
    OBJECT,
    TEXT,
    ValueType,
    list_of,
    type_of_value,
)
from ..files.marks import Mark
from ..world.journal import Plain
from .port_types import accept_value
from .ports import NameKind, PortDeclaration

MAX_SOURCES: Final = 40
"""Greatest number of sources of one key; nothing is known of the others."""


@dataclass(frozen=True, slots=True)
class ValueSource:
    """One way in which a key gets its value."""

    type: ValueType
    mark: Mark
    """Where the text says so."""
    writer: str = ""
    """Path of the node that writes it; empty for an input of the tree."""
    unit: str | None = None
    values: tuple[Plain, ...] | None = None
    """All that it can be, when that is known;"""
    certain: bool = False
    """whether it will be each of them at some time, as a literal is."""
    names: NameKind | None = None
    """Kind of thing in scene or robot that it names."""
    port: str | None = None
    """The input of the tree through which it comes in as it is,"""
    depth: int = 0
    """or of which it is an element, so many lists deep."""

    def told(self, file: str) -> str:
        """Where it comes from, for a reader of that file."""
        place = self.mark.told(file)
        if self.writer:
            return f"{self.writer} writes it, {place}"
        return f"the tree's input {self.port!r}, {place}" if self.port else place

    def elements(self) -> ValueSource:
        """Return the source of the elements of this list."""
        inner = self.type.element if self.type.kind == "list" and self.type.element else ANY
        values = None if self.values is None else _flat(self.values)
        return replace(self, type=inner, values=values, depth=self.depth + 1 if self.port else 0)


def _flat(values: Iterable[Plain]) -> tuple[Plain, ...]:
    return tuple(item for value in values if isinstance(value, list) for item in value)


def constant(value: object, mark: Mark, writer: str = "") -> ValueSource:
    """A literal, or a default."""
    return ValueSource(type_of_value(value), mark, writer, values=(cast("Plain", value),), certain=True)


def unknown(mark: Mark, writer: str = "") -> ValueSource:
    return ValueSource(ANY, mark, writer)


def declared(port: PortDeclaration, mark: Mark, writer: str = "") -> ValueSource:
    """Return the source that an output, or a tree's input, declares."""
    values = None if port.type.many else port.choices
    return ValueSource(type_of_port(port), mark, writer, port.unit, values, names=port.names)


_TYPES: Mapping[str, ValueType] = {
    "string": TEXT, "int": INT, "float": FLOAT, "bool": BOOL, "object": OBJECT,
}  # fmt: skip


def type_of_port(port: PortDeclaration) -> ValueType:
    """The type of the values that come out of the port."""
    one = _TYPES.get(port.type.name, ANY)
    found = list_of(one) if port.type.many else one
    return replace(found, optional=port.type.optional)


def distinct(sources: Iterable[ValueSource]) -> tuple[ValueSource, ...]:
    """Each kind of source once, with the first writer; beyond a bound only that there are others."""
    found: dict[object, ValueSource] = {}
    for source in sources:
        values = repr(source.values)
        found.setdefault((source.type, source.unit, values, source.names, source.port, source.depth), source)
        if len(found) == MAX_SOURCES:
            return (*found.values(), unknown(source.mark, source.writer))
    return tuple(found.values())


DEFAULT: Final = "its default"
"""Text for an input at which nothing is written."""
_TEXTS = ("text", "word", "object", "place")
_TAKES: Mapping[str, tuple[str, ...]] = {
    "string": _TEXTS,
    "object": ("object", "word", "place"),
    "int": ("int", "number"),
    "float": ("int", "float", "number"),
    "bool": ("bool",),
}
"""Kinds of values by the name of the port's type."""


def type_mismatch(source: ValueSource, target: PortDeclaration, text: str, *, strict: bool) -> str | None:
    """Why the input does not take what comes from there, as a sentence; `text` is what the file says.

    strict: the name of a place is no object, unless the input asks for one.
    """
    if not _fits(source.type, target, strict=strict):
        return f"{text} is {source.type.words()}, not {target.type.words()}"
    if source.unit and target.unit and source.unit != target.unit:
        return f"{text} is in {source.unit}, not in {target.unit}"
    values = source.values or ()
    wrong = [problem for value in values if (problem := _refused(value, target)) is not None]
    if wrong and (source.certain or len(wrong) == len(values)):
        # A literal stands in the reason already.
        return f"{text}: {wrong[0]}" if text.startswith("{") or text == DEFAULT else wrong[0]
    return None


def _refused(value: object, target: PortDeclaration) -> str | None:
    try:
        accept_value(value, target.type, target.choices, target.within)
    except (TypeError, ValueError) as error:
        return str(error)
    return None


def _fits(value: ValueType, port: PortDeclaration, *, strict: bool) -> bool:
    name = port.type.name
    if value.kind == "any" or (name == "any" and not port.type.many):
        return True
    if value.kind == "null":
        return port.type.optional
    if not port.type.many:
        return _takes(value, port, strict=strict)
    if value.kind != "list":
        return False
    element = value.element
    return element is None or element.kind == "any" or _takes(element, port, strict=strict)


def _takes(value: ValueType, port: PortDeclaration, *, strict: bool) -> bool:
    name = port.type.name
    if name == "object" and value.kind == "place" and strict:
        return port.names in ("bin", "hole", "fixture")
    return name == "any" or value.kind in _TAKES.get(name, (value.kind,))
