"""YAML reader: text to plain values with their places.

Scalars are read by YAML 1.2's core schema, as editors read them: `no` and `on` are texts, `1e-3` is a number,
`010` is ten. Keys are always texts."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import NoReturn, TypeAlias

import yaml

from picktree.files import MAX_FAULTS, Diagnostic, FileError, Location, Mark, too_many, where

from .file_text import check_characters
from .syntax_faults import COMMA, PlainText, joined_key, look_alike, spoilt_key, syntax_faults

Value: TypeAlias = "dict[str, Value] | list[Value] | str | int | float | bool | None"

MAX_DEPTH = 200
MAX_VALUES = 50_000
"""Maximum number of values of one file, keys and expanded aliases included; they are read in less than 0.5
s."""


@dataclass(slots=True)
class YamlNode:
    """A value with its place; `size` and `height` count the nodes that an alias would repeat."""

    value: Value
    mark: Mark
    items: list[YamlNode] = field(default_factory=list["YamlNode"])
    entries: dict[str, YamlNode] = field(default_factory=dict[str, "YamlNode"])
    keys: dict[str, Mark] = field(default_factory=dict[str, Mark])
    size: int = 1
    height: int = 1

    def child(self, part: str | int) -> YamlNode | None:
        if isinstance(part, str):
            return self.entries.get(part)
        return self.items[part] if 0 <= part < len(self.items) else None


@dataclass(frozen=True, slots=True)
class YamlReadResult:
    """Result of reading a text, as far as possible, with the faults of its form."""

    root: YamlNode
    faults: tuple[Diagnostic, ...]


def read(text: str, file: str) -> YamlReadResult:
    """Return the only document of the text. Raises FileError when the text cannot be read to its end."""
    return _Reader(text, file).read()


_NULL = re.compile(r"(?:null|Null|NULL|~|)")
_BOOL = re.compile(r"(?:true|True|TRUE|false|False|FALSE)")
_INT = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_INFINITE = re.compile(r"([-+]?)\.(?:inf|Inf|INF)")
_NAN = re.compile(r"\.(?:nan|NaN|NAN)")
_REFERENCE = re.compile(r"[A-Za-z_][\w.]*|=.*\S.*")
_WHOLE = re.compile(r"(?<![\w.'+-])(?P<number>[-+]?[0-9]+),$")
_COLON = re.compile(r"\s*:")


def resolve(text: str) -> str | int | float | bool | None:
    """Return the value of a plain scalar in YAML 1.2's core schema. Raises ValueError for a number too
    long."""
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


@dataclass(slots=True)
class _Open:
    """A collection whose end is not read yet."""

    node: YamlNode
    loc: Location
    anchor: str | None
    flow: bool
    key: str | None = None
    """The key whose value comes next."""
    key_mark: Mark | None = None
    skip: bool = False
    """The value that comes next has a key that was refused."""
    bare: bool = False
    """Whether it is a key in braces without a colon: `{item}`."""
    joined: tuple[str, Mark] | None = None
    """Value that the key holds by itself, `{pose:home}`: the value that comes next is empty."""


class _Reader:
    """Builds the nodes from the parser's events: without recursion, and with every bound in one place."""

    def __init__(self, text: str, file: str) -> None:
        self._text, self._file = text, file
        self._faults: list[Diagnostic] = []
        self._anchors: dict[str, YamlNode] = {}
        self._open: list[_Open] = []
        self._total = 0
        self._root: YamlNode | None = None

    def read(self) -> YamlReadResult:
        check_characters(self._text, self._file)
        try:
            for event in yaml.parse(self._text, yaml.CSafeLoader):
                self._take(event)
        except yaml.YAMLError as error:
            reported = {fault.mark for fault in self._faults}
            for fault in syntax_faults(error, self._text, self._file):
                if fault.mark not in reported:
                    self._add_fault(fault)
            raise FileError(self._faults) from None
        if self._root is None:
            self._stop(
                Mark(self._file, 1, 1), "the file is empty", "it begins with 'picktree: 1'", code="P119"
            )
        return YamlReadResult(self._root, tuple(self._faults))

    def _take(self, event: yaml.Event) -> None:
        match event:
            case yaml.DocumentStartEvent():
                self._document(event)
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

    def _document(self, event: yaml.DocumentStartEvent) -> None:
        mark = _mark(self._file, event.start_mark)
        if self._root is not None:
            self._stop(mark, "a second document in one file", "a file for each", code="P118")
        if event.tags or event.version not in (None, (1, 2)):
            message = "a directive is not read: every file is YAML 1.2"
            self._fault(mark, "", message, "leave out the line that begins with %", code="P116")

    def _alias(self, event: yaml.AliasEvent) -> None:
        mark = _mark(self._file, event.start_mark)
        target = self._anchors.get(str(event.anchor))
        if target is None:
            message = f"*{event.anchor} has no anchor before it"
            self._stop(
                mark,
                message,
                "put the anchor &… earlier in the file; quote a text that begins with *",
                code="P117",
            )
        self._count(target.size, mark)
        if len(self._open) + target.height > MAX_DEPTH:
            self._stop(mark, f"the file is nested more than {MAX_DEPTH} deep", code="P123")
        self._add(target, mark, None)

    def _scalar(self, event: yaml.ScalarEvent) -> None:
        mark = _mark(self._file, event.start_mark)
        self._count(1, mark)
        self._refuse_tag(event.tag, mark)
        awaiting_key, plain = self._awaiting_key(), event.style in (None, "")
        text = str(event.value)
        if awaiting_key:
            colon = _COLON.match(self._text, event.end_mark.index if event.end_mark else 0)
            alone = plain and self._open[-1].flow and colon is None
            if alone and self._decimal_comma(text, event, mark):
                return
            joined = joined_key(text) if alone else None
            spoilt = spoilt_key(text) if plain and not self._open[-1].flow else None
            if spoilt is not None:
                at = Mark(mark.file, mark.line, mark.column + spoilt.start)
                self._stop(at, spoilt.message, spoilt.hint, code=spoilt.code)
            meant = joined or (look_alike(text, is_key=True) if plain else None)
            self._key(self._mended(meant, text, mark), mark)
            self._open[-1].bare = alone and joined is None and _REFERENCE.fullmatch(text) is not None
            if joined is not None and joined.value is not None:
                shift = len(text) - len(joined.value)
                self._open[-1].joined = joined.value, Mark(mark.file, mark.line, mark.column + shift)
            return
        if self._open and self._open[-1].joined is not None:
            text, mark = self._open[-1].joined
            self._open[-1].joined = None
        meant = look_alike(text, is_key=False) if plain else None
        text = self._mended(meant, text, mark)
        value: Value = text
        if plain and (meant is None or not meant.quoted):
            try:
                value = resolve(text)
            except ValueError:
                self._fault(mark, where(self._loc()), "the number has too many digits", code="P120")
        self._add(YamlNode(value, mark), mark, event.anchor)

    def _decimal_comma(self, text: str, event: yaml.ScalarEvent, mark: Mark) -> bool:
        """Return whether a key in braces is the rest of a number, `{msec: 0,5 s}`, and mend it so."""
        parent = self._open[-1]
        before = _WHOLE.search(self._text, 0, event.start_mark.index if event.start_mark else 0)
        if before is None or not text[:1].isdigit() or not parent.node.entries:
            return False
        meant = f"{before['number']}.{text}"
        at = Mark(mark.file, mark.line, mark.column - 1)
        self._fault(at, where(self._loc()), COMMA, f"write {meant}", code="P127")
        key = next(reversed(parent.node.entries))
        node = YamlNode(resolve(meant), parent.node.entries[key].mark)
        parent.node.entries[key] = node
        if isinstance(parent.node.value, dict):
            parent.node.value[key] = node.value
        parent.key, parent.key_mark, parent.skip = text, mark, True
        return True

    def _mended(self, meant: PlainText | None, text: str, mark: Mark) -> str:
        """Return the text that is meant, with a fault where another one is written."""
        if meant is None:
            return text
        at = Mark(mark.file, mark.line, mark.column + meant.slip.start)
        self._fault(at, where(self._loc()), meant.slip.message, meant.slip.hint, code=meant.slip.code)
        return meant.text

    def _key(self, key: str, mark: Mark) -> None:
        parent = self._open[-1]
        parent.skip = True
        if key in parent.node.keys:
            message, first = f"the key {_excerpt(key)} is given twice", parent.node.keys[key].line
            hint = f"first on line {first}" + (
                "; nodes of a list begin with '- '" if key[:1].isupper() else ""
            )
            self._fault(mark, where((*parent.loc, key)), message, hint, code="P114")
        elif key == "":
            self._fault(mark, where(parent.loc), "a key is missing before ':'", code="P115")
        elif key == "<<":
            message, hint = "merge keys (<<) are not part of YAML 1.2", "write the keys out"
            self._fault(mark, where(parent.loc), message, hint, code="P115")
        else:
            parent.skip = False
        parent.key, parent.key_mark = key, mark

    def _start(self, event: yaml.SequenceStartEvent | yaml.MappingStartEvent) -> None:
        mark = _mark(self._file, event.start_mark)
        self._count(1, mark)
        self._refuse_tag(event.tag, mark)
        if len(self._open) >= MAX_DEPTH:
            self._stop(mark, f"the file is nested more than {MAX_DEPTH} deep", code="P123")
        if self._awaiting_key():
            what = "{…}" if isinstance(event, yaml.MappingStartEvent) else "[…]"
            self._stop(mark, f"a key is a word, not {what}", 'a reference is quoted: "{item}"', code="P115")
        value: Value = {} if isinstance(event, yaml.MappingStartEvent) else []
        node = YamlNode(value, mark)
        self._open.append(_Open(node, self._loc(), event.anchor, bool(event.flow_style)))

    def _end(self) -> None:
        closed = self._open.pop()
        node = closed.node
        if closed.bare and len(node.entries) == 1:
            ((key, _),) = node.entries.items()
            message = f"{{{key}}} without quotes is a YAML mapping"
            self._fault(node.mark, where(closed.loc), message, f'write "{{{key}}}"', code="P113")
            node = YamlNode(f"{{{key}}}", node.mark)
        self._add(node, node.mark, closed.anchor)

    def _add(self, node: YamlNode, mark: Mark, anchor: str | None) -> None:
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
            message = f"the file has more than {MAX_VALUES} values, each alias counted with all its values"
            self._stop(mark, message, code="P123")

    def _refuse_tag(self, tag: str | None, mark: Mark) -> None:
        if tag is not None:
            message = f"the tag {_excerpt(tag.replace('tag:yaml.org,2002:', '!!'))} is not read"
            self._fault(mark, where(self._loc()), message, "leave it out", code="P116")

    def _fault(self, mark: Mark, trail: str, message: str, hint: str = "", *, code: str) -> None:
        self._add_fault(Diagnostic(mark, trail, message, hint, code))

    def _add_fault(self, fault: Diagnostic) -> None:
        if len(self._faults) == MAX_FAULTS:
            self._faults.append(too_many(fault.mark))
        if len(self._faults) <= MAX_FAULTS:
            self._faults.append(fault)

    def _stop(self, mark: Mark, message: str, hint: str = "", *, code: str) -> NoReturn:
        loc = self._loc()
        self._fault(mark, where(loc[:12]) + ("…" if len(loc) > 12 else ""), message, hint, code=code)
        raise FileError(self._faults)


def _mark(file: str, mark: object) -> Mark:
    line, column = getattr(mark, "line", 0), getattr(mark, "column", 0)
    return Mark(file, int(line) + 1, int(column) + 1)


def _excerpt(text: str) -> str:
    return repr(text if len(text) <= 60 else text[:57] + "...")
