"""From a mission file to a Mission: everything that can be wrong in the text is found here, all at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..world.errors import PicktreeError
from ..world.files.document import (
    Document,
    Fault,
    FileError,
    Location,
    Value,
    load_document,
    nearest,
    parse_document,
)
from ..world.files.expressions import Expression, ExpressionError
from .calls import check_calls
from .declaration import IDENTIFIER
from .faults import Faults
from .grammar import Grammar, Names
from .mission import MAIN, Mission, NodeSpec, TreeSpec
from .ports import PortDeclaration
from .registry import Registry
from .tree_ports import TreePorts

_KEYS = ("picktree", "kind", "name", "scene", "goal", "plugins", "trees")
_GOAL_NAMES = ("total", "sorted", "misplaced", "left")


@dataclass(frozen=True, slots=True)
class Reading:
    """What a mission file gave. With faults the mission is only what could be read of it."""

    mission: Mission
    faults: tuple[Fault, ...]


def load_mission(path: Path, registry: Registry | None = None) -> Mission:
    """Read a mission file. Raises FileError with all its faults."""
    return read_mission(load_document(path, "mission"), registry)


def parse_mission(text: str, path: Path, registry: Registry | None = None) -> Mission:
    """As `load_mission`, of a text that was read already; `path` says what lies beside it."""
    return read_mission(parse_document(text, path, "mission"), registry)


def read_mission(document: Document, registry: Registry | None = None) -> Mission:
    """Check a document of kind `mission`. Raises FileError with all its faults."""
    reading = examine(document, registry)
    if reading.faults:
        raise FileError(reading.faults)
    return reading.mission


def examine(document: Document, registry: Registry | None = None) -> Reading:
    """As `read_mission`, for who wants to look at a faulty mission too."""
    return _Reader(document, (registry or Registry()).copy()).read()


class _Reader:
    def __init__(self, document: Document, registry: Registry) -> None:
        self._document = document
        self._registry = registry
        self._faults = Faults()

    def read(self) -> Reading:
        data = self._document.data
        for key in data:
            if key not in _KEYS:
                hint = nearest(key, _KEYS)
                self._fault((key,), f"a mission has no key {key!r}", hint, code="P201", key=True)
        plugins = self._plugins(data.get("plugins"))
        trees = self._trees(data.get("trees"))
        mission = Mission(
            self._text("name") or self._document.path.stem,
            trees,
            self._document,
            self._text("scene"),
            self._goal(data.get("goal")),
            plugins,
        )
        return Reading(mission, self._faults.all())

    def _fault(self, loc: Location, message: str, hint: str = "", *, code: str, key: bool = False) -> None:
        self._faults.add(self._document.fault(loc, message, hint, code=code, key=key))

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
            message = f"{error}, at character {error.offset + 1} of {value!r}"
            self._fault(("goal",), message, code="P225")
            return None
        for name in sorted(goal.names - set(_GOAL_NAMES)):
            self._fault(("goal",), f"a goal knows no {name!r}", nearest(name, _GOAL_NAMES), code="P203")
        return goal

    def _plugins(self, value: Value) -> tuple[str, ...]:
        if value is None:
            return ()
        if not isinstance(value, list):
            message = "'plugins' is a list of modules and of Python files beside the mission"
            self._fault(("plugins",), message, code="P202")
            return ()
        for index, plugin in enumerate(value):
            if not isinstance(plugin, str) or not plugin:
                message = "a plug-in is the name of a module or of a Python file"
                self._fault(("plugins", index), message, code="P202")
                continue
            try:
                self._registry.add_plugin(plugin, self._document.path.parent)
            except PicktreeError as error:
                self._fault(("plugins", index), str(error), code="P204")
        return tuple(plugin for plugin in value if isinstance(plugin, str))

    # Trees.

    def _trees(self, value: Value) -> dict[str, TreeSpec]:
        if value is None:
            self._fault((), "'trees:' is missing", "it holds 'Main:' and the sub-trees", code="P205")
            return {}
        if not isinstance(value, dict):
            message = "'trees' is a mapping: a name, and the tree of that name"
            self._fault(("trees",), message, code="P205")
            return {}
        declared = TreePorts(self._document, self._faults)
        ports: Mapping[str, tuple[PortDeclaration, ...]] = {
            name: declared.of(name, body) for name, body in value.items() if self._named_well(name)
        }
        if MAIN not in value:
            message = f"the tree {MAIN!r} is missing; a mission begins there"
            self._fault(("trees",), message, nearest(MAIN, value), code="P206")
        grammar = Grammar(self._document, self._registry, ports, self._faults)
        trees = {
            name: TreeSpec(name, self._document.key_mark(("trees", name)), ports[name], root)
            for name, body in value.items()
            if name in ports and (root := self._root(grammar, name, body)) is not None
        }
        for fault in check_calls(trees):
            self._faults.add(fault)
        return trees

    def _named_well(self, name: str) -> bool:
        loc = ("trees", name)
        if not IDENTIFIER.fullmatch(name):
            hint = "a letter or '_', then letters, digits and '_'"
            self._fault(loc, f"{name!r} is not an ID", hint, code="P208", key=True)
            return False
        if self._registry.find(name) is not None:
            message = f"{name!r} is a node already; a tree needs another name"
            self._fault(loc, message, code="P209", key=True)
            return False
        return True

    def _root(self, grammar: Grammar, name: str, body: Value) -> NodeSpec | None:
        loc: Location = ("trees", name)
        if isinstance(body, dict):
            body = {key: value for key, value in body.items() if key != "ports"}
            if not body:
                self._fault(loc, f"the tree {name!r} has no node", code="P210", key=True)
                return None
        return grammar.node(body, loc, name, Names())
