"""XML files with the files that they include: their trees, their models, the head of the mission, and faults
of the import.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from picktree.files import Diagnostic, FileError, Mark, file_system, suggest_name
from picktree.files.yaml import file_text
from picktree.trees import MAIN

from . import btcpp_vocabulary
from .element import Element, read_xml
from .tree_nodes_model import INCLUDED


class ImportFaults:
    """Collector of an import's diagnostics. `strict`: notes are errors, each at its own place."""

    def __init__(self, *, strict: bool = False) -> None:
        self.strict = strict
        self._faults: list[Diagnostic] = []
        self._notes: dict[tuple[str, str, str], tuple[Diagnostic, int]] = {}

    def fault(self, mark: Mark, trail: str, message: str, hint: str = "", *, code: str) -> None:
        self._faults.append(Diagnostic(mark, trail, message, hint, code))

    def note(self, mark: Mark, trail: str, message: str, hint: str = "", *, code: str) -> None:
        """Add a note; the same one in one file is reported once, with its count."""
        if self.strict:
            self.fault(mark, trail, message, hint, code=code)
            return
        first, count = self._notes.get((mark.file, code, message), (None, 0))
        known = first or Diagnostic(mark, trail, message, hint, code, "warning")
        self._notes[mark.file, code, message] = known, count + 1

    def add(self, *diagnostics: Diagnostic) -> None:
        self._faults += diagnostics

    @property
    def errors(self) -> bool:
        return any(fault.severity == "error" for fault in self._faults)

    def all(self) -> tuple[Diagnostic, ...]:
        counted = (
            replace(note, message=f"{note.message}, at {count} places") if count > 1 else note
            for note, count in self._notes.values()
        )
        return (*self._faults, *counted)


MAX_FILES = 300
_PARTS = ("BehaviorTree", "TreeNodesModel", "include")
_HEAD = ("picktree", "library", "name", "scene", "goal", "include", "plugins", INCLUDED)
_FORMAT_3 = ("SubTreePlus", "SequenceStar", "RetryUntilSuccesful", "BlackboardCheckInt",
             "BlackboardCheckDouble", "BlackboardCheckString", "BlackboardCheckBool")  # fmt: skip
"""Nodes that only format 3 has."""


@dataclass(frozen=True, slots=True)
class XmlText:
    """Text of an XML file and the place of the file."""

    text: str
    path: Path


@dataclass(frozen=True, slots=True)
class MetadataEntry:
    """Entry of the metadata, as `scene="three_bins"`."""

    key: str
    value: str
    mark: Mark


@dataclass(slots=True)
class XmlSource:
    """Content of the files. `main` is the name of the first tree; empty for a library."""

    root: Element
    main: str = ""
    trees: dict[str, Element] = field(default_factory=dict[str, Element])
    """BehaviorTree elements by ID."""
    models: dict[str, Element] = field(default_factory=dict[str, Element])
    """SubTree elements of the models by ID."""
    node_models: dict[str, Element] = field(default_factory=dict[str, Element])
    """The other elements of the models by ID."""
    head: list[MetadataEntry] = field(default_factory=list[MetadataEntry])
    included: set[str] = field(default_factory=set[str])
    """Names of the trees that the mission includes from other mission files."""
    names: dict[str, str] = field(default_factory=dict[str, str])
    """Name in the mission by the tree's ID, where the two differ."""

    def said(self, key: str) -> tuple[MetadataEntry, ...]:
        return tuple(said for said in self.head if said.key == key)

    def called(self, name: str) -> str:
        """Return the tree's name in the mission."""
        return self.names.get(name, name)


def read_source(files: Sequence[XmlText], faults: ImportFaults, main: str = "") -> XmlSource:
    """Read files that belong together. `main`: ID of the first tree, by default the one that the files name.

    Raises FileError when a file is no XML; other errors go to `faults`.
    """
    return _Reader(files, faults, main).read()


class _Reader:
    def __init__(self, files: Sequence[XmlText], faults: ImportFaults, main: str) -> None:
        self._texts = {os.path.abspath(file.path): file for file in files}
        self._folder = files[0].path.parent
        self._faults = faults
        self._asked = main
        self._known: dict[str, None] = {}
        """Paths of the files that have been read."""
        self._roots: list[Element] = []
        self._source = XmlSource(Element("root"))

    def read(self) -> XmlSource:
        for place, file in self._texts.items():
            if place not in self._known:
                self._known[place] = None
                self._read(file.text, file.path, (file.path.name,))
        if not self._roots:
            raise FileError(self._faults.all())
        self._source.root = self._roots[0]
        self._source.main = self._main()
        if len(self._roots) > 1 and self._source.main:
            self._reachable()
        return self._source

    def _read(self, text: str | None, path: Path, trail: tuple[str, ...]) -> None:
        """Read a file; without a text it is one that another file includes."""
        try:
            content = file_text.read_text(path) if text is None else text
            read = read_xml(content, str(path), strict=self._faults.strict)
        except FileError as error:
            self._faults.add(*error.faults)
            return
        self._faults.add(*read.notes)
        if text is not None:
            self._roots.append(read.root)
        self._file(read.root, path, trail)

    def _file(self, root: Element, path: Path, trail: tuple[str, ...]) -> None:
        if root.name != "root":
            message = f"the first element is <root>, not <{root.name}>"
            hint = f'as <root BTCPP_format="{btcpp_vocabulary.XML_FORMAT}">'
            self._faults.fault(root.mark, "", message, hint, code="P904")
            return
        if not self._format(root):
            return
        for name in root.attributes:
            known = ("BTCPP_format", "main_tree_to_execute")
            ours = name in (*known, "project_name") or name.startswith(("xmlns", "xsi:"))
            if not ours and name not in btcpp_vocabulary.IGNORED:
                hint = suggest_name(name, known)
                message = f"<root> has no attribute {name!r}"
                self._faults.note(root.place(name), "root", message, hint, code="P908")
        self._no_text(root, "root")
        for part in root.children:
            match part.name:
                case "BehaviorTree":
                    self._tree(part, len(root.all("BehaviorTree")))
                case "TreeNodesModel":
                    self._models(part, first=len(self._roots) == 1 and len(trail) == 1)
                case "include":
                    self._include(part, path, trail)
                case name:
                    message = f"<{name}> has no meaning under <root>"
                    self._faults.note(part.mark, "root", message, suggest_name(name, _PARTS), code="P905")
                    if name == "TreeNodeModel":  # which Groot reads, though BehaviorTree.CPP does not
                        self._models(part, first=False)
        for second in root.all("TreeNodesModel")[1:]:
            self._faults.note(second.mark, "root", "a second <TreeNodesModel> in one file", code="P905")

    def _format(self, root: Element) -> bool:
        """Whether the file may be of format 4. BehaviorTree.CPP 4 reads a file that names no format, too."""
        version = root.attributes.get("BTCPP_format")
        if version == btcpp_vocabulary.XML_FORMAT:
            return True
        message = 'BTCPP_format="4" is missing' if version is None else f"format {version!r} is not read"
        hint = "this reads the files of BehaviorTree.CPP 4 and Groot2; convert older ones there"
        old = next((each for each in root.iterate() if each.identity in _FORMAT_3), None)
        if version is not None or old is not None or self._faults.strict:
            if old is not None:
                hint = f"{old.identity} on line {old.mark.line} is of format 3; {hint}"
            self._faults.fault(root.place("BTCPP_format"), "root", message, hint, code="P904")
            return False
        message = "BTCPP_format is missing; the file is read as one of format 4"
        self._faults.note(root.mark, "root", message, 'write BTCPP_format="4"', code="P904")
        return True

    def _tree(self, element: Element, trees: int) -> None:
        identity = element.get("ID") or (MAIN if trees == 1 else "")
        if not identity:
            message = "<BehaviorTree> needs the attribute 'ID'"
            self._faults.fault(element.mark, "root", message, code="P905")
            return
        self._attributes(element, ("ID",), identity)
        self._no_text(element, identity)
        known = self._source.trees.get(identity)
        if known is not None:
            message = f"the tree {identity!r} is given twice"
            same = known == element and known.mark.file != element.mark.file
            report = self._faults.note if same else self._faults.fault
            report(element.place("ID"), identity, message, f"first at {known.mark}", code="P905")
            return
        self._source.trees[identity] = element
        if len(element.children) != 1:
            message = f"<BehaviorTree> has {len(element.children)} children; it takes 1"
            self._faults.fault(element.mark, identity, message, "put several into a Sequence", code="P909")

    def _attributes(self, element: Element, known: Iterable[str], trail: str) -> None:
        for name in element.attributes:
            if name not in known and name not in btcpp_vocabulary.IGNORED:
                message = f"<{element.name}> has no attribute {name!r}"
                self._faults.note(element.place(name), trail, message, suggest_name(name, known), code="P908")

    def _no_text(self, element: Element, trail: str) -> None:
        if element.text:
            message = f"the text {element.text[:30]!r} has no meaning here"
            self._faults.note(element.mark, trail, message, "write a comment as <!-- -->", code="P905")

    def _models(self, element: Element, *, first: bool) -> None:
        for model in element.children:
            identity = model.get("ID")
            if model.name not in btcpp_vocabulary.ELEMENTS:
                if model.name != "MetadataFields":
                    message = f"<{model.name}> has no meaning under <TreeNodesModel>"
                    hint = suggest_name(model.name, btcpp_vocabulary.ELEMENTS)
                    self._faults.note(model.mark, "TreeNodesModel", message, hint, code="P905")
            elif not identity:
                message = f"<{model.name}> needs the attribute 'ID'"
                self._faults.note(model.mark, "TreeNodesModel", message, code="P905")
            elif model.name == "SubTree":
                self._source.models.setdefault(identity, model)
                self._metadata(identity, model, first=first)
            else:
                self._source.node_models.setdefault(identity, model)

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
        name, at = element.get("path"), element.place("path")
        if "ros_pkg" in element.attributes:
            message = "<include ros_pkg> is not followed: it leads to where ROS is installed"
            hint = "copy the file beside this one"
            self._faults.note(element.place("ros_pkg"), "root", message, hint, code="P912")
            return
        if not name or "\x00" in name:
            self._faults.fault(element.mark, "root", "<include> needs the attribute 'path'", code="P912")
            return
        found = path.parent / name
        place, relative = os.path.abspath(found), os.path.relpath(found, self._folder)
        if not _inside(found, self._folder) and place not in self._texts:
            message = f"{name!r} lies outside of the file's folder, and is not read"
            self._faults.note(at, "root", message, "copy it beside this file", code="P912")
        elif relative in trail:
            message = f"the files include each other in a circle: {' → '.join((*trail, relative))}"
            self._faults.fault(at, "root", message, code="P912")
        elif len(self._known) >= MAX_FILES:
            self._faults.fault(at, "root", f"more than {MAX_FILES} files are included", code="P912")
        elif not file_system.is_file(found):
            self._faults.note(at, "root", f"there is no file {name!r} beside this one", code="P912")
        elif place not in self._known:
            self._known[place] = None
            self._read(None, found, (*trail, relative))

    # First tree of the mission.

    def _main(self) -> str:
        trees = self._source.trees
        named = {root.get("main_tree_to_execute"): root for root in reversed(self._roots)}
        named.pop("", None)
        if self._asked or len(named) == 1:
            main = self._asked or next(iter(named))
            if main not in trees and not self._faults.errors:
                mark = self._roots[0].mark if self._asked else named[main].place("main_tree_to_execute")
                hint = suggest_name(main, trees)
                self._faults.fault(mark, "root", f"there is no tree {main!r}", hint, code="P914")
            return main
        if any(said.value == "true" for said in self._source.said("library")):
            return ""
        if len(trees) == 1:
            return next(iter(trees))
        if not self._faults.errors:
            self._no_main(tuple(reversed(named)))
        return ""

    def _no_main(self, named: Sequence[str]) -> None:
        trees = self._source.trees
        called = {
            each.get("ID") for tree in trees.values() for each in tree.iterate() if each.name == "SubTree"
        }
        roots = named or [tree for tree in trees if tree not in called] or list(trees)
        message = f"which of the {len(trees)} trees is the first one?" if trees else "there is no tree"
        first = next(iter(roots), MAIN)
        hint = f'as <root BTCPP_format="4" main_tree_to_execute="{first}">'
        if trees:
            more = f"; no other tree calls {', '.join(map(repr, roots[:5]))}" if len(roots) > 1 else ""
            hint += f", or `picktree convert --main {first}`{more}"
        self._faults.fault(self._roots[0].mark, "root", message, hint, code="P914")

    def _reachable(self) -> None:
        """Leave out the trees of several files that the first tree does not use."""
        trees, todo, used = self._source.trees, [self._source.main], set[str]()
        while todo:
            name = todo.pop()
            if name in trees and name not in used:
                used.add(name)
                todo += [each.get("ID") for each in trees[name].iterate() if each.name == "SubTree"]
        self._source.trees = {name: tree for name, tree in trees.items() if name in used}


def _inside(path: Path, folder: Path) -> bool:
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # a circle of symbolic links
        return False
