"""XML elements with their places and comments: their reader, which repairs what BehaviorTree.CPP's parser
(tinyxml2) overlooks, and their writer.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final, NoReturn
from xml.parsers import expat

from picktree.files import Diagnostic, FileError, Mark

from .btcpp_vocabulary import ELEMENTS

_SLOT = re.compile(r" *[a-z_][\w.*]*: *", re.ASCII)
"""Line with nothing but the key of a slot: `do:`, `otherwise:`, a case."""
_COMMENT = re.compile(r"\s*#+\s?(.*?)\s*")
_UNFIT_FOR_YAML = re.compile(r"[^\t -~\u00a0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]")


class Comments:
    """Comments of one text; each is returned once."""

    def __init__(self, text: str) -> None:
        self._lines = text.split("\n")
        self._given: set[int] = set()

    def at_the_top(self) -> tuple[str, ...]:
        """Return the comments at the start of the file."""
        found: list[str] = []
        for index, line in enumerate(self._lines):
            match = _COMMENT.fullmatch(line)
            if match is None:
                break
            self._given.add(index)
            found.append(match[1])
        return tuple(filter(None, found))

    def above(self, line: int) -> tuple[str, ...]:
        """Return the comments directly above a line, which counts from 1, or above the slot that holds it.

        One that is indented further belongs to the element that ends there.
        """
        found: list[str] = []
        indent = _indent(self._lines[line - 1]) if 0 < line <= len(self._lines) else 0
        for index in range(line - 2, -1, -1):
            if index < len(self._lines) and _SLOT.fullmatch(self._lines[index]):
                indent = _indent(self._lines[index])
                continue
            match = _COMMENT.fullmatch(self._lines[index]) if index < len(self._lines) else None
            if match is None or index in self._given or _indent(self._lines[index]) > indent:
                break
            self._given.add(index)
            found.append(match[1])
        return tuple(filter(None, reversed(found)))

    def rest(self) -> Iterator[LooseComment]:
        """Yield the comments that have not been returned, in the order of the file."""
        for index, text in enumerate(self._lines):
            match = _COMMENT.fullmatch(text)
            if match is not None and index not in self._given:
                self._given.add(index)
                if match[1]:
                    yield LooseComment(index + 1, _indent(text), match[1])


@dataclass(frozen=True, slots=True)
class LooseComment:
    """Comment behind the last part of an element: its line, which counts from 1, its indent and its text."""

    line: int
    indent: int
    text: str


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def one_line(comment: str) -> str:
    """Return the comment as one line that any file can hold."""
    return _UNFIT_FOR_YAML.sub("", " ".join(comment.split()))


NOWHERE: Final = Mark("", 1, 1)


@dataclass(frozen=True, slots=True)
class Element:
    """XML element. `text`: text between the tags next to children. `comments`: comments before the element.

    Two elements are equal when their content is, wherever they are.
    """

    name: str
    attributes: Mapping[str, str] = field(default_factory=dict[str, str])
    children: tuple[Element, ...] = ()
    text: str = ""
    comments: tuple[str, ...] = field(default=(), compare=False)
    mark: Mark = field(default=NOWHERE, compare=False)
    places: Mapping[str, Mark] = field(default_factory=dict[str, Mark], compare=False)
    """Places of the attributes' values."""
    end_comments: tuple[str, ...] = field(default=(), compare=False)
    """Comments behind the last child."""
    comments_below: tuple[str, ...] = field(default=(), compare=False)
    """Comments below the element; only the root has them."""

    def get(self, attribute: str, default: str = "") -> str:
        return self.attributes.get(attribute, default)

    @property
    def identity(self) -> str:
        """ID of the element's node: its name, or in the explicit form its attribute ID."""
        return self.get("ID") if self.name in ELEMENTS else self.name

    def place(self, attribute: str) -> Mark:
        """Return the place of an attribute's value; for a missing one, that of the element."""
        return self.places.get(attribute, self.mark)

    def all(self, name: str) -> tuple[Element, ...]:
        """Return the children of that name."""
        return tuple(child for child in self.children if child.name == name)

    def iterate(self) -> Iterator[Element]:
        """Yield this element and its descendants, parents first."""
        yield self
        for child in self.children:
            yield from child.iterate()


_NEXT = re.compile(r"[<&]")
_TAG = re.compile(r"""<[A-Za-z_:][^\s/>="'<]*(?:\s+[^\s=<>/"']+\s*=\s*(?:"[^"]*"|'[^']*'))+\s*/?>""")
_VALUE = re.compile(r""""[^"]*"|'[^']*'""")
_LONE_AMPERSAND = re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#\d{1,8}|#x[0-9a-fA-F]{1,8});)")
_IN_VALUE = re.compile(rf"{_LONE_AMPERSAND.pattern}|<|\t|\r\n|\r|\n")
_VALUE_ESCAPES = {"&": "&amp;", "<": "&lt;", "\t": "&#9;", "\r\n": "&#10;", "\r": "&#10;", "\n": "&#10;"}
_ENDS = {"<!--": "-->", "<![CDATA[": "]]>", "<?": "?>"}
_MESSAGES = {
    "&": ("'&' without an entity; it is read as BehaviorTree.CPP reads it", "write &amp;"),
    "<": ("'<' in a value; it is read as BehaviorTree.CPP reads it", "write &lt;"),
    "--": ("'--' in a comment, which XML forbids", "write one '-', or '='"),
}


@dataclass(frozen=True, slots=True)
class Repair:
    """Kind of repair: the first place, as an index into the text's bytes, and the number of places."""

    at: int
    message: str
    hint: str
    count: int


@dataclass(slots=True)
class RepairedXml:
    """Text for an XML parser, and the way back from its bytes to those of the original."""

    text: str = ""
    repairs: tuple[Repair, ...] = ()
    _starts: list[int] = field(default_factory=lambda: [0])
    """First byte of each unchanged part in the repaired text."""
    _origins: list[int] = field(default_factory=lambda: [0])
    """First byte of each unchanged part in the original text."""

    def original(self, at: int) -> int:
        """Return the byte of the original text for one of the repaired text."""
        part = bisect_right(self._starts, at) - 1
        return self._origins[part] + at - self._starts[part]

    def add(self, start: int, origin: int) -> None:
        """Note where an unchanged part begins."""
        self._starts.append(start)
        self._origins.append(origin)


@dataclass(frozen=True, slots=True)
class _Edit:
    start: int
    end: int
    text: str
    kind: str = ""
    """Key of its message; empty: nothing is reported."""


def repair(text: str, *, strict: bool = False) -> RepairedXml:
    """Return the text with escapes where tinyxml2 does without. `strict`: only line breaks and tabs."""
    found = RepairedXml()
    pieces: list[str] = []
    first: dict[str, int] = {}
    counts: dict[str, int] = {}
    at, done, origin = 0, 0, 0
    for edit in _edits(text):
        if strict and edit.kind:
            continue
        kept = text[at : edit.start]
        size = len(kept.encode("utf-8", "surrogatepass"))
        if edit.kind:
            first.setdefault(edit.kind, origin + size)
            counts[edit.kind] = counts.get(edit.kind, 0) + 1
        pieces += [kept, edit.text]
        done += size + len(edit.text)
        origin += size + edit.end - edit.start
        found.add(done, origin)
        at = edit.end
    found.text = "".join([*pieces, text[at:]])
    found.repairs = tuple(Repair(first[kind], *_MESSAGES[kind], counts[kind]) for kind in first)
    return found


def _edits(text: str) -> Iterator[_Edit]:
    """Yield the edits in the order of the text. All replaced characters are ASCII."""
    at = 0
    while match := _NEXT.search(text, at):
        at = match.start()
        if match[0] == "&":
            if _LONE_AMPERSAND.match(text, at):
                yield _Edit(at, at + 1, _VALUE_ESCAPES["&"], "&")
            at += 1
            continue
        opening = next((each for each in _ENDS if text.startswith(each, at)), "")
        if opening:
            end = text.find(_ENDS[opening], at + len(opening))
            if end < 0:
                return
            if opening == "<!--":
                yield from _dashes(text, at + len(opening), end)
            at = end + len(_ENDS[opening])
            continue
        tag = _TAG.match(text, at)
        if tag is None:
            at += 1
            continue
        for value in _VALUE.finditer(tag[0]):
            for unfit in _IN_VALUE.finditer(value[0]):
                start = at + value.start() + unfit.start()
                kind = unfit[0] if unfit[0] in _MESSAGES else ""
                yield _Edit(start, start + len(unfit[0]), _VALUE_ESCAPES[unfit[0]], kind)
        at = tag.end()


def _dashes(text: str, start: int, end: int) -> Iterator[_Edit]:
    """Yield edits of the same length for each `--` in a comment, and for a `-` at its end."""
    for match in re.finditer(r"-(?=-)|-$", text[start:end]):
        yield _Edit(start + match.start(), start + match.end(), "~", "--")


MAX_XML_CHARACTERS: Final = 4_000_000
MAX_ELEMENT_DEPTH: Final = 100
MAX_ELEMENTS: Final = 20_000
MAX_ATTRIBUTES: Final = 1000
"""Maximum number of attributes of one element."""
_ATTRIBUTE = re.compile(rb"""\s+([^\s=]+)\s*=\s*("[^"]*"|'[^']*')""")
_NAME = re.compile(rb"<[^\s/>]+")
_ENCODING = re.compile(r"""\s*<\?xml[^>]*?\sencoding\s*=\s*["']([^"']*)["']""")
_BREAK = re.compile(r"\r\n|\r|\n")


@dataclass(frozen=True, slots=True)
class XmlFile:
    """Root element of a file, and notes on content that is no XML, but that BehaviorTree.CPP accepts."""

    root: Element
    notes: tuple[Diagnostic, ...]


def read_xml(text: str, file: str, *, strict: bool = False) -> XmlFile:
    """Read a text. `strict`: only valid XML. Raises FileError."""
    return _XmlReader(text, file, strict=strict).read()


@dataclass(slots=True)
class _Open:
    """Element whose end tag is still to come."""

    head: Element
    """Start tag, with the comments before it."""
    children: list[Element] = field(default_factory=list[Element])
    text: list[str] = field(default_factory=list[str])

    def closed(self, end_comments: tuple[str, ...]) -> Element:
        head, text, inner = self.head, "".join(self.text).strip(), tuple(self.children)
        kept = (head.comments, head.mark, head.places, end_comments)
        return Element(head.name, head.attributes, inner, text, *kept)


class _XmlReader:
    def __init__(self, text: str, file: str, *, strict: bool) -> None:
        self._file = file
        self._too_large = len(text) > MAX_XML_CHARACTERS
        self._source = repair("" if self._too_large else text, strict=strict)
        self._written = text.encode("utf-8", "surrogatepass")
        self._raw = self._source.text.encode("utf-8", "surrogatepass")
        self._at, self._line, self._column = 0, 1, 1
        self._open: list[_Open] = []
        self._comments: list[str] = []
        self._count = 0
        self._root: Element | None = None

    def read(self) -> XmlFile:
        if self._too_large:
            message = f"the file is larger than {MAX_XML_CHARACTERS // 1_000_000} MB"
            self._refuse(0, message, code="P903")
        self._check_encoding()
        parser = self._parser = expat.ParserCreate("UTF-8")
        parser.buffer_text = True
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._data
        parser.CommentHandler = self._comment
        parser.StartDoctypeDeclHandler = self._doctype
        try:
            parser.Parse(self._raw, True)
        except expat.ExpatError as error:
            self._malformed(error)
        assert self._root is not None  # expat complains of a file without an element
        if self._comments:
            self._root = replace(self._root, comments_below=tuple(self._comments))
        return XmlFile(self._root, tuple(self._notes()))

    def _check_encoding(self) -> None:
        """Refuse another encoding than UTF-8 where it matters: the text has been decoded as UTF-8."""
        declared = _ENCODING.match(self._source.text)
        name = declared[1].lower() if declared else "utf-8"
        if name not in ("utf-8", "utf8") and not self._source.text.isascii():
            message = f"the file says that its encoding is {declared[1] if declared else name}, not UTF-8"
            self._refuse(declared.start(1) if declared else 0, message, "save it as UTF-8", code="P901")

    def _notes(self) -> Iterator[Diagnostic]:
        for found in self._source.repairs:
            mark = self._mark_written(found.at)
            more = f", {found.count} times in this file" if found.count > 1 else ""
            yield Diagnostic(mark, "", f"{found.message}{more}", found.hint, "P901", "warning")

    # Called by Expat.

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        at = self._parser.CurrentByteIndex
        self._count += 1
        if self._count > MAX_ELEMENTS:
            self._refuse(at, f"the file has more than {MAX_ELEMENTS} elements", code="P903")
        if len(self._open) >= MAX_ELEMENT_DEPTH:
            self._refuse(at, f"the elements are nested more than {MAX_ELEMENT_DEPTH} deep", code="P903")
        if len(attributes) > MAX_ATTRIBUTES:
            self._refuse(at, f"an element has more than {MAX_ATTRIBUTES} attributes", code="P903")
        comments, self._comments = tuple(self._comments), []
        head = Element(name, attributes, comments=comments, mark=self._mark(at), places=self._places(at))
        self._open.append(_Open(head))

    def _end(self, name: str) -> None:
        element = self._open.pop().closed(tuple(self._comments))
        self._comments = []
        if self._open:
            self._open[-1].children.append(element)
        else:
            self._root = element

    def _data(self, text: str) -> None:
        if self._open:
            self._open[-1].text.append(text)

    def _comment(self, _: str) -> None:
        start = self._source.original(self._parser.CurrentByteIndex) + len(b"<!--")
        end = self._written.find(b"-->", start)
        if comment := one_line(self._written[start:end].decode("utf-8", "replace")):
            self._comments.append(comment)

    def _doctype(self, *_: object) -> None:
        at = self._raw.rfind(b"<!DOCTYPE", 0, self._parser.CurrentByteIndex + 1)
        message = "a DOCTYPE is not read: it could declare entities"
        self._refuse(max(at, 0), message, "leave it out", code="P902")

    # Places.

    def _mark(self, at: int) -> Mark:
        """Return the place of a byte. Requests mostly ascend, so the search continues from the last one."""
        return self._mark_written(self._source.original(at))

    def _mark_written(self, at: int) -> Mark:
        if at < self._at:
            self._at, self._line, self._column = 0, 1, 1
        between = self._written[self._at : at].decode("utf-8", "replace")
        lines = _BREAK.split(between)
        self._line += len(lines) - 1
        self._column = len(lines[-1]) + (1 if len(lines) > 1 else self._column)
        self._at = at
        return Mark(self._file, self._line, self._column)

    def _places(self, at: int) -> dict[str, Mark]:
        """Return the places of the start tag's attribute values, which Expat does not report."""
        name = _NAME.match(self._raw, at)
        at = name.end() if name else at
        places: dict[str, Mark] = {}
        while match := _ATTRIBUTE.match(self._raw, at):
            places[match[1].decode("utf-8", "replace")] = self._mark(match.start(2) + 1)
            at = match.end()
        return places

    # Refusals.

    def _malformed(self, error: expat.ExpatError) -> NoReturn:
        at = min(max(self._parser.ErrorByteIndex, 0), len(self._raw))
        code = getattr(error, "code", 0)
        open_, hint = self._open[-1].head if self._open else None, ""
        match expat.ErrorString(code):
            case "mismatched tag" if open_ is not None:
                message = f"this end does not fit <{open_.name}>, which opens on line {open_.mark.line}"
            case "no element found" if open_ is not None:
                message = f"<{open_.name}>, which opens on line {open_.mark.line}, is not closed"
            case "no element found":
                message, hint = "the file is empty", 'it begins with <root BTCPP_format="4">'
            case "junk after document element":
                message = "there is content after the end of the first element"
            case "undefined entity":
                message, hint = "this entity is not known", "&amp; &lt; &gt; &quot; &apos; are"
            case "reference to invalid character number":
                message = "this is the number of no character"
            case "not well-formed (invalid token)" if self._in_comment(at):
                message, hint = "'--' is not allowed in a comment", "write one '-', or '='"
            case "not well-formed (invalid token)":
                message, hint = "this is not allowed here", "in values write &lt; for < and &amp; for &"
            case other:
                message = other or "it cannot be read"
        self._refuse(at, f"not valid XML: {message}", hint, code="P901")

    def _in_comment(self, at: int) -> bool:
        opened = self._raw.rfind(b"<!--", 0, at)
        return opened >= 0 and self._raw.find(b"-->", opened + 4, at - 1) < 0

    def _refuse(self, at: int, message: str, hint: str = "", *, code: str) -> NoReturn:
        raise FileError([Diagnostic(self._mark(at), "", message, hint, code)])


MAX_LINE_LENGTH = 110
"""Maximum length of a line; longer elements have each attribute on a separate line."""
_UNFIT = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_ESCAPES = {"&": "&amp;", "<": "&lt;", ">": "&gt;"}
_IN_ATTRIBUTES = {**_ESCAPES, '"': "&quot;", "\t": "&#9;", "\n": "&#10;", "\r": "&#13;"}


def unfit(text: str) -> str:
    """Return the first character that no XML file can hold; empty without one."""
    found = _UNFIT.search(text)
    return found[0] if found else ""


def to_text(root: Element) -> str:
    """Return the text of the whole file. The element must be free of characters that are `unfit`."""
    below = (f"<!-- {_in_comment(comment)} -->" for comment in root.comments_below)
    return "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', *_lines(root, ""), *below, ""])


def _lines(element: Element, indent: str) -> Iterator[str]:
    for comment in element.comments:
        yield f"{indent}<!-- {_in_comment(comment)} -->"
    words = [f'{key}="{_escaped(value, _IN_ATTRIBUTES)}"' for key, value in element.attributes.items()]
    start = " ".join([f"{indent}<{element.name}", *words])
    if len(start) > MAX_LINE_LENGTH and len(words) > 1:
        start = f"\n{indent}    ".join([f"{indent}<{element.name}", *words])
    if element.text:
        yield f"{start}>{_escaped(element.text, _ESCAPES)}</{element.name}>"
    elif not element.children:
        yield f"{start}/>"
    else:
        yield f"{start}>"
        for child in element.children:
            yield from _lines(child, indent + "  ")
        for comment in element.end_comments:
            yield f"{indent}  <!-- {_in_comment(comment)} -->"
        yield f"{indent}</{element.name}>"


def _in_comment(text: str) -> str:
    """Return the text with double hyphens split, which would end the comment."""
    return re.sub(r"-(?=-|$)", "- ", text).rstrip()


def _escaped(text: str, escapes: dict[str, str]) -> str:
    return "".join(escapes.get(character, character) for character in text)
