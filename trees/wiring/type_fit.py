"""Whether a value fits the input at which it arrives, and what to say when it does not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from ...files.expressions.type_inference import ValueType
from ..ports import PortDeclaration
from ..values.port_types import accept_value
from .value_sources import ValueSource

DEFAULT: Final = "its default"
"""What stands at an input where nothing is written."""
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
