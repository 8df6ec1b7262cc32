"""Writer of YAML files: plain values with comments become text in the style of the examples."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from picktree.files import Mark

from .reader import Value, YamlNode, resolve

Scalar = str | int | float | bool | None


@dataclass(slots=True)
class MarkedEntry:
    """A key and its value."""

    key: str
    mark: Mark
    value: MarkedValue


@dataclass(slots=True)
class MarkedValue:
    """Scalar, mapping (`entries`) or list (`items`), with the comments above it and behind its last part."""

    mark: Mark
    scalar: Scalar = None
    items: list[MarkedValue] | None = None
    entries: list[MarkedEntry] | None = None
    comments: tuple[str, ...] = field(default=())
    end_comments: tuple[str, ...] = field(default=())

    @classmethod
    def mapping(cls, mark: Mark) -> MarkedValue:
        return cls(mark, entries=[])

    def put(self, key: str, value: MarkedValue | Scalar, mark: Mark | None = None) -> None:
        """Add an entry to a mapping; a bare scalar gets the place of its key."""
        assert self.entries is not None
        at = mark or (value.mark if isinstance(value, MarkedValue) else self.mark)
        given = value if isinstance(value, MarkedValue) else MarkedValue(at, value)
        self.entries.append(MarkedEntry(key, at, given))

    def get(self, key: str) -> MarkedValue | None:
        return next((entry.value for entry in self.entries or () if entry.key == key), None)

    def node(self) -> YamlNode:
        """Return the value as the YAML reader represents it."""
        if self.items is not None:
            items = [item.node() for item in self.items]
            return YamlNode([item.value for item in items], self.mark, items=items)
        if self.entries is not None:
            entries = {entry.key: entry.value.node() for entry in self.entries}
            value: Value = {key: node.value for key, node in entries.items()}
            return YamlNode(value, self.mark, entries=entries, keys={e.key: e.mark for e in self.entries})
        return YamlNode(self.scalar, self.mark)


def from_value(value: Value, mark: Mark) -> MarkedValue:
    """Return a plain value with one place for all its parts."""
    match value:
        case list():
            return MarkedValue(mark, items=[from_value(item, mark) for item in value])
        case dict():
            return MarkedValue(
                mark, entries=[MarkedEntry(str(k), mark, from_value(v, mark)) for k, v in value.items()]
            )
        case _:
            return MarkedValue(mark, value)


MAX_LINE_LENGTH = 108
"""Maximum length of a line; values that fit are written in one."""
_MAX_MAPPINGS_IN_LINE = 3
"""Maximum number of nested or neighbouring mappings in a line."""
_PLAIN = re.compile(r"[A-Za-z_](?:[\w./<>=+*()!%' ;-]*[\w./<>=+*()!%';-])?", re.ASCII)
_IN_QUOTES = re.compile(r"[ !#-\[\]-~\u00a1-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]*")


def mission_text(document: MarkedValue) -> str:
    """Return the whole file: the head, then each tree after an empty line."""
    lines = [f"# {comment}" for comment in document.comments]
    for entry in document.entries or ():
        if entry.key != "trees":
            lines += _entry(entry, "")
            continue
        lines.append("trees:")
        for index, tree in enumerate(entry.value.entries or ()):
            lines += [""] if index else []
            lines += _entry(tree, "  ")
        lines += [f"  # {comment}" for comment in entry.value.end_comments]
    lines += [f"# {comment}" for comment in document.end_comments]
    return "\n".join([*lines, ""])


def value_text(value: MarkedValue) -> str:
    """Return a value by itself, without a trailing newline."""
    line = _line(value)
    if line is not None and len(line) <= MAX_LINE_LENGTH:
        return line[1:-1] if value.entries else line
    return "\n".join(_block(value, ""))


def scalar_text(value: Scalar) -> str:
    """Return a scalar's text, which reads back as the same value."""
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case int():
            return str(value)
        case float():
            return _float(value)
        case str():
            return _text(value)


def _float(value: float) -> str:
    if math.isinf(value):
        return "-.inf" if value < 0 else ".inf"
    return ".nan" if math.isnan(value) else repr(value)


def _text(text: str) -> str:
    if _PLAIN.fullmatch(text) and isinstance(resolve(text), str):
        return text
    if _IN_QUOTES.fullmatch(text):
        return f'"{text}"'
    if "'" not in text and "\n" not in text and _IN_QUOTES.fullmatch(text.replace('"', "").replace("\\", "")):
        return f"'{text}'"
    return _escaped(text)


def _escaped(text: str) -> str:
    # JSON's escapes are valid in YAML, but JSON allows characters that a YAML file cannot hold.
    quoted = json.dumps(text, ensure_ascii=False)
    return re.sub(r"[^ -~\u00a1-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]", _code, quoted)


def _code(match: re.Match[str]) -> str:
    return f"\\u{ord(match[0]):04x}" if ord(match[0]) < 0x10000 else f"\\U{ord(match[0]):08x}"


def _entry(entry: MarkedEntry, indent: str) -> Iterator[str]:
    """Yield the lines of `key: value`, in one line or as a block."""
    for comment in entry.value.comments:
        yield f"{indent}# {comment}"
    key = scalar_text(entry.key)
    line = _line(entry.value)
    if (
        line is not None
        and len(indent) + len(key) + 2 + len(line) <= MAX_LINE_LENGTH
        and not _is_children(entry)
    ):
        yield f"{indent}{key}: {line}"
    elif entry.value.entries or entry.value.items:
        yield f"{indent}{key}:"
        yield from _block(entry.value, indent + "  ")
    else:
        yield f"{indent}{key}: {_flow(entry.value)}"


def _block(value: MarkedValue, indent: str) -> Iterator[str]:
    for entry in value.entries or ():
        yield from _entry(entry, indent)
    for item in value.items or ():
        for comment in item.comments:
            yield f"{indent}# {comment}"
        line = _line(item)
        if line is not None and item.entries is not None and len(item.entries) == 1:
            # `- Grasp: {…}` reads better than `- {Grasp: {…}}`.
            line = line[1:-1]
        if line is not None and len(indent) + 2 + len(line) <= MAX_LINE_LENGTH:
            yield f"{indent}- {line}"
        elif item.entries:
            lines = [line for entry in item.entries for line in _entry(entry, indent + "  ")]
            yield f"{indent}- {lines[0][len(indent) + 2 :]}"
            yield from lines[1:]
        else:
            yield f"{indent}- {_flow(item)}"
    for comment in value.end_comments:
        yield f"{indent}# {comment}"


def _is_children(entry: MarkedEntry) -> bool:
    """Whether the entry is a list of several children, which reads better from top to bottom."""
    several = entry.value.items is not None and len(entry.value.items) > 1
    nodes = several and any(item.entries is not None for item in entry.value.items or ())
    return nodes and (entry.key == "do" or entry.key[:1].isupper())


def _line(value: MarkedValue) -> str | None:
    """Return the value in one line; None where that is hard to read."""
    if _commented(value) or _mappings(value) > _MAX_MAPPINGS_IN_LINE or _has_children(value):
        return None
    return _flow(value)


def _commented(value: MarkedValue) -> bool:
    return bool(value.end_comments) or any(below.comments or _commented(below) for below in _below(value))


def _has_children(value: MarkedValue) -> bool:
    return any(_is_children(entry) for entry in value.entries or ()) or any(
        _has_children(below) for below in _below(value)
    )


def _mappings(value: MarkedValue) -> int:
    return (value.entries is not None) + sum(_mappings(below) for below in _below(value))


def _below(value: MarkedValue) -> Iterator[MarkedValue]:
    yield from value.items or ()
    yield from (entry.value for entry in value.entries or ())


def _flow(value: MarkedValue) -> str:
    if value.items is not None:
        return f"[{', '.join(map(_flow, value.items))}]"
    if value.entries is not None:
        entries = (f"{scalar_text(e.key)}: {_flow(e.value)}" for e in value.entries)
        return f"{{{', '.join(entries)}}}"
    return scalar_text(value.scalar)
