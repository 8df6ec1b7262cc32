"""From a mission file to a Mission: everything that can be wrong in the text is found here, all at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..world.files.document import (
    Document,
    Fault,
    FileError,
    Location,
    Value,
    nearest,
    open_document,
    read_document,
    where,
)
from ..world.files.expression_types import ValueType
from ..world.files.expressions import Expression, ExpressionError
from .calls import check_calls
from .declaration import IDENTIFIER
from .faults import Faults
from .grammar import Grammar, Names
from .include import Includes
from .mission import MAIN, Mission, NodeSpec, TreeSpec
from .mission_files import FilesOnDisk, MissionFiles
from .node import Node
from .plugin_import import PluginError
from .pointer import Pointer
from .ports import PortDeclaration
from .registry import Registry
from .tree_ports import TreePorts
from .types import show
from .wiring.asking import unanswerable
from .wiring.circuit import Circuit
from .wiring.keys import FACT_TYPES
from .wiring.misfits import misfits

_KEYS = ("picktree", "kind", "name", "scene", "goal", "library", "include", "plugins", "trees")
_NOT_IN_LIBRARY = ("scene", "goal")
_GOAL_NAMES = ("total", "sorted", "misplaced", "left")


@dataclass(frozen=True, slots=True)
class Reading:
    """What a mission file gave. With faults the mission is only what could be read of it."""

    mission: Mission
    faults: tuple[Fault, ...]
    circuit: Circuit | None
    """What is wired to what; None where sub-trees call each other in a circle."""
    pointer: Pointer


def load_mission(path: Path, registry: Registry | None = None) -> Mission:
    """Read a mission file. Raises FileError with all its faults."""
    return read_mission(open_document(path, "mission"), registry)


def parse_mission(
    text: str,
    path: Path,
    registry: Registry | None = None,
    files: MissionFiles | None = None,
    facts: Mapping[str, ValueType] = FACT_TYPES,
) -> Mission:
    """As `load_mission`, of a text that was read already; `path` says what lies beside it.

    `files` gives the included files, by default from the disk; `facts` are what expressions may name of the
    world.
    """
    return read_mission(read_document(text, path, "mission"), registry, files, facts)


def read_mission(
    document: Document,
    registry: Registry | None = None,
    files: MissionFiles | None = None,
    facts: Mapping[str, ValueType] = FACT_TYPES,
) -> Mission:
    """Check a document of kind `mission`. Raises FileError with all its faults, and for a library."""
    reading = examine(document, registry, files, facts)
    faults = list(reading.faults)
    if not faults and reading.mission.library:
        message = "this file is for inclusion: it has no tree 'Main' to begin with"
        faults.append(document.fault(("library",), message, code="P206"))
    if faults:
        raise FileError(faults)
    return reading.mission


def examine(
    document: Document,
    registry: Registry | None = None,
    files: MissionFiles | None = None,
    facts: Mapping[str, ValueType] = FACT_TYPES,
) -> Reading:
    """As `read_mission`, for who wants to look at a faulty mission too, or at a library."""
    beside = files or FilesOnDisk(document.path.parent)
    return _Reader(document, (registry or Registry()).copy(), beside, facts).read()


class _Reader:
    def __init__(
        self, document: Document, registry: Registry, files: MissionFiles, facts: Mapping[str, ValueType]
    ) -> None:
        self._document = document
        self._registry = registry
        self._files = files
        self._facts = facts
        self._faults = Faults()
        self._pointer = Pointer((document,))
        self._lacking = False

    def read(self) -> Reading:
        for fault in self._document.faults:
            self._faults.add(fault)
        before = len(self._faults)
        included = Includes(self._files, self._faults).of(self._document)
        self._lacking = len(self._faults) > before
        documents = (self._document, *included)
        self._pointer = Pointer(documents)
        library = self._document.data.get("library") is True
        for document in documents:
            self._keys(document)
        plugins = [plugin for document in documents for plugin in self._plugins(document)]
        trees = self._trees(documents)
        circuit = self._circuit(trees)
        mission = Mission(
            self._text("name") or self._document.path.stem,
            trees,
            self._document,
            self._text("scene"),
            self._goal(self._document.data.get("goal")),
            tuple(dict.fromkeys(plugins)),
            included,
            library,
            sources=self._registry.plugins_of(_classes(trees)),
        )
        return Reading(mission, self._faults.all(), circuit, self._pointer)

    def _fault(
        self,
        loc: Location,
        message: str,
        hint: str = "",
        *,
        code: str,
        key: bool = False,
        document: Document | None = None,
    ) -> None:
        self._faults.at(document or self._document, loc, where(loc), message, hint, code=code, key=key)

    # The head of a file.

    def _keys(self, document: Document) -> None:
        library = document.data.get("library")
        if library not in (None, True, False):
            self._fault(("library",), "'library' is true or false", code="P202", document=document)
        for key in document.data:
            if key not in _KEYS:
                hint = self._faults.nearest(key, _KEYS)
                message = f"a mission has no key {show(key)}"
                self._fault((key,), message, hint, code="P201", key=True, document=document)
            elif key in _NOT_IN_LIBRARY and library is True:
                message = f"a library has no {key!r}: that is for the mission to say"
                self._fault((key,), message, code="P248", key=True, document=document)

    def _text(self, key: str) -> str | None:
        value = self._document.data.get(key)
        if value is None or (isinstance(value, str) and value):
            return value
        self._fault((key,), f"{key!r} is a text", code="P202")
        return None

    def _goal(self, value: Value) -> Expression | None:
        if value is None:
            return None
        if not isinstance(value, str):
            hint = "as 'misplaced == 0 and left <= 1'"
            self._fault(("goal",), "the goal is an expression", hint, code="P203")
            return None
        try:
            goal = Expression.parse(value)
        except ExpressionError as error:
            mark, message = self._pointer.told(self._document.mark(("goal",)), value, error)
            self._faults.add(Fault(mark, "goal", message, "", "P225"))
            return None
        for name in sorted(goal.names - set(_GOAL_NAMES)):
            self._fault(("goal",), f"a goal knows no {name!r}", nearest(name, _GOAL_NAMES), code="P203")
        return goal

    def _plugins(self, document: Document) -> tuple[str, ...]:
        value = document.data.get("plugins")
        if value is None:
            return ()
        if not isinstance(value, list):
            message = "'plugins' is a list of modules and of Python files beside the mission"
            self._fault(("plugins",), message, code="P202", document=document)
            return ()
        for index, plugin in enumerate(value):
            if not isinstance(plugin, str) or not plugin:
                message = "a plug-in is the name of a module or of a Python file"
                self._fault(("plugins", index), message, code="P202", document=document)
                continue
            try:
                self._registry.add_plugin(plugin, document.path.parent)
            except PluginError as error:
                self._faults.at(
                    document,
                    ("plugins", index),
                    where(("plugins", index)),
                    error.message,
                    error.hint,
                    code=error.code,
                    detail=error.detail,
                )
        return tuple(plugin for plugin in value if isinstance(plugin, str))

    # Trees.

    def _trees(self, documents: tuple[Document, ...]) -> dict[str, TreeSpec]:
        bodies = [(document, self._bodies(document)) for document in documents]
        ports: dict[str, tuple[PortDeclaration, ...]] = {}
        homes: dict[str, Document] = {}
        for document, found in bodies:
            declared = TreePorts(document, self._faults)
            for name, body in found.items():
                if self._named_well(document, name, homes):
                    homes[name] = document
                    ports[name] = declared.of(name, body)
        trees: dict[str, TreeSpec] = {}
        for document, found in bodies:
            grammar = Grammar(
                document, self._registry, ports, self._faults, self._pointer, lacking=self._lacking
            )
            for name, body in found.items():
                root = self._root(document, grammar, name, body) if homes.get(name) is document else None
                if root is not None:
                    mark = document.key_mark(("trees", name))
                    places = {p.key: document.mark(("trees", name, "ports", p.key)) for p in ports[name]}
                    trees[name] = TreeSpec(name, mark, ports[name], root, places)
        return trees

    def _circuit(self, trees: Mapping[str, TreeSpec]) -> Circuit | None:
        """What is wired to what, checked: what can be wrong between nodes that are right by themselves."""
        calls = tuple(check_calls(trees))
        for fault in calls:
            self._faults.add(fault)
        if calls:
            return None
        # Where a node could not be read, a key may be written that nobody sees.
        unfinished = [name for name in trees if self._faults.within(name)]
        circuit = Circuit(trees, self._facts)
        for fault in (*misfits(circuit), *unanswerable(circuit, self._pointer, unfinished)):
            self._faults.add(fault)
        return circuit

    def _bodies(self, document: Document) -> dict[str, Value]:
        """What stands under `trees:` of one file, by name."""
        value = document.data.get("trees")
        library = document.data.get("library") is True
        if value is None:
            hint = "it holds the sub-trees" if library else "it holds 'Main:' and the sub-trees"
            self._fault((), "'trees:' is missing", hint, code="P205", document=document)
            return {}
        if not isinstance(value, dict):
            message = "'trees' is a mapping: a name, and the tree of that name"
            self._fault(("trees",), message, code="P205", document=document)
            return {}
        if MAIN in value and library:
            message = f"a library has no tree {MAIN!r}: that is the mission's"
            self._fault(("trees", MAIN), message, code="P248", key=True, document=document)
        if MAIN not in value and not library:
            message = f"the tree {MAIN!r} is missing; a mission begins there"
            self._fault(("trees",), message, self._faults.nearest(MAIN, value), code="P206")
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
            first = homes[name].key_mark(loc)
            message, code = f"the tree {name!r} is given twice", "P247"
            hint = f"first on {first.told(str(document.path))}"
        if message:
            self._fault(loc, message, hint, code=code, key=True, document=document)
        return not message

    def _root(self, document: Document, grammar: Grammar, name: str, body: Value) -> NodeSpec | None:
        loc: Location = ("trees", name)
        if isinstance(body, dict):
            body = {key: value for key, value in body.items() if key != "ports"}
            if not body:
                message = f"the tree {name!r} has no node"
                self._fault(loc, message, code="P210", key=True, document=document)
                return None
        return grammar.node(body, loc, name, Names())


def _classes(trees: Mapping[str, TreeSpec]) -> set[type[Node]]:
    """The classes of all nodes in the trees."""
    return {spec.node for tree in trees.values() for spec in tree.root.iterate() if spec.node is not None}
