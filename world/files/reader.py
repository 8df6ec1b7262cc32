"""From YAML text to plain values with places.

Scalars are read by YAML 1.2's core schema, as editors read them: `no` and `on` are texts, `1e-3` is a number,
`010` is ten. Keys are always texts, as they are written.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NoReturn, TypeAlias

import yaml

from .marks import Fault, FileError, Location, Mark, where

Value: TypeAlias = "dict[str, Value] | list[Value] | str | int | float | bool | None"

MAX_BYTES = 4_000_000
MAX_DEPTH = 200
MAX_VALUES = 200_000


@dataclass(slots=True)
class Node:
    """A value with its place; `size` and `height` count what an alias would repeat."""

    value: Value
    mark: Mark
    items: list[Node] = field(default_factory=list["Node"])
    entries: dict[str, Node] = field(default_factory=dict[str, "Node"])
    keys: dict[str, Mark] = field(default_factory=dict[str, Mark])
    size: int = 1
    height: int = 1

    def child(self, part: str | int) -> Node | None:
        if isinstance(part, str):
            return self.entries.get(part)
        return self.items[part] if 0 <= part < len(self.items) else None


def read(text: str, file: str) -> Node:
    """The root of the text's one document. Raises FileError with all that is wrong with its form."""
    return _Reader(text, file).read()


def mark_at(file: str, text: str, index: int) -> Mark:
    lines = re.split(r"\r\n|[\n\r\x85\u2028\u2029]", text[:index])
    return Mark(file, len(lines), len(lines[-1]) + 1)


# What YAML allows in a stream (1.2, section 5.1), less the byte order mark in mid-text.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]")
_NULL = re.compile(r"(?:null|Null|NULL|~|)")
_BOOL = re.compile(r"(?:true|True|TRUE|false|False|FALSE)")
_INT = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_INFINITE = re.compile(r"([-+]?)\.(?:inf|Inf|INF)")
_NAN = re.compile(r"\.(?:nan|NaN|NAN)")
_REFERENCE = re.compile(r"[A-Za-z_][\w.]*")
_COLON = re.compile(r"\s*:")


def resolve(text: str) -> str | int | float | bool | None:
    """The value of a plain scalar in YAML 1.2's core schema. Raises ValueError for a number too long."""
    if _NULL.fullmatch(text):
        return None
    if _BOOL.fullmatch(text):
        return text[0] in "tT"
    if _INT.fullmatch(text):
        return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))
    if _FLOAT.fullmatch(text):
        return float(text)
    if infinite := _INFINITE.fullmatch(text):
        return -math.inf if infinite[1] == "-" else math.inf
    return math.nan if _NAN.fullmatch(text) else text


class _Stop(Exception):
    """The text cannot be read any further."""


@dataclass(slots=True)
class _Open:
    """A collection whose end is not read yet."""

    node: Node
    loc: Location
    anchor: str | None
    flow: bool
    key: str | None = None
    """The key whose value comes next."""
    key_mark: Mark | None = None
    skip: bool = False
    """The value that comes next has a key that was refused."""
    bare: bool = False
    """A key that stands in braces without a colon: `{item}`."""


class _Reader:
    """Builds the nodes from the parser's events: without recursion, and with every bound in one place."""

    def __init__(self, text: str, file: str) -> None:
        self._text, self._file = text, file
        self._faults: list[Fault] = []
        self._anchors: dict[str, Node] = {}
        self._open: list[_Open] = []
        self._total = 0
        self._root: Node | None = None

    def read(self) -> Node:
        try:
            self._check_text()
            self._events()
        except _Stop:
            pass
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            self._fault(_mark(self._file, mark), "", *_yaml_problem(error))
        except yaml.YAMLError as error:
            self._fault(Mark(self._file, 1, 1), "", f"not valid YAML: {error}")
        if self._root is None and not self._faults:
            self._fault(Mark(self._file, 1, 1), "", "the file is empty", "it begins with 'picktree: 1'")
        if self._faults or self._root is None:
            raise FileError(self._faults)
        return self._root

    def _check_text(self) -> None:
        if len(self._text) > MAX_BYTES:
            self._stop(Mark(self._file, 1, 1), f"the file is larger than {MAX_BYTES // 1_000_000} MB")
        bad = _FORBIDDEN.search(self._text)
        if bad:
            mark = mark_at(self._file, self._text, bad.start())
            self._stop(mark, f"the character U+{ord(bad[0]):04X} may not stand in a text file")

    def _events(self) -> None:
        documents = 0
        for event in yaml.parse(self._text, yaml.CSafeLoader):
            match event:
                case yaml.DocumentStartEvent():
                    documents += 1
                    if documents > 1:
                        self._stop(_mark(self._file, event.start_mark), "a second document in one file")
                case yaml.AliasEvent():
                    self._alias(event)
                case yaml.ScalarEvent():
                    self._scalar(event)
                case yaml.SequenceStartEvent() | yaml.MappingStartEvent():
                    self._start(event)
                case yaml.SequenceEndEvent() | yaml.MappingEndEvent():
                    self._end()
                case _:
                    pass

    def _alias(self, event: yaml.AliasEvent) -> None:
        mark = _mark(self._file, event.start_mark)
        target = self._anchors.get(str(event.anchor))
        if target is None:
            self._stop(mark, f"*{event.anchor} names no finished value", "an anchor stands before its alias")
        self._count(target.size, mark)
        if len(self._open) + target.height > MAX_DEPTH:
            self._stop(mark, f"the file is nested more than {MAX_DEPTH} deep")
        self._add(target, mark, None)

    def _scalar(self, event: yaml.ScalarEvent) -> None:
        mark = _mark(self._file, event.start_mark)
        self._count(1, mark)
        self._refuse_tag(event.tag, mark)
        awaiting_key = self._awaiting_key()
        value: Value = event.value
        if event.style in (None, "") and not awaiting_key:
            try:
                value = resolve(event.value)
            except ValueError:
                self._fault(mark, where(self._loc()), "the number has too many digits")
        if awaiting_key:
            self._key(str(event.value), mark)
            self._open[-1].bare = (
                self._open[-1].flow
                and event.style in (None, "")
                and _REFERENCE.fullmatch(event.value) is not None
                and not _COLON.match(self._text, event.end_mark.index if event.end_mark else 0)
            )
        else:
            self._add(Node(value, mark), mark, event.anchor)

    def _key(self, key: str, mark: Mark) -> None:
        parent = self._open[-1]
        if key in parent.node.keys:
            line = parent.node.keys[key].line
            self._fault(
                mark, where((*parent.loc, key)), f"the key {key!r} is given twice", f"first on line {line}"
            )
            parent.skip = True
        elif key == "":
            self._fault(mark, where(parent.loc), "a key is missing before ':'")
            parent.skip = True
        elif key == "<<":
            self._fault(mark, where(parent.loc), "merge keys (<<) are not part of YAML 1.2")
            parent.skip = True
        parent.key, parent.key_mark = key, mark

    def _start(self, event: yaml.SequenceStartEvent | yaml.MappingStartEvent) -> None:
        mark = _mark(self._file, event.start_mark)
        self._count(1, mark)
        self._refuse_tag(event.tag, mark)
        if len(self._open) >= MAX_DEPTH:
            self._stop(mark, f"the file is nested more than {MAX_DEPTH} deep")
        if self._awaiting_key():
            what = "{…}" if isinstance(event, yaml.MappingStartEvent) else "[…]"
            self._stop(mark, f"a key is a word, not {what}", 'a reference is quoted: "{item}"')
        value: Value = {} if isinstance(event, yaml.MappingStartEvent) else []
        node = Node(value, mark)
        self._open.append(_Open(node, self._loc(), event.anchor, bool(event.flow_style)))

    def _end(self) -> None:
        closed = self._open.pop()
        node = closed.node
        if closed.bare and len(node.entries) == 1:
            ((key, _),) = node.entries.items()
            message = f"{{{key}}} without quotes is a YAML mapping"
            self._fault(node.mark, where(closed.loc), message, f'write "{{{key}}}"')
        self._add(node, node.mark, closed.anchor)

    def _add(self, node: Node, mark: Mark, anchor: str | None) -> None:
        if anchor is not None:
            self._anchors[anchor] = node
        if not self._open:
            self._root = node
            return
        parent = self._open[-1]
        top = parent.node
        top.size += node.size
        top.height = max(top.height, node.height + 1)
        if isinstance(top.value, list):
            top.value.append(node.value)
            top.items.append(node)
            return
        key, key_mark = parent.key, parent.key_mark
        if isinstance(top.value, dict) and key is not None and key_mark is not None and not parent.skip:
            top.value[key] = node.value
            top.entries[key] = node
            top.keys[key] = key_mark
        parent.key, parent.key_mark, parent.skip = None, None, False

    def _awaiting_key(self) -> bool:
        return bool(self._open) and isinstance(self._open[-1].node.value, dict) and self._open[-1].key is None

    def _loc(self) -> Location:
        if not self._open:
            return ()
        parent = self._open[-1]
        if isinstance(parent.node.value, list):
            return (*parent.loc, len(parent.node.items))
        return parent.loc if parent.key is None else (*parent.loc, parent.key)

    def _count(self, values: int, mark: Mark) -> None:
        self._total += values
        if self._total > MAX_VALUES:
            self._stop(mark, f"the file has more than {MAX_VALUES} values, aliases counted out")

    def _refuse_tag(self, tag: str | None, mark: Mark) -> None:
        if tag is not None:
            self._fault(mark, where(self._loc()), f"the tag {tag!r} is not read", "leave it out")

    def _fault(self, mark: Mark, trail: str, message: str, hint: str = "") -> None:
        self._faults.append(Fault(mark, trail, message, hint))

    def _stop(self, mark: Mark, message: str, hint: str = "") -> NoReturn:
        loc = self._loc()
        self._fault(mark, where(loc[:12]) + ("…" if len(loc) > 12 else ""), message, hint)
        raise _Stop


def _mark(file: str, mark: object) -> Mark:
    line, column = getattr(mark, "line", 0), getattr(mark, "column", 0)
    return Mark(file, int(line) + 1, int(column) + 1)


_PROBLEMS: Mapping[str, tuple[str, str]] = {
    "found character that cannot start any token": ("this character cannot start a value", "quote the text"),
    "mapping values are not allowed in this context": (
        "a ':' does not fit here",
        "quote the text, or indent it",
    ),
    "did not find expected key": ("this does not line up with the keys above", "check indent and quotes"),
}


def _yaml_problem(error: yaml.MarkedYAMLError) -> tuple[str, str]:
    problem = str(error.problem or error.context or "unknown problem")
    known = _PROBLEMS.get(problem)
    if known is not None:
        return f"not valid YAML: {known[0]}", known[1]
    return f"not valid YAML: {problem}", str(error.context or "") if error.problem else ""
