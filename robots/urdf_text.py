"""Reader of URDF files: bytes in any encoding, parsed as XML, checked, and returned as elements."""

from __future__ import annotations

import codecs
import re
import xml.etree.ElementTree as ElementTree
from functools import lru_cache
from pathlib import Path
from xml.parsers import expat

from ..files.yaml.file_text import Unreadable, read_bytes
from .urdf_faults import MOVING, UrdfError, urdf_faults

MAX_BYTES = 5_000_000
MAX_DEPTH = 100
"""Greatest number of elements within each other; a URDF has about ten."""


def parsed_urdf(path: Path) -> ElementTree.Element:
    """Return the outermost element of a URDF file, without faults of links and joints.

    Raises UrdfError with all faults when the file cannot be read as XML, or no robot can be built of it.
    Tags keep their namespace prefix, as in other readers of URDFs. A robot without a name gets that of its
    file; products of inertia that are missing are 0, and joints that do not move have no limits. Geometry is
    not checked here.
    """
    try:
        raw = read_bytes(path, MAX_BYTES)
    except Unreadable as error:
        raise UrdfError(error.message) from None
    root = _parsed(_decoded(raw))
    if faults := _faults_of(raw):
        raise UrdfError(*faults)
    _complete(root, path.stem)
    return root


def _complete(root: ElementTree.Element, name: str) -> None:
    """Add what libraries miss that are stricter than others, and remove what they stumble over."""
    if not root.get("name"):
        root.set("name", name)
    for inertia in root.iter("inertia"):
        for key in ("ixy", "ixz", "iyz"):
            inertia.attrib.setdefault(key, "0")
    for joint in root.findall("joint"):
        if joint.get("type") not in MOVING:
            for tag in ("limit", "safety_controller", "mimic"):
                for element in joint.findall(tag):
                    joint.remove(element)
        for limit in joint.findall("limit"):
            for key, value in limit.attrib.items():
                limit.set(key, value.strip())
            for key in ("effort", "velocity"):
                limit.attrib.setdefault(key, "0")
        for controller in joint.findall("safety_controller"):
            controller.attrib.setdefault("k_velocity", "0")


@lru_cache(maxsize=16)
def _faults_of(raw: bytes) -> tuple[str, ...]:
    """Return the faults of a file; it is read several times for one robot, and checked once."""
    return urdf_faults(_parsed(_decoded(raw)))


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


def _text(raw: bytes, encoding: str, told: str) -> str:
    try:
        return raw.decode(encoding)
    except LookupError:
        raise UrdfError(f"the encoding {encoding!r} is not known; save the file as UTF-8") from None
    except UnicodeError as error:
        at = raw.count(b"\n", 0, error.start) + 1 if isinstance(error, UnicodeDecodeError) else 1
        raise UrdfError(f"the file is not {told} (line {at}); save it as UTF-8") from None


def _parsed(text: str) -> ElementTree.Element:
    reader = _Reader()
    try:
        # Editors and tools write lines before the declaration, which the standard forbids.
        return reader.read(_FIRST_LINE.sub(r"\1", text))
    except expat.ExpatError as error:
        raise UrdfError(f"not readable as XML: {error}") from None
    except (UnicodeError, ValueError) as error:
        if isinstance(error, UrdfError):
            raise
        raise UrdfError(f"not readable as XML: {error}") from None


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
            raise UrdfError(f"elements are more than {MAX_DEPTH} levels deep in each other")
        return root

    def _entity(self, name: str, *_: object) -> None:
        raise UrdfError(
            f"entities are not read, as <!ENTITY {name}>; `xmllint --noent FILE` writes a file without them"
        )

    def _skipped(self, name: str, *_: object) -> None:
        raise UrdfError(f"the entity &{name}; is not defined")
