"""XML file with the files that it includes: its trees, their models, and the head of the mission.

Reader of XML text as elements with places: without entities, with limits, and errors with their places.

The parser is Expat. A DOCTYPE is refused, because entities can multiply the text or open other files.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NoReturn
from xml.parsers import expat

from ....files.marks import Diagnostic, FileError, Mark
from ....files.shipped_files import is_file
from ....files.value_wording import suggest_name
from ....files.yaml.file_text import read_text
from ....trees.mission import MAIN
from ..format import btcpp_vocabulary
from ..format.element import Element, one_line
from ..format.tree_nodes_model import INCLUDED

MAX_XML_CHARACTERS: Final = 4_000_000
MAX_ELEMENT_DEPTH: Final = 100
MAX_ELEMENTS: Final = 20_000
MAX_ATTRIBUTES: Final = 1000
"""Maximum number of attributes of one element."""
_ATTRIBUTE = re.compile(rb"""\s+([^\s=]+)\s*=\s*("[^"]*"|'[^']*')""")
_NAME = re.compile(rb"<[^\s/>]+")
_BREAK = re.compile(r"\r\n|\r|\n")


def read_xml(text: str, file: str) -> Element:
    """Return the root element. Raises FileError."""
    return _XmlReader(text, file).read()


@dataclass(slots=True)
class _Open:
    """Element whose end tag is still to come."""

    name: str
    attributes: Mapping[str, str]
    places: Mapping[str, Mark]
    mark: Mark
    comments: tuple[str, ...]
    children: list[Element] = field(default_factory=list[Element])
    text: list[str] = field(default_factory=list[str])

    def closed(self) -> Element:
        text = "".join(self.text).strip()
        return Element(
            self.name, self.attributes, tuple(self.children), text, self.comments, self.mark, self.places
        )


class _XmlReader:
    def __init__(self, text: str, file: str) -> None:
        self._raw = text.encode("utf-8", "surrogatepass")
        self._file = file
        self._too_large = len(text) > MAX_XML_CHARACTERS
        self._at, self._line, self._column = 0, 1, 1
        self._open: list[_Open] = []
        self._comments: list[str] = []
        self._count = 0
        self._root: Element | None = None

    def read(self) -> Element:
        if self._too_large:
            message = f"the file is larger than {MAX_XML_CHARACTERS // 1_000_000} MB"
            self._refuse(0, message, code="P903")
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
        return self._root

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
        element = self._open.pop().closed()
        self._comments = []
        if self._open:
            self._open[-1].children.append(element)
        else:
            self._root = element

    def _data(self, text: str) -> None:
        if self._open:
            self._open[-1].text.append(text)

    def _comment(self, text: str) -> None:
        if comment := one_line(text):
            self._comments.append(comment)

    def _doctype(self, *_: object) -> None:
        at = self._raw.rfind(b"<!DOCTYPE", 0, self._parser.CurrentByteIndex + 1)
        message = "a DOCTYPE is not read: it could declare entities"
        self._refuse(max(at, 0), message, "leave it out", code="P902")

    # Places.

    def _mark(self, at: int) -> Mark:
        """Return the place of a byte. Requests mostly ascend, so the search continues from the last one."""
        if at < self._at:
            self._at, self._line, self._column = 0, 1, 1
        between = self._raw[self._at : at].decode("utf-8", "replace")
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
            case "not well-formed (invalid token)":
                message, hint = "this cannot stand here", "in values write &lt; for < and &amp; for &"
            case other:
                message = other or "it cannot be read"
        self._refuse(at, f"not valid XML: {message}", hint, code="P901")

    def _refuse(self, at: int, message: str, hint: str = "", *, code: str) -> NoReturn:
        raise FileError([Diagnostic(self._mark(at), "", message, hint, code)])


MAX_FILES = 50
_PARTS = ("BehaviorTree", "TreeNodesModel", "include")
_HEAD = ("picktree", "library", "name", "scene", "goal", "include", "plugins", INCLUDED)


@dataclass(frozen=True, slots=True)
class MetadataEntry:
    """One entry of the metadata, as `scene="three_bins"`."""

    key: str
    value: str
    mark: Mark


@dataclass(slots=True)
class XmlSource:
    """Content of the source. `main` is the name of the first tree; empty for a library."""

    root: Element
    main: str = ""
    trees: dict[str, Element] = field(default_factory=dict[str, Element])
    """BehaviorTree elements by ID."""
    models: dict[str, Element] = field(default_factory=dict[str, Element])
    """SubTree elements of the models by ID."""
    head: list[MetadataEntry] = field(default_factory=list[MetadataEntry])
    included: set[str] = field(default_factory=set[str])
    """Names of the trees that the mission includes from other mission files."""
    faults: list[Diagnostic] = field(default_factory=list[Diagnostic])

    def said(self, key: str) -> tuple[MetadataEntry, ...]:
        return tuple(said for said in self.head if said.key == key)


def read_source(text: str, path: Path) -> XmlSource:
    """Read the source. Raises FileError when the file is unreadable; other errors are in `faults`."""
    root = read_xml(text, str(path))
    return _Reader(path, root).read()


class _Reader:
    def __init__(self, path: Path, root: Element) -> None:
        self._path = path
        self._source = XmlSource(root)
        self._files: dict[str, str] = {}

    def read(self) -> XmlSource:
        root = self._source.root
        self._file(root, self._path, (self._path.name,))
        if not self._source.faults:
            self._source.main = self._main(root)
        return self._source

    def _fault(self, mark: Mark, trail: str, message: str, hint: str = "", *, code: str) -> None:
        self._source.faults.append(Diagnostic(mark, trail, message, hint, code))

    def _file(self, root: Element, path: Path, trail: tuple[str, ...]) -> None:
        if root.name != "root":
            message = f"the first element is <root>, not <{root.name}>"
            self._fault(
                root.mark, "", message, f'as <root BTCPP_format="{btcpp_vocabulary.XML_FORMAT}">', code="P904"
            )
            return
        version = root.attributes.get("BTCPP_format")
        if version != btcpp_vocabulary.XML_FORMAT:
            message = 'BTCPP_format="4" is missing' if version is None else f"format {version!r} is not read"
            hint = "this reads the files of BehaviorTree.CPP 4 and Groot2; convert older ones there"
            self._fault(root.place("BTCPP_format"), "root", message, hint, code="P904")
            return
        for name in root.attributes:
            known = ("BTCPP_format", "main_tree_to_execute")
            if name not in (*known, "project_name") and not name.startswith(("xmlns", "xsi:")):
                hint = suggest_name(name, known)
                self._fault(root.place(name), "root", f"<root> has no attribute {name!r}", hint, code="P908")
        self._no_text(root, "root")
        for part in root.children:
            match part.name:
                case "BehaviorTree":
                    self._tree(part, len(root.all("BehaviorTree")))
                case "TreeNodesModel":
                    self._models(part, first=len(trail) == 1)
                case "include":
                    self._include(part, path, trail)
                case name:
                    message = f"<{name}> has no meaning under <root>"
                    self._fault(part.mark, "root", message, suggest_name(name, _PARTS), code="P905")
        for second in root.all("TreeNodesModel")[1:]:
            self._fault(second.mark, "root", "a second <TreeNodesModel> in one file", code="P905")

    def _tree(self, element: Element, trees: int) -> None:
        identity = element.get("ID") or (MAIN if trees == 1 else "")
        if not identity:
            self._fault(element.mark, "root", "<BehaviorTree> needs the attribute 'ID'", code="P905")
            return
        self._attributes(element, ("ID",), identity)
        self._no_text(element, identity)
        if identity in self._source.trees:
            first = self._source.trees[identity].mark
            message = f"the tree {identity!r} is given twice"
            self._fault(element.place("ID"), identity, message, f"first at {first}", code="P905")
            return
        self._source.trees[identity] = element
        if len(element.children) != 1:
            message = f"<BehaviorTree> has {len(element.children)} children; it takes 1"
            self._fault(element.mark, identity, message, "several stand in a Sequence", code="P909")

    def _attributes(self, element: Element, known: Iterable[str], trail: str) -> None:
        for name in element.attributes:
            if name not in known and name not in btcpp_vocabulary.IGNORED:
                message = f"<{element.name}> has no attribute {name!r}"
                self._fault(element.place(name), trail, message, suggest_name(name, known), code="P908")

    def _no_text(self, element: Element, trail: str) -> None:
        if element.text:
            message = f"the text {element.text[:30]!r} has no meaning here"
            self._fault(element.mark, trail, message, "a comment stands in <!-- -->", code="P905")

    def _models(self, element: Element, *, first: bool) -> None:
        for model in element.children:
            identity = model.get("ID")
            if model.name not in btcpp_vocabulary.ELEMENTS:
                message = f"<{model.name}> has no meaning under <TreeNodesModel>"
                hint = suggest_name(model.name, btcpp_vocabulary.ELEMENTS)
                self._fault(model.mark, "TreeNodesModel", message, hint, code="P905")
            elif not identity:
                message = f"<{model.name}> needs the attribute 'ID'"
                self._fault(model.mark, "TreeNodesModel", message, code="P905")
            elif model.name == "SubTree":
                self._source.models.setdefault(identity, model)
                self._metadata(identity, model, first=first)

    def _metadata(self, identity: str, model: Element, *, first: bool) -> None:
        """Read the mission's head from the first file; heads of other files are ignored."""
        for fields in model.all("MetadataFields"):
            for entry in fields.all("Metadata"):
                for key, value in entry.attributes.items():
                    if key == INCLUDED:
                        self._source.included.add(identity)
                    elif key in _HEAD and first:
                        self._source.head.append(MetadataEntry(key, value, entry.place(key)))

    # Other files.

    def _include(self, element: Element, path: Path, trail: tuple[str, ...]) -> None:
        name = element.get("path")
        at = element.place("path")
        if "ros_pkg" in element.attributes:
            message = "<include ros_pkg> is not followed: it leads to where ROS is installed"
            self._fault(
                element.place("ros_pkg"), "root", message, "copy the file beside this one", code="P912"
            )
            return
        if not name or "\x00" in name:
            self._fault(element.mark, "root", "<include> needs the attribute 'path'", code="P912")
            return
        found = path.parent / name
        relative = os.path.relpath(found, self._path.parent)
        if not _inside(found, self._path.parent):
            message = f"{name!r} lies outside of the file's folder"
            self._fault(at, "root", message, "copy it beside this file", code="P912")
        elif relative in trail:
            message = f"the files include each other in a circle: {' → '.join((*trail, relative))}"
            self._fault(at, "root", message, code="P912")
        elif len(self._files) >= MAX_FILES:
            self._fault(at, "root", f"more than {MAX_FILES} files are included", code="P912")
        elif not is_file(found):
            self._fault(at, "root", f"there is no file {name!r} beside this one", code="P912")
        elif relative not in self._files:
            self._files[relative] = name
            self._follow(found, (*trail, relative))

    def _follow(self, path: Path, trail: tuple[str, ...]) -> None:
        try:
            root = read_xml(read_text(path), str(path))
        except FileError as error:
            self._source.faults += error.faults
            return
        self._file(root, path, trail)

    # First tree of the mission.

    def _main(self, root: Element) -> str:
        main, trees = root.get("main_tree_to_execute"), self._source.trees
        if main:
            if main not in trees:
                hint = suggest_name(main, trees)
                message = f"there is no tree {main!r}"
                self._fault(root.place("main_tree_to_execute"), "root", message, hint, code="P914")
            return main
        if any(said.value == "true" for said in self._source.said("library")):
            return ""
        if len(trees) == 1:
            return next(iter(trees))
        message = f"which of the {len(trees)} trees is the first one?" if trees else "there is no tree"
        hint = f'as <root BTCPP_format="4" main_tree_to_execute="{next(iter(trees), MAIN)}">'
        self._fault(root.mark, "root", message, hint, code="P914")
        return ""


def _inside(path: Path, folder: Path) -> bool:
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # a circle of symbolic links
        return False
