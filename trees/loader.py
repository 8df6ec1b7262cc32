"""From a mission file to a Mission: everything that can be wrong in the text is found here, all at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Final, Literal

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
from .declaration import IDENTIFIER
from .grammar import Grammar, Names
from .mission import MAIN, Mission, NodeSpec, TreeSpec
from .ports import REQUIRED, PortDeclaration
from .registry import Registry
from .types import NAMES_IN_FILES, PortType, convert

MAX_NODES: Final = 10_000
"""Of a mission with all sub-trees written out."""
MAX_DEPTH: Final = 120
"""Nodes above one another, sub-trees written out."""
_KEYS = ("picktree", "kind", "name", "scene", "goal", "plugins", "trees")
_PORT_KEYS = ("type", "default", "doc", "unit", "choices", "direction")
_GOAL_NAMES = ("total", "sorted", "misplaced", "left")


def load_mission(path: Path, registry: Registry | None = None) -> Mission:
    """Read a mission file. Raises FileError with all its faults."""
    return read_mission(load_document(path, "mission"), registry)


def parse_mission(text: str, path: Path, registry: Registry | None = None) -> Mission:
    """As `load_mission`, of a text that was read already; `path` says what lies beside it."""
    return read_mission(parse_document(text, path, "mission"), registry)


def read_mission(document: Document, registry: Registry | None = None) -> Mission:
    """Check a document of kind `mission`. Raises FileError with all its faults."""
    return _Reader(document, (registry or Registry()).copy()).read()


class _Reader:
    def __init__(self, document: Document, registry: Registry) -> None:
        self._document = document
        self._registry = registry
        self._faults: list[Fault] = []

    def read(self) -> Mission:
        data = self._document.data
        for key in data:
            if key not in _KEYS:
                self._fault((key,), f"a mission has no key {key!r}", nearest(key, _KEYS), key=True)
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
        if self._faults:
            raise FileError(self._faults)
        return mission

    def _fault(self, loc: Location, message: str, hint: str = "", *, key: bool = False) -> None:
        self._faults.append(self._document.fault(loc, message, hint, key=key))

    def _text(self, key: str) -> str | None:
        value = self._document.data.get(key)
        if value is None or (isinstance(value, str) and value):
            return value
        self._fault((key,), f"{key!r} is a text")
        return None

    def _goal(self, value: Value) -> Expression | None:
        if value is None:
            return None
        if not isinstance(value, str):
            self._fault(("goal",), "the goal is an expression", "as 'misplaced == 0 and left <= 1'")
            return None
        try:
            goal = Expression.parse(value)
        except ExpressionError as error:
            self._fault(("goal",), f"{error}, at character {error.offset + 1} of {value!r}")
            return None
        for name in sorted(goal.names - set(_GOAL_NAMES)):
            self._fault(("goal",), f"a goal knows no {name!r}", nearest(name, _GOAL_NAMES))
        return goal

    def _plugins(self, value: Value) -> tuple[str, ...]:
        if value is None:
            return ()
        if not isinstance(value, list):
            self._fault(("plugins",), "'plugins' is a list of modules and of Python files beside the mission")
            return ()
        for index, plugin in enumerate(value):
            if not isinstance(plugin, str) or not plugin:
                self._fault(("plugins", index), "a plug-in is the name of a module or of a Python file")
                continue
            try:
                self._registry.add_plugin(plugin, self._document.path.parent)
            except PicktreeError as error:
                self._fault(("plugins", index), str(error))
        return tuple(plugin for plugin in value if isinstance(plugin, str))

    # Trees.

    def _trees(self, value: Value) -> dict[str, TreeSpec]:
        if value is None:
            self._fault((), "'trees:' is missing", "it holds 'Main:' and the sub-trees")
            return {}
        if not isinstance(value, dict):
            self._fault(("trees",), "'trees' is a mapping: a name, and the tree of that name")
            return {}
        ports = {name: self._ports(name, body) for name, body in value.items() if self._named_well(name)}
        if MAIN not in value:
            self._fault(
                ("trees",), f"the tree {MAIN!r} is missing; a mission begins there", nearest(MAIN, value)
            )
        grammar = Grammar(self._document, self._registry, ports)
        trees = {
            name: TreeSpec(name, self._document.key_mark(("trees", name)), ports[name], root)
            for name, body in value.items()
            if name in ports and (root := self._root(grammar, name, body)) is not None
        }
        self._faults += grammar.faults
        self._check_calls(trees)
        return trees

    def _named_well(self, name: str) -> bool:
        loc = ("trees", name)
        if not IDENTIFIER.fullmatch(name):
            self._fault(
                loc, f"{name!r} is not an ID", "a letter or '_', then letters, digits and '_'", key=True
            )
            return False
        if self._registry.find(name) is not None:
            self._fault(loc, f"{name!r} is a node already; a tree needs another name", key=True)
            return False
        return True

    def _root(self, grammar: Grammar, name: str, body: Value) -> NodeSpec | None:
        loc: Location = ("trees", name)
        if isinstance(body, dict):
            body = {key: value for key, value in body.items() if key != "ports"}
            if not body:
                self._fault(loc, f"the tree {name!r} has no node", key=True)
                return None
        return grammar.node(body, loc, name, Names())

    def _ports(self, tree: str, body: Value) -> tuple[PortDeclaration, ...]:
        loc: Location = ("trees", tree, "ports")
        value = body.get("ports") if isinstance(body, dict) else None
        if value is None:
            return ()
        if not isinstance(value, dict):
            self._fault(loc, "'ports' is a mapping", "as '{item: {type: object}}'")
            return ()
        found = (self._port(name, entry, (*loc, name)) for name, entry in value.items())
        return tuple(port for port in found if port is not None)

    def _port(self, name: str, value: Value, loc: Location) -> PortDeclaration | None:
        if not IDENTIFIER.fullmatch(name) or name.startswith("_") or name == "name":
            self._fault(loc, f"{name!r} cannot be the name of a port", key=True)
            return None
        entry = {"type": value} if isinstance(value, str) else value
        if not isinstance(entry, dict):
            self._fault(loc, "a port is a mapping", "as '{type: object}'")
            return None
        for key in entry:
            if key not in _PORT_KEYS:
                self._fault((*loc, key), f"a port has no key {key!r}", nearest(key, _PORT_KEYS), key=True)
        given = entry.get("type", "any")
        try:
            kind = PortType.parse(str(given))
        except ValueError as error:
            known = (*NAMES_IN_FILES, *(f"list of {known}" for known in NAMES_IN_FILES))
            self._fault((*loc, "type"), str(error), nearest(str(given), known))
            return None
        direction = entry.get("direction", "in")
        if direction not in ("in", "out"):
            self._fault((*loc, "direction"), f"the direction is 'in' or 'out', not {direction!r}")
        side: Literal["in", "out"] = "out" if direction == "out" else "in"
        unit = entry.get("unit")
        choices = entry.get("choices")
        port = PortDeclaration(
            name,
            name,
            side,
            kind,
            str(entry.get("doc", "")),
            unit if isinstance(unit, str) else None,
            REQUIRED,
            tuple(choices) if isinstance(choices, list) else None,
        )
        return self._with_default(port, entry, loc)

    def _with_default(
        self, port: PortDeclaration, entry: Mapping[str, Value], loc: Location
    ) -> PortDeclaration:
        if "default" not in entry:
            return port
        try:
            default = convert(entry["default"], port.type, port.unit, port.choices)
        except ValueError as error:
            self._fault((*loc, "default"), f"the default: {error}")
            return port
        return PortDeclaration(
            port.key, port.attribute, port.direction, port.type, port.doc, port.unit, default, port.choices
        )

    # Sub-trees in sub-trees.

    def _check_calls(self, trees: Mapping[str, TreeSpec]) -> None:
        calls = {name: [c for c in _calls(tree) if c in trees] for name, tree in trees.items()}
        try:
            order = list(TopologicalSorter(calls).static_order())
        except CycleError as error:
            circle: list[str] = list(reversed(error.args[1]))
            name, called = circle[0], circle[1]
            mark = next(n.mark for n in trees[name].root.iterate() if n.node is None and n.id == called)
            message = f"the sub-trees call each other in a circle: {' → '.join(circle)}"
            self._faults.append(Fault(mark, f"trees.{name}", message, "a loop is Repeat or ForEach"))
            return
        sizes: dict[str, tuple[int, int]] = {}
        for name in order:
            sizes[name] = _size(trees[name].root, sizes)
        count, depth = sizes.get(MAIN, (0, 0))
        if count > MAX_NODES or depth > MAX_DEPTH:
            message = f"with its sub-trees written out the mission has {count} nodes, {depth} deep"
            hint = f"at most {MAX_NODES} nodes, {MAX_DEPTH} deep"
            self._faults.append(Fault(trees[MAIN].mark, f"trees.{MAIN}", message, hint))


def _calls(tree: TreeSpec) -> Iterable[str]:
    return dict.fromkeys(node.id for node in tree.root.iterate() if node.node is None)


def _size(spec: NodeSpec, sizes: Mapping[str, tuple[int, int]]) -> tuple[int, int]:
    """Number and depth of the nodes with sub-trees written out; those are in `sizes` already."""
    below = [_size(child, sizes) for child in spec.children]
    if spec.node is None and spec.id in sizes:
        below = [sizes[spec.id]]
    return 1 + sum(count for count, _ in below), 1 + max((depth for _, depth in below), default=0)
