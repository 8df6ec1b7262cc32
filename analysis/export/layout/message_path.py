"""Message paths, as Lichtblick's and Foxglove's panels take them: a topic, then fields, slices and filters.

`/bt/tick.nodes[:]{path=="Main/Grasp"}.status`, `/joint_states.joints[:]{name=="j1"}.position`. What is
read here is the grammar of Lichtblick's `message-path` package without variables and without modifiers.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

Value: TypeAlias = str | int | bool


@dataclass(frozen=True, slots=True)
class Field:
    name: str


@dataclass(frozen=True, slots=True)
class Slice:
    """Elements `start` to `end`, both inclusive; to the last when `end` is None."""

    start: int
    end: int | None


@dataclass(frozen=True, slots=True)
class Filter:
    """Goes on only with what has this value at this field; `path` is one or more names."""

    path: tuple[str, ...]
    operator: str
    value: Value


Part: TypeAlias = Field | Slice | Filter


@dataclass(frozen=True, slots=True)
class MessagePath:
    topic: str
    parts: tuple[Part, ...] = ()


_TOPIC = re.compile(r"(?:/[a-zA-Z0-9_-]*)+|[a-zA-Z0-9_-]+(?:/[a-zA-Z0-9_-]*)*")
_FIELD = re.compile(r"\.([a-zA-Z0-9_-]+)")
_SLICE = re.compile(r"\[(-?\d+)?(:)?(-?\d+)?\]")
_FILTER = re.compile(
    r"\{([a-zA-Z0-9_-]+(?:\.[a-zA-Z0-9_-]+)*)(==|!=|>=|<=|>|<)(?:\"([^\"]*)\"|'([^']*)'|(-?\d+)|(true|false))\}"
)

_COMPARE: Mapping[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq, "!=": operator.ne, ">=": operator.ge, "<=": operator.le, ">": operator.gt,
    "<": operator.lt,
}  # fmt: skip


def literal(text: str) -> str | None:
    """The text as a value in a filter; None when it has both kinds of quote, since none can be escaped."""
    if '"' not in text:
        return f'"{text}"'
    return f"'{text}'" if "'" not in text else None


def parse(text: str) -> MessagePath:
    """Raises ValueError, with the place, for what the viewers would not understand.

    >>> parse('/wrench.force.z').parts
    (Field(name='force'), Field(name='z'))
    """
    topic = _TOPIC.match(text)
    if topic is None:
        raise ValueError(f"{text!r}: begins with no topic")
    parts: list[Part] = []
    at = topic.end()
    while at < len(text):
        at = _part(text, at, parts)
    return MessagePath(topic[0], tuple(parts))


def _part(text: str, at: int, parts: list[Part]) -> int:
    """Read one part into `parts`; the place after it."""
    if found := _FIELD.match(text, at):
        parts.append(Field(found[1]))
    elif (found := _SLICE.match(text, at)) and parts and isinstance(parts[-1], Field) and found[0] != "[]":
        start, colon, end = found.groups()
        first = 0 if start is None else int(start)
        last = first if colon is None else None if end is None else int(end)
        parts.append(Slice(first, last))
    elif found := _FILTER.match(text, at):
        path, compare, double, single, number, truth = found.groups()
        value: Value = truth == "true"
        if double is not None or single is not None:
            value = double if double is not None else single
        elif number is not None:
            value = int(number)
        parts.append(Filter(tuple(path.split(".")), compare, value))
    else:
        raise ValueError(f"{text!r}: no field, slice or filter at {text[at:]!r}")
    return found.end()


def values(path: MessagePath, message: object) -> tuple[object, ...]:
    """What a panel would be given of a message (mappings, sequences, plain values) of the path's topic."""
    return tuple(_values(path.parts, message))


def _values(parts: tuple[Part, ...], value: object) -> Iterator[object]:
    if value is None:
        return
    if not parts:
        yield value
        return
    part, rest = parts[0], parts[1:]
    match part:
        case Field(name):
            yield from _values(rest, _field(value, name))
        case Slice(start, end):
            elements = _elements(value)
            stop = len(elements) - 1 if end is None else min(end, len(elements) - 1)
            for k in range(start, stop + 1):
                if -len(elements) <= k:
                    yield from _values(rest, elements[k])
        case Filter():
            if _matches(part, value):
                yield from _values(rest, value)


def _matches(wanted: Filter, value: object) -> bool:
    for name in wanted.path:
        value = _field(value, name)
    comparable = isinstance(value, str) if isinstance(wanted.value, str) else isinstance(value, (int, float))
    return comparable and _COMPARE[wanted.operator](value, wanted.value)


def _field(value: object, name: str) -> object:
    return cast("Mapping[str, object]", value).get(name) if isinstance(value, Mapping) else None


def _elements(value: object) -> Sequence[object]:
    """None where the value is no list."""
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        return cast("Sequence[object]", value)
    return ()
