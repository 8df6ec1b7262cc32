"""YAML reader: text to plain values with their places.

Scalars are read by YAML 1.2's core schema, as editors read them: `no` and `on` are texts, `1e-3` is a number,
`010` is ten. Keys are always texts, as they are written."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NoReturn, TypeAlias

import yaml

from ..marks import MAX_FAULTS, Diagnostic, FileError, Location, Mark, too_many, where
from .file_text import check_characters


@dataclass(frozen=True, slots=True)
class _Words:
    message: str
    hint: str = ""
    at_start: bool = False
    """The fault stands where the construct begins, not where the reader gave up."""


_NEVER_CLOSED = _Words(
    "the quote that opens here is never closed", "close it, or double a quote inside", True
)
_NO_TAB = _Words("a tab cannot indent", "use spaces")
_PROBLEMS: Mapping[str, _Words] = {
    "mapping values are not allowed in this context": _Words(
        "a ':' does not fit here", "quote the text, or indent it"
    ),
    "block sequence entries are not allowed in this context": _Words(
        "a list cannot begin here", "each '-' stands on a line of its own, under the key"
    ),
    "did not find expected key": _Words(
        "this does not line up with the keys above", "check indent and quotes"
    ),
    "did not find expected '-' indicator": _Words(
        "this does not line up with the list above", "check indent and quotes"
    ),
    "did not find expected ',' or '}'": _Words("a ',' or '}' is missing", "the { of line {line} is open"),
    "did not find expected ',' or ']'": _Words("a ',' or ']' is missing", "the [ of line {line} is open"),
    "could not find expected ':'": _Words("a ':' is missing behind this key", "as 'key: value'", True),
    "did not find expected alphabetic or numeric character": _Words(
        "& and * begin an anchor and an alias, and need a name", "quote a text that begins with them", True
    ),
    "did not find expected <document start>": _Words(
        "this does not belong to the mapping above", "check indent"
    ),
    "did not find expected comment or line break": _Words("the line must end here"),
    "found unknown escape character": _Words(
        'unknown escape in a "…" text', "a backslash is written \\\\, or the text in '…'"
    ),
    "found unexpected document indicator": _NEVER_CLOSED,
    "found a tab character that violates indentation": _NO_TAB,
    "found a tab character where an indentation space is expected": _NO_TAB,
    "found incompatible YAML document": _Words("the directive %YAML asks for another YAML", "leave it out"),
    "found undefined tag handle": _Words("tags (!) are not read", "quote a text that begins with !"),
    "found unexpected ':'": _Words(
        "a ':' does not fit here", "quote the text, or put a blank behind the ':'"
    ),
    "found invalid Unicode character escape code": _Words("the escape is no character", "as \\u00e9"),
    "did not find expected hexdecimal number": _Words("the escape needs hexadecimal digits", "as \\u00e9"),
}


def yaml_fault(error: yaml.YAMLError, text: str, file: str) -> Diagnostic:
    """Return a fault for an error of libyaml: in our words, in its own where none of ours fit."""
    if not isinstance(error, yaml.MarkedYAMLError):
        return Diagnostic(Mark(file, 1, 1), "", f"not valid YAML: {error}", code="P101")
    problem, context = str(error.problem or error.context or "unknown problem"), str(error.context or "")
    at, start = error.problem_mark or error.context_mark, error.context_mark or error.problem_mark
    indented = _wrong_indent(text, at) if at is not None and "mapping values" in problem else None
    if indented is not None:
        line, column, words = indented
        return Diagnostic(
            Mark(file, line, column), "", f"not valid YAML: {words.message}", words.hint, "P101"
        )
    words = _words(problem, context, text, at)
    if words is None:
        words = _Words(problem, context if error.problem else "")
    hint = words.hint.replace("{line}", str(start.line + 1)) if start is not None else words.hint
    place = start if words.at_start else at
    mark = Mark(file, 1, 1) if place is None else Mark(file, place.line + 1, place.column + 1)
    return Diagnostic(mark, "", f"not valid YAML: {words.message}", hint, "P101")


def _wrong_indent(text: str, at: yaml.Mark) -> tuple[int, int, _Words] | None:
    """Return line, column and words for a key that libyaml takes for more of the value above it; None: it is
    none."""
    lines = text.splitlines()
    here = lines[at.line]
    indent = len(here) - len(here.lstrip())
    above = next((k for k in range(at.line - 1, -1, -1) if _code(lines[k])), None)
    if above is None or ":" not in here[indent:] or ":" in here[indent : at.column]:
        return None
    before = _code(lines[above])
    column, said = len(before) - len(before.lstrip()), before.strip().removeprefix("- ")
    if _KEY_AND_VALUE.fullmatch(said) and indent > column:
        key = here.strip().partition(":")[0]
        message = f"{key!r} is indented deeper than {said.partition(':')[0]!r} above it, which has a value"
        return at.line + 1, indent + 1, _Words(message, f"begin it in column {column + 1}")
    words = said.split()
    if 1 < len(words) <= 3 and ":" not in said and words[0].isidentifier():
        value = " ".join(words[1:])
        return above + 1, column + len(words[0]) + 1, _Words(
            "a ':' is missing behind this key", f"write '{words[0]}: {value}'"
        )  # fmt: skip
    return None


_KEY_AND_VALUE = re.compile(r"[\w.]+:\s+[^\s{\[|>&!][^:]*")


def _code(line: str) -> str:
    """Return a line without its comment, and without blanks at the end."""
    return re.sub(r"(^|\s)#.*", "", line).rstrip()


def _words(problem: str, context: str, text: str, at: yaml.Mark | None) -> _Words | None:
    character = text[at.index : at.index + 1] if at is not None else ""
    match problem:
        case "found character that cannot start any token":
            return (
                _NO_TAB if character == "\t" else _Words(f"a text cannot begin with {character}", "quote it")
            )
        case "did not find expected node content":
            return _Words(f"a value is missing {f'before {character!r}' if character else 'here'}")
        case "found unexpected end of stream" if "quoted scalar" in context:
            return _NEVER_CLOSED
        case "did not find expected ',' or '}'" | "did not find expected ',' or ']'" if character == "[":
            return _Words("a list cannot begin inside a text", 'quote the whole text, as "items[0]"')
        case "did not find expected key" if at is not None and text[: at.index].rpartition("\n")[2].strip():
            return _Words("this does not belong to the value before it", "quote the whole text")
        case _:
            return _PROBLEMS.get(problem)


Value: TypeAlias = "dict[str, Value] | list[Value] | str | int | float | bool | None"

MAX_DEPTH = 200
MAX_VALUES = 50_000
"""Maximum number of values of one file, keys and expanded aliases included; they are read in less than 0.5
s."""


@dataclass(slots=True)
class YamlNode:
    """A value with its place; `size` and `height` count what an alias would repeat."""

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
    """The text's one document. Raises FileError when the text cannot be read to its end."""
    return _Reader(text, file).read()


_NULL = re.compile(r"(?:null|Null|NULL|~|)")
_BOOL = re.compile(r"(?:true|True|TRUE|false|False|FALSE)")
_INT = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_INFINITE = re.compile(r"([-+]?)\.(?:inf|Inf|INF)")
_NAN = re.compile(r"\.(?:nan|NaN|NAN)")
_REFERENCE = re.compile(r"[A-Za-z_][\w.]*|=.*\S.*")
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
    """A key that stands in braces without a colon: `{item}`."""


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
            self._add_fault(yaml_fault(error, self._text, self._file))
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
            message = f"*{event.anchor} names no finished value"
            self._stop(
                mark, message, "its anchor stands before it; a text that begins with * is quoted", code="P117"
            )
        self._count(target.size, mark)
        if len(self._open) + target.height > MAX_DEPTH:
            self._stop(mark, f"the file is nested more than {MAX_DEPTH} deep", code="P123")
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
                self._fault(mark, where(self._loc()), "the number has too many digits", code="P120")
        if awaiting_key:
            self._key(str(event.value), mark)
            self._open[-1].bare = (
                self._open[-1].flow
                and event.style in (None, "")
                and _REFERENCE.fullmatch(event.value) is not None
                and not _COLON.match(self._text, event.end_mark.index if event.end_mark else 0)
            )
        else:
            self._add(YamlNode(value, mark), mark, event.anchor)

    def _key(self, key: str, mark: Mark) -> None:
        parent = self._open[-1]
        parent.skip = True
        if key in parent.node.keys:
            message, first = f"the key {_shown(key)} is given twice", parent.node.keys[key].line
            self._fault(mark, where((*parent.loc, key)), message, f"first on line {first}", code="P114")
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
            message = f"the file has more than {MAX_VALUES} values, aliases counted out"
            self._stop(mark, message, code="P123")

    def _refuse_tag(self, tag: str | None, mark: Mark) -> None:
        if tag is not None:
            message = f"the tag {_shown(tag.replace('tag:yaml.org,2002:', '!!'))} is not read"
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


def _shown(text: str) -> str:
    return repr(text if len(text) <= 60 else text[:57] + "...")
