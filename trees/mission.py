"""Mission as values: the content of a mission file, checked and converted, before a tree is built.
Errors are collected with their places.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Final, Literal, Protocol

from picktree.files import Diagnostic, Expression, Location, Mark, PicktreeError, file_system, suggest_name
from picktree.files.yaml import Document, read_document

from .node import Node
from .ports import PortDeclaration
from .references import Assignment, Binding

MAX_NODES: Final = 10_000
"""Maximum number of nodes of a mission, with sub-trees expanded."""
MAX_FAULTS: Final = 200
"""Maximum number of errors that are kept; further ones are counted."""


class MissionDiagnostics:
    """Errors of one mission, over all its files."""

    def __init__(self) -> None:
        self._kept: list[Diagnostic] = []
        self._more = 0
        self._nodes = 0
        self._left_out: list[str] = []

    def has_room(self, document: Document, loc: Location) -> bool:
        """Count a node of the text; return False when there are too many for the mission to be built."""
        self._nodes += 1
        if self._nodes == MAX_NODES + 1:
            message = f"here is node number {self._nodes} of the mission"
            self.at(document, loc, "", message, f"at most {MAX_NODES} nodes", code="P236")
        return self._nodes <= MAX_NODES

    @property
    def full(self) -> bool:
        """Whether another error would only be counted."""
        return len(self._kept) >= MAX_FAULTS

    def __len__(self) -> int:
        return len(self._kept) + self._more

    def add(self, fault: Diagnostic) -> None:
        if self.full:
            self._more += 1
        else:
            self._kept.append(fault)

    def at(
        self,
        document: Document,
        loc: Location,
        trail: str,
        message: str,
        hint: str = "",
        *,
        code: str,
        key: bool = False,
        detail: str = "",
    ) -> None:
        """Add an error about the value at `loc`, or (`key`) about its key."""
        if self.full:
            self._more += 1
            return
        mark = document.key_mark(loc) if key else document.mark(loc)
        self._kept.append(Diagnostic(mark, trail, message, hint, code, detail=detail))

    def leave_out(self, trail: str) -> None:
        """Note a node that is not read because of an error that is reported elsewhere."""
        self._left_out.append(trail)

    def nearest(self, name: str, known: Iterable[str]) -> str:
        """Return the nearest name as `suggest_name`, which is costly; empty when the list is full."""
        return "" if self.full else suggest_name(name, known)

    def within(self, tree: str) -> bool:
        """Whether any error lies in that tree, or a node that was left out."""
        starts = (f"{tree}/", f"trees.{tree}.")
        names = (tree, f"trees.{tree}")
        places = (*(fault.where for fault in self._kept), *self._left_out)
        return any(place in names or place.startswith(starts) for place in places)

    def all(self) -> tuple[Diagnostic, ...]:
        """Return the errors in the order of the files; the last one gives the number that was left out."""
        kept = sorted(dict.fromkeys(self._kept), key=lambda fault: fault.mark)
        if self._more:
            message = f"and {self._more} more faults"
            kept.append(Diagnostic(kept[-1].mark, "", message, "mend those above first", "P200"))
        return tuple(kept)


LIBRARY: Final = Path(__file__).parent / "library"
"""Folder of the sub-trees that come with picktree."""
IN_LIBRARY: Final = "library/"


class MissionFiles(Protocol):
    """Source of included files by name: `common.yaml`, `parts/bins.yaml`, or `library/recovery`.

    A name is relative to the mission's folder and never leads out of it.
    """

    def document(self, name: str) -> Document:
        """Return the file. Raises PicktreeError when there is none, FileError when it cannot be read."""
        ...


class FilesOnDisk:
    """Files in the mission's folder, and the library.

    `unsaved`: texts that an editor holds, by path; they count before those on the disk.
    """

    def __init__(self, folder: Path, unsaved: Mapping[Path, str] | None = None) -> None:
        self._folder = folder
        self._unsaved = {path.absolute(): text for path, text in (unsaved or {}).items()}

    def document(self, name: str) -> Document:
        path = path_of(name, self._folder)
        text = self._unsaved.get(path.absolute())
        if text is not None:
            return read_document(path, "mission", text)
        if not file_system.is_file(path):
            raise PicktreeError(_missing(name, self._folder))
        if not name.startswith(IN_LIBRARY) and not _inside(path, self._folder):
            raise PicktreeError(f"{name!r} leads out of the mission's folder by a symbolic link")
        return read_document(path, "mission")


class RecordedFiles:
    """Texts of included files from a log, by the names under which the mission includes them."""

    def __init__(self, texts: Mapping[str, str], folder: Path) -> None:
        self._texts, self._folder = texts, folder

    def document(self, name: str) -> Document:
        if name not in self._texts:
            raise PicktreeError(f"the record holds no file {name!r}")
        return read_document(path_of(name, self._folder), "mission", self._texts[name])


def path_of(name: str, folder: Path) -> Path:
    """Return the path of a file by the name under which a mission in `folder` includes it."""
    if name.startswith(IN_LIBRARY) and not name.endswith((".yaml", ".yml")):
        return LIBRARY / f"{name.removeprefix(IN_LIBRARY)}.yaml"
    return folder / name


def name_of(path: Path, folder: Path) -> str:
    """Return the name under which a mission in `folder` includes a file: the inverse of `path_of`."""
    if path.parent == LIBRARY:
        return f"{IN_LIBRARY}{path.stem}"
    return path.relative_to(folder).as_posix()


def library_names() -> tuple[str, ...]:
    """Return the names that are valid after `library/`."""
    return file_system.shipped_names(LIBRARY)


def _inside(path: Path, folder: Path) -> bool:
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # a circle of symbolic links
        return False


def _missing(name: str, folder: Path) -> str:
    if path_of(name, folder).parent == LIBRARY:
        wanted = name.removeprefix(IN_LIBRARY)
        return f"the library has no {wanted!r} ({suggest_name(wanted, library_names())})"
    return f"there is no file {name!r} beside the mission"


MAIN = "Main"


@dataclass(frozen=True, slots=True)
class Plugin:
    """A plug-in that was loaded."""

    name: str
    """Name in `plugins:`; for an installed plug-in its module."""
    nodes: tuple[type[Node], ...]
    file: Path | None = None
    """Source file; None when there is none, as for a compiled module."""
    source: bytes = b""
    """Source code that was run, for the record."""
    distribution: str = ""
    """Name and version of the distribution of an installed plug-in; else empty."""


@dataclass(frozen=True, slots=True)
class NodeSpec:
    """One node of the mission text. `node` is its class; None: an instance of the sub-tree `id`."""

    id: str
    name: str
    mark: Mark
    node: type[Node] | None
    ports: Mapping[str, Binding] = field(default_factory=dict[str, Binding])
    slots: Mapping[str, tuple[tuple[str, NodeSpec], ...]] = field(
        default_factory=dict[str, "tuple[tuple[str, NodeSpec], ...]"]
    )
    """Children by slot as (label, node); the label is a table's key, else empty."""
    preconditions: Mapping[str, Expression] = field(default_factory=dict[str, Expression])
    postconditions: Mapping[str, tuple[Assignment, ...]] = field(
        default_factory=dict[str, "tuple[Assignment, ...]"]
    )
    breakpoint: Literal["before", "after"] | None = None
    places: Mapping[str, Mark] = field(default_factory=dict[str, Mark])
    """Places of the values of ports, conditions and slots, by key."""
    autoremap: frozenset[str] | None = None
    """Ports of a sub-tree that `_autoremap` wires to the caller's keys of that name; None: without it."""

    @property
    def children(self) -> tuple[NodeSpec, ...]:
        return tuple(node for filled in self.slots.values() for _, node in filled)

    def mark_at(self, key: str) -> Mark:
        """Return where the value of one of its keys stands; of one that is not given, where the node does."""
        return self.places.get(key, self.mark)

    def iterate(self) -> Iterator[NodeSpec]:
        """Yield this node and its descendants in the same tree, parents first."""
        todo: list[NodeSpec] = [self]
        while todo:
            node = todo.pop()
            yield node
            todo += reversed(node.children)


@dataclass(frozen=True, slots=True)
class TreeSpec:
    """One tree of a mission: its ports (for `Main` the mission's parameters) and its root."""

    name: str
    mark: Mark
    ports: tuple[PortDeclaration, ...]
    root: NodeSpec
    places: Mapping[str, Mark] = field(default_factory=dict[str, Mark])
    """Places of the port declarations, by key."""
    doc: str = ""
    """The tree in a sentence or two, for people."""


@dataclass(frozen=True, slots=True)
class Mission:
    """A mission file, read and checked."""

    name: str
    trees: Mapping[str, TreeSpec]
    document: Document
    scene: str | None = None
    """Shipped scene, or a file relative to the mission; None when the mission names none."""
    goal: Expression | None = None
    plugins: tuple[str, ...] = ()
    included: tuple[Document, ...] = ()
    """Included files, each once."""
    library: bool = False
    """Whether the file only holds sub-trees for other missions: no `Main`, no scene, no goal."""
    sources: tuple[Plugin, ...] = ()
    """Plug-ins that the mission names, and installed ones whose nodes it uses."""

    @property
    def main(self) -> TreeSpec:
        return self.trees[MAIN]

    @property
    def parameters(self) -> tuple[PortDeclaration, ...]:
        return self.main.ports

    @property
    def text(self) -> str:
        return self.document.text

    @property
    def files(self) -> dict[str, str]:
        """Return the texts of the included files by the names under which they are included."""
        folder = self.document.path.parent
        return {name_of(document.path, folder): document.text for document in self.included}


MAX_MISSION_DEPTH: Final = 120
"""Maximum depth of a mission in nodes, with sub-trees expanded."""


def called_by(tree: TreeSpec) -> tuple[str, ...]:
    """Return the sub-trees that the tree calls, each once."""
    return tuple(dict.fromkeys(node.id for node in tree.root.iterate() if node.node is None))


def reachable(trees: Mapping[str, TreeSpec]) -> frozenset[str]:
    """Return the names of the trees that a run can reach from `Main`."""
    found: set[str] = set()
    todo = [MAIN]
    while todo:
        name = todo.pop()
        if name in trees and name not in found:
            found.add(name)
            todo += called_by(trees[name])
    return frozenset(found)


def bottom_up(trees: Mapping[str, TreeSpec]) -> tuple[str, ...]:
    """Return the names of the trees, each after those that it calls. Raises CycleError."""
    calls = {name: [c for c in called_by(tree) if c in trees] for name, tree in trees.items()}
    return tuple(TopologicalSorter(calls).static_order())


def check_calls(trees: Mapping[str, TreeSpec]) -> Iterable[Diagnostic]:
    """Yield an error for a circle of calls, and for a mission too large to be built."""
    try:
        order = bottom_up(trees)
    except CycleError as error:
        circle: list[str] = list(reversed(error.args[1]))
        name, called = circle[0], circle[1]
        mark = next(n.mark for n in trees[name].root.iterate() if n.node is None and n.id == called)
        shown = circle if len(circle) <= 12 else [*circle[:6], "…", *circle[-5:]]
        message = f"the sub-trees call each other in a circle: {' → '.join(shown)}"
        yield Diagnostic(mark, f"trees.{name}", message, "a loop is Repeat or ForEach", "P235")
        return
    sizes: dict[str, tuple[int, int]] = {}
    for name in order:
        sizes[name] = _size(trees[name].root, sizes)
    count, depth = sizes.get(MAIN, (0, 0))
    if count > MAX_NODES or depth > MAX_MISSION_DEPTH:
        message = f"with its sub-trees written out the mission has {count} nodes, {depth} deep"
        hint = f"at most {MAX_NODES} nodes, {MAX_MISSION_DEPTH} deep"
        yield Diagnostic(trees[MAIN].mark, f"trees.{MAIN}", message, hint, "P236")


def _size(spec: NodeSpec, sizes: Mapping[str, tuple[int, int]]) -> tuple[int, int]:
    """Return number and depth of the nodes with sub-trees expanded; `sizes` holds those of called trees."""
    below = [_size(child, sizes) for child in spec.children]
    if spec.node is None and spec.id in sizes:
        below = [sizes[spec.id]]
    return 1 + sum(count for count, _ in below), 1 + max((depth for _, depth in below), default=0)
