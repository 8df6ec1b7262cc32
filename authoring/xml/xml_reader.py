"""Reader of XML text as elements with places: without entities, with limits, and errors with their places.

The parser is Expat. A DOCTYPE is refused, because entities can multiply the text or open other files.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final, NoReturn
from xml.parsers import expat

from ...files.marks import Diagnostic, FileError, Mark
from .element import Element, one_line
from .repair import repair

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
    """Root element of a file, and notes on what is not XML there, but as BehaviorTree.CPP reads it."""

    root: Element
    notes: tuple[Diagnostic, ...]


def read_xml(text: str, file: str, *, strict: bool = False) -> XmlFile:
    """Read a text. `strict`: only what is XML. Raises FileError."""
    return _XmlReader(text, file, strict=strict).read()


@dataclass(slots=True)
class _Open:
    """Element whose end tag is still to come."""

    name: str
    attributes: Mapping[str, str]
    places: Mapping[str, Mark]
    mark: Mark
    comments: tuple[str, ...]
    end_comments: tuple[str, ...] = ()
    children: list[Element] = field(default_factory=list[Element])
    text: list[str] = field(default_factory=list[str])

    def closed(self) -> Element:
        text = "".join(self.text).strip()
        return Element(
            self.name,
            self.attributes,
            tuple(self.children),
            text,
            self.comments,
            self.mark,
            self.places,
            self.end_comments,
        )


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
        self._open.append(_Open(name, attributes, self._places(at), self._mark(at), comments))

    def _end(self, name: str) -> None:
        self._open[-1].end_comments, self._comments = tuple(self._comments), []
        element = self._open.pop().closed()
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
        open_, hint = self._open[-1] if self._open else None, ""
        match expat.ErrorString(code):
            case "mismatched tag" if open_ is not None:
                message = f"this end does not fit <{open_.name}>, which opens on line {open_.mark.line}"
            case "no element found" if open_ is not None:
                message = f"<{open_.name}>, which opens on line {open_.mark.line}, is not closed"
            case "no element found":
                message, hint = "the file is empty", 'it begins with <root BTCPP_format="4">'
            case "junk after document element":
                message = "something stands after the end of the first element"
            case "undefined entity":
                message, hint = "this entity is not known", "&amp; &lt; &gt; &quot; &apos; are"
            case "reference to invalid character number":
                message = "this is the number of no character"
            case "not well-formed (invalid token)" if self._in_comment(at):
                message, hint = "'--' cannot stand in a comment", "write one '-', or '='"
            case "not well-formed (invalid token)":
                message, hint = "this cannot stand here", "in values write &lt; for < and &amp; for &"
            case other:
                message = other or "it cannot be read"
        self._refuse(at, f"not valid XML: {message}", hint, code="P901")

    def _in_comment(self, at: int) -> bool:
        opened = self._raw.rfind(b"<!--", 0, at)
        return opened >= 0 and self._raw.find(b"-->", opened + 4, at - 1) < 0

    def _refuse(self, at: int, message: str, hint: str = "", *, code: str) -> NoReturn:
        raise FileError([Diagnostic(self._mark(at), "", message, hint, code)])
