"""Text of a plan as a form sees it: its keys, and the same text with one key changed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

import orjson

from ...files.errors import PicktreeError
from ...files.yaml.reader import YamlNode, read
from .calls import JsonValue

KEYS: Final = (
    *("name", "missions", "scenes", "robots", "faults", "seeds", "set"),
    *("backend", "verify", "limit", "wall_limit", "memory", "disk", "keep"),
)
"""Keys of a plan in the order in which the form writes new ones."""
_PLAIN: Final = re.compile(r"[A-Za-z_][\w./ -]*|\d+:\d+")
_WORDS: Final = frozenset({"true", "false", "null", "yes", "no", "on", "off"})


def form_of(text: str) -> Mapping[str, JsonValue]:
    """Return the keys of a plan with their values. Raises FileError for a text that is no YAML."""
    value = read(text, "plan").root.value
    given = value if isinstance(value, dict) else {}
    return {key: given[key] for key in KEYS if key in given}  # type: ignore[misc]


def with_key(text: str, key: str, value: JsonValue) -> str:
    """Return the text with one key changed; None takes it out. All other lines stay as they are.

    Raises FileError for a text that is no YAML, PicktreeError for one whose keys cannot be told by lines.
    """
    if key not in KEYS:
        raise PicktreeError(f"a plan has no key {key!r}")
    root = read(text, "plan").root
    lines = text.splitlines(keepends=True)
    written = [] if value is None else [f"{key}: {_yaml(value)}\n"]
    if key in root.keys:
        first, last = _lines_of(root, key, lines)
        return "".join([*lines[:first], *written, *lines[last:]])
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += "\n"
    place = max(
        (_lines_of(root, each, lines)[1] for each in _before(key) if each in root.keys), default=len(lines)
    )
    return "".join([*lines[:place], *written, *lines[place:]])


def _before(key: str) -> tuple[str, ...]:
    return ("picktree", "kind", *KEYS[: KEYS.index(key)])


def _lines_of(root: YamlNode, key: str, lines: list[str]) -> tuple[int, int]:
    """Return the lines of a key with its value; comments and empty lines behind it are not among them."""
    marks = sorted(mark.line for mark in root.keys.values())
    first = root.keys[key].line - 1
    if marks.count(first + 1) > 1 or root.keys[key].column != 1:
        raise PicktreeError("write one key a line, then the form can change it")
    last = next((line - 1 for line in marks if line > first + 1), len(lines))
    while last > first + 1 and (not lines[last - 1].strip() or lines[last - 1].startswith("#")):
        last -= 1
    return first, last


def _yaml(value: JsonValue) -> str:
    """Return a value in the flow style, on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_yaml(key)}: {_yaml(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_yaml, value)) + "]"
    if isinstance(value, str) and _PLAIN.fullmatch(value) and value.lower() not in _WORDS:
        return value.strip()
    return orjson.dumps(value).decode()
