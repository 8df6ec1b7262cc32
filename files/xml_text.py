"""Reader of XML files: bytes in any encoding become text, and elements without entities."""

from __future__ import annotations

import codecs
import re
import xml.etree.ElementTree as ElementTree
from xml.parsers import expat

MAX_DEPTH = 100
"""Greatest number of elements within each other; a URDF has about ten."""


class XmlError(ValueError):
    """Error of a file that is not readable as XML; the text is one sentence."""


def parse_xml(raw: bytes) -> ElementTree.Element:
    """Return the outermost element of an XML file's content. Tags keep their namespace prefix.

    Raises XmlError for content that is no XML, that has entities, or that is more than MAX_DEPTH levels deep.
    """
    reader = _Reader()
    try:
        return reader.read(decode_xml(raw))
    except (expat.ExpatError, UnicodeError) as error:
        raise XmlError(f"not readable as XML: {error}") from None


def decode_xml(raw: bytes) -> str:
    """Return the text of an XML file without its first line's declaration. Raises XmlError.

    Its byte order mark counts more than the encoding that it declares.
    """
    # Editors and tools write lines before the declaration, which the standard forbids.
    return _FIRST_LINE.sub(r"\1", _decoded(raw))


_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
"""Byte order marks; those of UTF-32 begin like those of UTF-16."""
_STARTS = (
    (b"<\0\0\0", "utf-32-le"),
    (b"\0\0\0<", "utf-32-be"),
    (b"<\0", "utf-16-le"),
    (b"\0<", "utf-16-be"),
)
"""First bytes of XML without a byte order mark in encodings with several bytes a character."""
_FIRST_LINE = re.compile(r"\A(\s*)<\?xml\s[^>]*\?>")
_DECLARATION = re.compile(rb"""\s*<\?xml[^>]*?\sencoding\s*=\s*["']([^"']*)["']""")


def _decoded(raw: bytes) -> str:
    """Return the text of a file. Its byte order mark counts more than the encoding that it declares."""
    for mark, encoding in _MARKS:
        if raw.startswith(mark):
            return _text(raw[len(mark) :], encoding, f"{encoding.upper()} by its byte order mark")
    for start, encoding in _STARTS:
        if raw.startswith(start):
            return _text(raw, encoding, f"{encoding.upper()} by its first bytes")
    declared = _DECLARATION.match(raw)
    if declared is None:
        return _text(raw, "utf-8", "UTF-8, for lack of encoding=… in its first line")
    name = declared[1].decode("ascii", "replace")
    return _text(raw, name, f"{name} by its first line")


def _text(raw: bytes, encoding: str, name: str) -> str:
    try:
        return raw.decode(encoding)
    except LookupError:
        raise XmlError(f"the encoding {encoding!r} is not known; save the file as UTF-8") from None
    except UnicodeError as error:
        at = raw.count(b"\n", 0, error.start) + 1 if isinstance(error, UnicodeDecodeError) else 1
        raise XmlError(f"the file is not {name} (line {at}); save it as UTF-8") from None


class _Reader:
    """XML parser without entities and namespaces, of limited depth."""

    def __init__(self) -> None:
        self._builder = ElementTree.TreeBuilder()
        self._parser = expat.ParserCreate("utf-8")
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._builder.start
        self._parser.EndElementHandler = self._builder.end
        self._parser.CharacterDataHandler = self._builder.data
        self._parser.EntityDeclHandler = self._entity
        self._parser.SkippedEntityHandler = self._skipped

    def read(self, text: str) -> ElementTree.Element:
        self._parser.Parse(text.encode(), True)
        root = self._builder.close()
        level, depth = [root], 0
        while level:
            level, depth = [child for element in level for child in element], depth + 1
        if depth > MAX_DEPTH:
            raise XmlError(f"elements are more than {MAX_DEPTH} levels deep in each other")
        return root

    def _entity(self, name: str, *_: object) -> None:
        raise XmlError(
            f"entities are not read, as <!ENTITY {name}>; `xmllint --noent FILE` writes a file without them"
        )

    def _skipped(self, name: str, *_: object) -> None:
        raise XmlError(f"the entity &{name}; is not defined")
