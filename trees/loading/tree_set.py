"""Trees of a mission: read from its own file, and from those that it includes."""

from __future__ import annotations

import posixpath
from collections.abc import Iterator, Mapping
from dataclasses import replace
from graphlib import CycleError
from typing import Final, Literal

from ...files.errors import PicktreeError
from ...files.marks import Diagnostic, FileError, Location, where
from ...files.yaml.document import Document
from ...files.yaml.reader import Value
from ...world.belief.facts import FACTS
from ..declaration import AUTOREMAP, IDENTIFIER
from ..fault_collector import MissionDiagnostics
from ..key_writers import uses_of
from ..mission import IN_LIBRARY, MAIN, MissionFiles, NodeSpec, TreeSpec, bottom_up
from ..port_types import PortType, show
from ..ports import PortDeclaration
from ..references import ROOT_KEY, ExpressionLocator, Reference
from .children import ChildNames
from .grammar import NodeSpecReader
from .registry import NodeRegistry
from .tree_ports import TreePorts

MAX_INCLUDED_FILES: Final = 50
MAX_INCLUDED_CHARACTERS: Final = 1_000_000
"""Limit of the total size of all included files, characters."""
_SUFFIXES = (".yaml", ".yml")


def remap_keys(trees: dict[str, TreeSpec]) -> dict[str, TreeSpec]:
    """Wire the calls with `_autoremap`: each key that a sub-tree uses becomes a port, wired to the same key.

    Keys that begin with `_` stay the sub-tree's own, as in BehaviorTree.CPP.
    """
    calls = [spec for tree in trees.values() for spec in tree.root.iterate() if spec.node is None]
    remapped = {spec.id for spec in calls if spec.autoremap is not None}
    if not remapped:
        return trees
    try:
        order = bottom_up(trees)
    except CycleError:
        return trees  # a fault already
    done = dict(trees)
    for name in order:
        tree = replace(done[name], root=_remapping(done[name].root, done))
        if name in remapped:
            tree = replace(tree, ports=(*tree.ports, *_shared_keys(tree, done)))
        done[name] = tree
    return {name: done[name] for name in trees}


def _remapping(spec: NodeSpec, trees: Mapping[str, TreeSpec]) -> NodeSpec:
    """Return the node with all calls below it wired."""
    slots = {
        key: tuple((label, _remapping(child, trees)) for label, child in filled)
        for key, filled in spec.slots.items()
    }
    if spec.autoremap is None or spec.id not in trees:
        return replace(spec, slots=slots) if slots else spec
    same = {port.key: Reference(port.key) for port in trees[spec.id].ports if port.key not in spec.ports}
    return replace(spec, ports={**spec.ports, **same}, autoremap=frozenset(same))


def _shared_keys(tree: TreeSpec, trees: Mapping[str, TreeSpec]) -> Iterator[PortDeclaration]:
    """Yield a port for each key of the tree that is not one of its ports."""
    uses = [use for spec in tree.root.iterate() for use in uses_of(spec, trees)]
    written = {use.key for use in uses if use.writes}
    ports = {port.key for port in tree.ports}
    for key in dict.fromkeys(use.key for use in uses):
        if key not in ports and not key.startswith(("_", ROOT_KEY)) and (key in written or key not in FACTS):
            way: Literal["in", "out"] = "out" if key in written else "in"
            yield PortDeclaration(key, key, way, PortType("any"), "", remapped=True)


def _unshared(tree: TreeSpec, trees: Mapping[str, TreeSpec]) -> Iterator[Diagnostic]:
    """Yield a fault for each key that a call without `_autoremap` does not give."""
    for spec in tree.root.iterate():
        if spec.node is None and spec.autoremap is None and spec.id in trees:
            for port in trees[spec.id].ports:
                if port.remapped and port.direction == "in":
                    message = (
                        f"{spec.id} reads the key {port.key!r} of its caller, which this call does not share"
                    )
                    hint = f"'{AUTOREMAP}: true', or a port {port.key!r} of {spec.id}"
                    yield Diagnostic(spec.mark, f"trees.{tree.name}", message, hint, "P219")


class IncludeReader:
    """Reader that follows `include:` from the mission through all its files."""

    def __init__(self, files: MissionFiles, faults: MissionDiagnostics) -> None:
        self._files = files
        self._faults = faults
        self._found: dict[str, Document | None] = {}
        self._characters = 0

    def of(self, document: Document) -> tuple[Document, ...]:
        """Return the files that the mission includes, each once, in the order of their first mention."""
        self._follow(document, "", (document.path.name,))
        return tuple(found for found in self._found.values() if found is not None)

    def _follow(self, document: Document, folder: str, trail: tuple[str, ...]) -> None:
        """Follow the entries of one document. `folder`: the document's folder below the mission's; `trail`:
        names of the including files."""
        entries = document.data.get("include")
        if entries is None:
            return
        if not isinstance(entries, list):
            message = "'include' is a list of files beside the mission and of the library"
            self._fault(document, (), message, "as '[common.yaml, library/recovery]'", code="P242")
            return
        for index, entry in enumerate(entries):
            name = self._name(document, entry, folder, index)
            if name is not None:
                self._include(document, index, name, trail)

    def _include(self, document: Document, index: int, name: str, trail: tuple[str, ...]) -> None:
        if name in trail:
            circle = " → ".join((*trail[trail.index(name) :], name))
            message = f"the files include each other in a circle: {circle}"
            self._fault(document, (index,), message, code="P243")
            return
        if name in self._found:
            return
        if len(self._found) >= MAX_INCLUDED_FILES:
            if len(self._found) == MAX_INCLUDED_FILES:
                self._found[""] = None
                message = f"a mission includes at most {MAX_INCLUDED_FILES} files"
                self._fault(document, (index,), message, code="P243")
            return
        included = self._found[name] = self._read(document, index, name)
        if included is not None:
            self._follow(included, posixpath.dirname(name), (*trail, name))

    def _read(self, document: Document, index: int, name: str) -> Document | None:
        try:
            included = self._files.document(name)
        except FileError as error:
            for fault in error.faults:
                self._faults.add(fault)
            return None
        except PicktreeError as error:
            self._fault(document, (index,), str(error), code="P243")
            return None
        for fault in included.faults:
            self._faults.add(fault)
        self._characters += len(included.text)
        if self._characters > MAX_INCLUDED_CHARACTERS:
            message = f"the included files are larger than {MAX_INCLUDED_CHARACTERS // 1_000_000} MB together"
            self._fault(document, (index,), message, code="P243")
            return None
        if included.data.get("library") is not True:
            message = f"{name!r} is not meant for inclusion"
            hint = "a file with sub-trees only says 'library: true' at the top"
            self._fault(document, (index,), message, hint, code="P243")
            return None
        return included

    def _name(self, document: Document, entry: Value, folder: str, index: int) -> str | None:
        """Return an entry's name relative to the mission's folder; None when it may not be included."""
        if not isinstance(entry, str) or not entry:
            message = "an included file is named by a text"
            self._fault(document, (index,), message, "as 'common.yaml' or 'library/recovery'", code="P242")
            return None
        if entry.startswith(IN_LIBRARY) and not entry.endswith(_SUFFIXES):
            if "/" in entry.removeprefix(IN_LIBRARY):
                self._fault(document, (index,), f"the library has no {entry!r}", code="P243")
                return None
            return entry
        if posixpath.isabs(entry) or "\\" in entry or ":" in entry or "\x00" in entry:
            message = f"{entry!r} is no path below the mission's folder"
            self._fault(document, (index,), message, "as 'common.yaml' or 'parts/bins.yaml'", code="P243")
            return None
        name = posixpath.normpath(posixpath.join(folder, entry))
        if name.startswith("../") or name == "..":
            message = f"{entry!r} lies outside of the mission's folder"
            self._fault(document, (index,), message, code="P243")
            return None
        if not name.endswith(_SUFFIXES):
            message = f"{entry!r} is no YAML file"
            hint = f"'{entry}.yaml', or 'library/{entry}' for one of the library"
            self._fault(document, (index,), message, hint, code="P242")
            return None
        return name

    def _fault(self, document: Document, loc: Location, message: str, hint: str = "", *, code: str) -> None:
        at: Location = ("include", *loc)
        self._faults.at(document, at, where(at), message, hint, code=code)


class TreeSetReader:
    """Reader of `trees:` of several documents. `lacking`: some included file could not be read."""

    def __init__(
        self, registry: NodeRegistry, faults: MissionDiagnostics, pointer: ExpressionLocator, *, lacking: bool
    ) -> None:
        self._registry = registry
        self._faults = faults
        self._pointer = pointer
        self._lacking = lacking

    def read(self, documents: tuple[Document, ...]) -> dict[str, TreeSpec]:
        """Return the trees that could be read, by name. A name belongs to the first file that defines it."""
        bodies = [(document, self._bodies(document)) for document in documents]
        ports: dict[str, tuple[PortDeclaration, ...]] = {}
        homes: dict[str, Document] = {}
        docs: dict[str, str] = {}
        for document, found in bodies:
            declared = TreePorts(document, self._faults)
            for name, body in found.items():
                if self._named_well(document, name, homes):
                    homes[name] = document
                    ports[name] = declared.of(name, body)
                    docs[name] = declared.doc(name, body)
        ambiguous = frozenset(
            name for _, found in bodies for name in found if self._registry.find(name) is not None
        )
        trees: dict[str, TreeSpec] = {}
        for document, found in bodies:
            grammar = NodeSpecReader(
                document,
                self._registry,
                ports,
                self._faults,
                self._pointer,
                lacking=self._lacking,
                ambiguous=ambiguous,
            )
            for name, body in found.items():
                root = self._root(document, grammar, name, body) if homes.get(name) is document else None
                if root is not None:
                    mark = document.key_mark(("trees", name))
                    places = {p.key: document.mark(("trees", name, "ports", p.key)) for p in ports[name]}
                    trees[name] = TreeSpec(name, mark, ports[name], root, places, docs[name])
        trees = remap_keys(trees)
        for tree in trees.values():
            for fault in _unshared(tree, trees):
                self._faults.add(fault)
        return trees

    def _bodies(self, document: Document) -> Mapping[str, Value]:
        """Return the bodies under `trees:` of one file, by name."""
        value = document.data.get("trees")
        library = document.data.get("library") is True
        if value is None:
            hint = "it holds the sub-trees" if library else "it holds 'Main:' and the sub-trees"
            self._fault(document, (), "'trees:' is missing", hint, code="P205")
            return {}
        if not isinstance(value, dict):
            message = "'trees' is a mapping: a name, and the tree of that name"
            self._fault(document, ("trees",), message, code="P205")
            return {}
        if MAIN in value and library:
            message = f"a library has no tree {MAIN!r}: that is the mission's"
            self._fault(document, ("trees", MAIN), message, code="P248", key=True)
        if MAIN not in value and not library:
            message = f"the tree {MAIN!r} is missing; a mission begins there"
            self._fault(document, ("trees",), message, self._faults.nearest(MAIN, value), code="P206")
        return value

    def _named_well(self, document: Document, name: str, homes: Mapping[str, Document]) -> bool:
        loc: Location = ("trees", name)
        message, hint, code = "", "", "P209"
        if not IDENTIFIER.fullmatch(name):
            message, code = f"{show(name)} is not an ID", "P208"
            hint = "a letter or '_', then letters, digits and '_'"
        elif self._registry.find(name) is not None:
            message = f"{name!r} is a node already; a tree needs another name"
        elif name in homes:
            message, code = f"the tree {name!r} is given twice", "P247"
            hint = f"first on {homes[name].key_mark(loc).told(str(document.path))}"
        if message:
            self._fault(document, loc, message, hint, code=code, key=True)
        return not message

    def _root(self, document: Document, grammar: NodeSpecReader, name: str, body: Value) -> NodeSpec | None:
        loc: Location = ("trees", name)
        if isinstance(body, dict):
            body = {key: value for key, value in body.items() if key not in ("ports", "doc")}
            if not body:
                message = f"the tree {name!r} has no node"
                self._fault(document, loc, message, code="P210", key=True)
                return None
        return grammar.node(body, loc, name, ChildNames())

    def _fault(
        self,
        document: Document,
        loc: Location,
        message: str,
        hint: str = "",
        *,
        code: str,
        key: bool = False,
    ) -> None:
        self._faults.at(document, loc, where(loc), message, hint, code=code, key=key)
