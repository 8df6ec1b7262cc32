"""C++ types of keys, as BehaviorTree.CPP derives them while it makes a tree: the first typed port decides."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final, cast

from picktree.files import Diagnostic
from picktree.trees import MAIN, Mission, Node, NodeSpec, PortDeclaration, TreeSpec, bottom_up, references

from .btcpp_vocabulary import PORT_TYPES, REPEAT_WHILE, SHARED_NODES
from .literal_text import ANY_TYPE, JSON, type_text, value_text

_TEXT: Final = "std::string"
_NUMBER = re.compile(r"-?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|-?(inf|infinity|nan)", re.IGNORECASE | re.ASCII)
_WHOLE = re.compile(r"-?\d+", re.ASCII)
_LIMITS: Final = {"int": (-(2**31), 2**31 - 1), "int64_t": (-(2**63), 2**63 - 1), "unsigned": (0, 2**31 - 1)}
Loose = frozenset[tuple[str, str]]
"""Ports of declared nodes, as (ID, port), whose model leaves the type open."""


@dataclass(frozen=True, slots=True)
class _KeyUse:
    """Port that is wired to a key: the type that it gives the key, and its place."""

    type: str
    spec: NodeSpec
    port: str
    trail: str
    declared: tuple[str, str] | None
    """ID and port of a node whose type the mission's model declares; None for BehaviorTree.CPP's own."""


@dataclass(slots=True)
class KeyTypes:
    """Types of the keys of a mission's trees. Where a declared node would clash, its port's type is open."""

    mission: Mission
    faults: list[Diagnostic] = field(default_factory=list[Diagnostic])
    """Yield a fault for each key that two of BehaviorTree.CPP's own nodes use with different types."""
    _loose: Loose = frozenset()
    _uses: dict[str, dict[str, list[_KeyUse]]] = field(default_factory=dict[str, dict[str, list[_KeyUse]]])
    _order: dict[str, list[tuple[str, _KeyUse]]] = field(default_factory=dict[str, list[tuple[str, _KeyUse]]])
    """Return the uses in the order in which BehaviorTree.CPP creates the nodes."""

    def __post_init__(self) -> None:
        self._loose = frozenset(self._unreadable())
        while more := self._clashes() - self._loose:
            self._loose |= more

    def loose(self, identity: str) -> frozenset[str]:
        """Return the ports of a declared node that must be open to any type."""
        return frozenset(port for node, port in self._loose if node == identity)

    def literal(self, tree: str, port: PortDeclaration, value: object) -> str | None:
        """Return a literal or default of a sub-tree's port; None when no text arrives as this value.

        From 4.9.1 on a text that is a number arrives as `int` or `double`, and no port of another type may
        read it then. A number with a unit or a space behind it arrives as a text, which all ports read.
        """
        text = value_text(value, port.type)
        if port.type.many and _stored(text) != _TEXT:
            return JSON + json.dumps(value, ensure_ascii=False)
        wanted = {use.type for use in self._uses[tree].get(port.key, ()) if use.type != ANY_TYPE}
        if _stored(text) == _TEXT or wanted <= {_stored(text)}:
            return text
        if isinstance(value, str):
            return None
        if wanted == {"double"} and _WHOLE.fullmatch(text):
            return f"{text}.0"
        return f"{text} ms" if port.unit == "ms" else f"{text} "

    # Uses of keys, in the order in which BehaviorTree.CPP makes the nodes.

    def _clashes(self) -> Loose:
        """Return the declared ports that clash with others; note faults where no port can give way."""
        self.faults, self._uses, self._order = [], {}, {}
        found: set[tuple[str, str]] = set()
        for name in bottom_up(self.mission.trees):
            tree = self.mission.trees[name]
            uses: dict[str, list[_KeyUse]] = {}
            order = self._order[name] = list(self._of_node(tree.root, name))
            for key, use in order:
                uses.setdefault(key.removeprefix(references.ROOT_KEY) if name == MAIN else key, []).append(
                    use
                )
            self._uses[name] = uses
            found.update(self._numbers(tree))
            inner = () if name == MAIN or self.mission.library else [port.key for port in tree.ports]
            for key, users in uses.items():
                if key not in inner and not key.startswith(references.ROOT_KEY):
                    found.update(self._clash(users))
        return frozenset(found)

    def _of_node(self, spec: NodeSpec, above: str) -> Iterator[tuple[str, _KeyUse]]:
        trail = f"{above}/{spec.name}"
        wired = {
            key: str(bound)[1:-1]
            for key, bound in spec.ports.items()
            if isinstance(bound, references.Reference)
        }
        if spec.node is None:
            for key, use in self._order[spec.id]:
                if key in wired or key.startswith(references.ROOT_KEY):
                    yield wired.get(key, key), use
        else:
            yield from ((name, self._use(spec, spec.node, key, trail)) for key, name in wired.items())
        for child in spec.children:
            yield from self._of_node(child, trail)

    def _use(self, spec: NodeSpec, node: type[Node], key: str, trail: str) -> _KeyUse:
        port = node.declaration.port(key)
        if spec.id in ("Condition", "SetBlackboard") or port is None:
            return _KeyUse(ANY_TYPE, spec, key, trail, None)
        if _is_own(spec):
            return _KeyUse(PORT_TYPES.get(key, ANY_TYPE), spec, key, trail, None)
        declared = (_model_id(spec), key)
        kind = ANY_TYPE if declared in self._loose else _node_type(port)
        return _KeyUse(kind, spec, key, trail, declared)

    def _numbers(self, tree: TreeSpec) -> Iterator[tuple[str, str]]:
        """Yield declared ports that read a text which looks like a number from a port of a sub-tree."""
        texts = [(tree.name, port.key, port.default) for port in tree.ports if port.direction == "in"]
        for spec in tree.root.iterate():
            if spec.node is None:
                ports = spec.ports.items()
                texts += [
                    (spec.id, key, each.value) for key, each in ports if isinstance(each, references.Constant)
                ]
        for name, key, value in texts:
            if isinstance(value, str) and _stored(value) != _TEXT:
                uses = self._uses[name].get(key, ())
                yield from (use.declared for use in uses if use.declared and use.type == _TEXT)

    def _clash(self, uses: Iterable[_KeyUse]) -> Iterator[tuple[str, str]]:
        first, *rest = uses
        if first.type in (ANY_TYPE, _TEXT):
            return  # which every port may read
        for use in rest:
            if use.type not in (ANY_TYPE, first.type):
                loose = use.declared or first.declared
                if loose is not None:
                    yield loose
                else:
                    self._fault(first, use)

    def _fault(self, first: _KeyUse, use: _KeyUse) -> None:
        bound = use.spec.ports[use.port]
        message = f"port {use.port!r}: {bound} is {first.type} at another node, and {use.type} here"
        hint = "BehaviorTree.CPP wants one type for each key; use two"
        self.faults.append(Diagnostic(use.spec.mark_at(use.port), use.trail, message, hint, "P925"))

    def _unreadable(self) -> Iterator[tuple[str, str]]:
        """Yield declared ports with a literal that BehaviorTree.CPP could not convert to their type."""
        for tree in self.mission.trees.values():
            for spec in tree.root.iterate():
                if spec.node is None or _is_own(spec):
                    continue
                for key, bound in spec.ports.items():
                    port = spec.node.declaration.port(key)
                    if (
                        port is not None
                        and isinstance(bound, references.Constant)
                        and not _converts(bound, port)
                    ):
                        yield _model_id(spec), key


def _is_own(spec: NodeSpec) -> bool:
    """Whether the node is one of BehaviorTree.CPP's own."""
    return (spec.id in SHARED_NODES or spec.id == "Switch") and _model_id(spec) == spec.id


def _model_id(spec: NodeSpec) -> str:
    return REPEAT_WHILE if spec.id == "Repeat" and "while" in spec.ports else spec.id


def _node_type(port: PortDeclaration) -> str:
    """Return the type that a declared node gives a key; ObjectId is a text in C++."""
    if port.type.name == "any":
        return ANY_TYPE
    return type_text(port.type).replace("ObjectId", _TEXT)


def _stored(text: str) -> str:
    """Return the type with which BehaviorTree.CPP 4.9.1 and later store the literal of a sub-tree's port."""
    if _WHOLE.fullmatch(text):
        number = int(text)
        kinds = ("int", "int64_t")
        return next((kind for kind in kinds if _LIMITS[kind][0] <= number <= _LIMITS[kind][1]), "double")
    return "double" if _NUMBER.fullmatch(text) else _TEXT


def _converts(bound: references.Constant, port: PortDeclaration) -> bool:
    text = value_text(bound.value, port.type)
    if port.type.many and port.type.name in ("int", "float", "bool"):
        return not text.startswith(JSON)  # which 4.7 cannot read
    return port.type.name != "int" or fits("int", bound.value)


def fits(kind: str, value: object) -> bool:
    """Whether a number is within the limits of a C++ type; true for values that are no numbers."""
    low, high = _LIMITS.get(kind, (value, value))
    return not isinstance(value, int | float) or cast("float", low) <= value <= cast("float", high)
