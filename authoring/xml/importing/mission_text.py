"""From values to the text of a mission file, in the style of the shipped ones."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator

from ....files.yaml.reader import resolve
from ..format.marked_values import Entry, Marked, Scalar

WIDTH = 108
"""Of a line; what fits is written in one."""
_MOST_IN_LINE = 3
"""Mappings within one another, or beside one another, that are still read well in a line."""
_PLAIN = re.compile(r"[A-Za-z_](?:[\w./<>=+*()!%' ;-]*[\w./<>=+*()!%';-])?", re.ASCII)
_IN_QUOTES = re.compile(r"[ !#-\[\]-~\u00a1-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]*")


def mission_text(document: Marked) -> str:
    """The whole file: the head, then each tree after an empty line."""
    lines = [f"# {comment}" for comment in document.comments]
    for entry in document.entries or ():
        if entry.key != "trees":
            lines += _entry(entry, "")
            continue
        lines.append("trees:")
        for index, tree in enumerate(entry.value.entries or ()):
            lines += [""] if index else []
            lines += _entry(tree, "  ")
    return "\n".join([*lines, ""])


def scalar_text(value: Scalar) -> str:
    """A scalar that reads back as the same value."""
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
    # JSON's escapes are YAML's, too, but it lets characters through that a YAML file cannot hold.
    quoted = json.dumps(text, ensure_ascii=False)
    return re.sub(r"[^ -~\u00a1-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]", _code, quoted)


def _code(match: re.Match[str]) -> str:
    return f"\\u{ord(match[0]):04x}" if ord(match[0]) < 0x10000 else f"\\U{ord(match[0]):08x}"


def _entry(entry: Entry, indent: str) -> Iterator[str]:
    """`key: value`, in a line or as a block."""
    for comment in entry.value.comments:
        yield f"{indent}# {comment}"
    key = scalar_text(entry.key)
    line = _line(entry.value)
    if line is not None and len(indent) + len(key) + 2 + len(line) <= WIDTH and not _is_children(entry):
        yield f"{indent}{key}: {line}"
    elif entry.value.entries or entry.value.items:
        yield f"{indent}{key}:"
        yield from _block(entry.value, indent + "  ")
    else:
        yield f"{indent}{key}: {_flow(entry.value)}"


def _block(value: Marked, indent: str) -> Iterator[str]:
    for entry in value.entries or ():
        yield from _entry(entry, indent)
    for item in value.items or ():
        for comment in item.comments:
            yield f"{indent}# {comment}"
        line = _line(item)
        if line is not None and item.entries is not None and len(item.entries) == 1:
            # `- Grasp: {…}` reads better than `- {Grasp: {…}}`.
            line = line[1:-1]
        if line is not None and len(indent) + 2 + len(line) <= WIDTH:
            yield f"{indent}- {line}"
        elif item.entries:
            lines = [line for entry in item.entries for line in _entry(entry, indent + "  ")]
            yield f"{indent}- {lines[0][len(indent) + 2 :]}"
            yield from lines[1:]
        else:
            yield f"{indent}- {_flow(item)}"


def _is_children(entry: Entry) -> bool:
    """Whether several children stand there, which are read from top to bottom."""
    several = entry.value.items is not None and len(entry.value.items) > 1
    nodes = several and any(item.entries is not None for item in entry.value.items or ())
    return nodes and (entry.key == "do" or entry.key[:1].isupper())


def _line(value: Marked) -> str | None:
    """The value in one line, None when that is not read well."""
    if _commented(value) or _mappings(value) > _MOST_IN_LINE or _has_children(value):
        return None
    return _flow(value)


def _commented(value: Marked) -> bool:
    return any(below.comments or _commented(below) for below in _below(value))


def _has_children(value: Marked) -> bool:
    return any(_is_children(entry) for entry in value.entries or ()) or any(
        _has_children(below) for below in _below(value)
    )


def _mappings(value: Marked) -> int:
    return (value.entries is not None) + sum(_mappings(below) for below in _below(value))


def _below(value: Marked) -> Iterator[Marked]:
    yield from value.items or ()
    yield from (entry.value for entry in value.entries or ())


def _flow(value: Marked) -> str:
    if value.items is not None:
        return f"[{', '.join(map(_flow, value.items))}]"
    if value.entries is not None:
        entries = (f"{scalar_text(e.key)}: {_flow(e.value)}" for e in value.entries)
        return f"{{{', '.join(entries)}}}"
    return scalar_text(value.scalar)
