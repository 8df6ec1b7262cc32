"""Flow of blackboard keys through the trees of a source: their readers, writers and types."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias

from picktree.files import Mark, expression_syntax
from picktree.trees import AUTOREMAP, POSTCONDITIONS, PRECONDITIONS, PortType, references

from . import btcpp_vocabulary
from .element import Element
from .literal_text import is_pointer, type_name
from .scripts import ScriptError, read_parts

Direction: TypeAlias = Literal["in", "out"]
LOOPS: Final[Mapping[str, PortType]] = {
    "LoopInt": PortType("int", many=True), "LoopBool": PortType("bool", many=True),
    "LoopDouble": PortType("float", many=True), "LoopString": PortType("string", many=True),
}  # fmt: skip
"""Types of the lists of BehaviorTree.CPP's loops."""
TRUE_WORDS: Final = ("true", "True", "TRUE", "1")
FALSE_WORDS: Final = ("false", "False", "FALSE", "0")
_SCRIPTS: Final = {"Script": "code", "ScriptCondition": "code", "Precondition": "if"}
_KEY_PORTS: Final = {"WasEntryUpdated": "entry", "SkipUnlessUpdated": "entry", "WaitValueUpdate": "entry"}


@dataclass(frozen=True, slots=True)
class PortUse:
    """Port of a node for the flow of keys. `direction` None: undeclared."""

    direction: Direction | None
    type: PortType = PortType("any")  # noqa: RUF009 - it is frozen


PortFinder: TypeAlias = Callable[[Element, str], PortUse | None]
"""Function that returns the port of an element's attribute; None for an attribute that is no port."""


@dataclass(frozen=True, slots=True)
class UndecidedPort:
    """Wire to a port without a declared direction."""

    tree: str
    key: str
    node: str
    port: str


@dataclass(slots=True)
class KeyGroup:
    """Keys of several trees that are one entry, as ports of sub-trees connect them."""

    written: bool = False
    created: bool = False
    """Whether the key is written other than by `=`, which needs an existing key."""
    compared_with_text: bool = False
    listed: PortType | None = None
    """Type of the list that a node expects there; None: no node expects a list."""
    read: Mark | None = None


@dataclass(slots=True)
class _TreeUses:
    reads: dict[str, Mark] = field(default_factory=dict[str, Mark])
    writes: set[str] = field(default_factory=set[str])
    calls: list[Element] = field(default_factory=list[Element])


class KeyFlow:
    """Reads and writes of all trees."""

    def __init__(
        self,
        trees: Mapping[str, Element],
        ports: PortFinder,
        main: str = "",
        enums: Mapping[str, int] | None = None,
    ) -> None:
        self._trees = trees
        self._enums = enums or {}
        self._main = main
        self._ports = ports
        self._uses = {name: _TreeUses() for name in trees}
        self._above: dict[tuple[str, str], tuple[str, str]] = {}
        self._groups: dict[tuple[str, str], KeyGroup] = {}
        self.undecided: list[UndecidedPort] = []
        self.watched: set[str] = set()
        """Keys whose existence or change nodes test: these need no value."""
        for name, element in self._in_order():
            self._element(name, element)
        more = True
        while more:
            more = False
            for name in trees:
                more |= self._through_calls(name)

    def reads(self, tree: str) -> Mapping[str, Mark]:
        """Return the keys that a tree reads, sub-trees included, with the first place."""
        return self._uses[tree].reads if tree in self._uses else {}

    def writes(self, tree: str) -> set[str]:
        """Return the keys that a tree writes, sub-trees included."""
        return self._uses[tree].writes if tree in self._uses else set()

    def group(self, tree: str, key: str) -> KeyGroup:
        return self._groups.setdefault(self._root(tree, key), KeyGroup())

    def _in_order(self) -> Iterator[tuple[str, Element]]:
        """Yield all elements in the order in which they run: sub-trees where they are called first."""
        seen: set[str] = set()
        for first in (self._main, *self._trees):
            if first in seen or first not in self._trees:
                continue
            seen.add(first)
            open_ = [(first, self._trees[first].iterate())]
            while open_:
                name, rest = open_[-1]
                element = next(rest, None)
                if element is None:
                    open_.pop()
                    continue
                yield name, element
                called = element.get("ID") if element.name == "SubTree" else ""
                if called in self._trees and called not in seen:
                    seen.add(called)
                    open_.append((called, self._trees[called].iterate()))

    # Elements.

    def _element(self, tree: str, element: Element) -> None:
        if element.name == "SubTree":
            self._call(tree, element)
            return
        identity = element.identity
        ours = identity in btcpp_vocabulary.OURS
        for key, text in element.attributes.items():
            mark = element.place(key)
            if not ours and (_SCRIPTS.get(identity) == key or key in (*PRECONDITIONS, *POSTCONDITIONS)):
                is_value_used = key not in (*POSTCONDITIONS, "code") or identity == "ScriptCondition"
                self._script(tree, text, mark, asked=is_value_used)
            elif identity == "SetBlackboard" and key == "output_key":
                self._write(tree, text)
                if is_pointer(element.get("value")):
                    self._join(tree, text, tree, _bare(element.get("value")))
            elif _KEY_PORTS.get(identity) == key:
                bare = _bare(text) or text.strip()
                if bare not in self._uses[tree].reads:
                    self.watched.add(bare)
                    self._uses[tree].reads[bare] = mark
            elif key not in ("ID", "name") and is_pointer(text):
                self._wire(tree, element, key, f"{{{key}}}" if text.strip() == "{=}" else text)

    def _wire(self, tree: str, element: Element, port: str, text: str) -> None:
        key, use = _bare(text), self._use(element, port)
        if use is None or not key:
            return
        if use.direction is None:
            self.undecided.append(UndecidedPort(tree, key, element.identity, port))
        elif use.direction == "out":
            self._write(tree, key)
        else:
            self._read(tree, key, element.place(port))
            if use.type.many:
                self.group(tree, key).listed = use.type

    def _use(self, element: Element, port: str) -> PortUse | None:
        identity = element.identity
        if identity in LOOPS:
            ways: dict[str, PortUse] = {"queue": PortUse("in", LOOPS[identity]), "value": PortUse("out")}
            return ways.get(port)
        if identity in btcpp_vocabulary.TRANSLATED or btcpp_vocabulary.SWITCH.fullmatch(identity):
            return PortUse("in")
        return self._ports(element, port)

    def _script(self, tree: str, text: str, mark: Mark, *, asked: bool) -> None:
        """Read a script. `asked`: whether its unassigned value is used."""
        try:
            parts = read_parts(text, self._enums)
        except ScriptError:
            return
        for part in (each for each in parts if asked or each.key):
            for each in expression_syntax.walk(part.value):
                if isinstance(each, expression_syntax.Name):
                    self._read(tree, each.name, mark)
            for name in _compared_with_text(part.value):
                self.group(tree, name).compared_with_text = True
            if part.key:
                if not part.new:
                    self._read(tree, part.key, mark)
                self._write(tree, part.key, creates=part.new)

    def _call(self, tree: str, element: Element) -> None:
        self._uses[tree].calls.append(element)
        called = element.get("ID")
        for key, text in element.attributes.items():
            if key in (*PRECONDITIONS, *POSTCONDITIONS):
                self._script(tree, text, element.place(key), asked=key in PRECONDITIONS)
            elif key in ("ID", "name") or key.startswith("_"):
                continue
            elif is_pointer(text):
                bare = key if text.strip() == "{=}" else _bare(text)
                if bare:
                    self._join(tree, bare, called, key)
            else:
                group = self.group(called, key)
                group.written = group.created = True

    def _through_calls(self, tree: str) -> bool:
        """Propagate reads and writes of sub-trees to their callers; return whether anything is new."""
        uses = self._uses[tree]
        before = len(uses.reads) + len(uses.writes)
        for call in uses.calls:
            below = self._uses.get(call.get("ID"))
            if below is None:
                continue
            shared = call.get(AUTOREMAP) in TRUE_WORDS
            for key in (*below.reads, *below.writes):
                own = key
                if key in call.attributes:
                    text = call.get(key)
                    own = (key if text.strip() == "{=}" else _bare(text)) if is_pointer(text) else ""
                elif not shared or key.startswith("_"):
                    own = ""
                else:
                    self._join(tree, key, call.get("ID"), key)
                if own and key in below.reads:
                    uses.reads.setdefault(own, call.place(key))
                if own and key in below.writes:
                    uses.writes.add(own)
        return len(uses.reads) + len(uses.writes) > before

    # Keys.

    def _read(self, tree: str, key: str, mark: Mark) -> None:
        tree, key = self._home(tree, key)
        self.watched.discard(key)
        self._uses[tree].reads.setdefault(key, mark)
        group = self.group(tree, key)
        group.read = group.read or mark

    def _write(self, tree: str, key: str, *, creates: bool = True) -> None:
        tree, key = self._home(tree, key)
        self._uses[tree].writes.add(key)
        group = self.group(tree, key)
        group.written = True
        group.created = group.created or creates

    def decide(self, port: UndecidedPort, direction: Direction) -> None:
        """Settle the direction of one wire."""
        if direction == "out":
            self._write(port.tree, port.key)
        else:
            self._read(port.tree, port.key, self._trees[port.tree].mark)

    def _home(self, tree: str, key: str) -> tuple[str, str]:
        """Return the tree of a key: `@key` belongs to the first tree."""
        if not key.startswith(references.ROOT_KEY):
            return tree, key
        return self._main if self._main in self._uses else tree, key.removeprefix(references.ROOT_KEY)

    def _root(self, tree: str, key: str) -> tuple[str, str]:
        place = self._home(tree, key)
        while place in self._above:
            place = self._above[place]
        return place

    def _join(self, tree: str, key: str, other: str, inner: str) -> None:
        first, second = self._root(tree, key), self._root(other, inner)
        if first == second:
            return
        kept = self._groups.setdefault(first, KeyGroup())
        lost = self._groups.pop(second, KeyGroup())
        self._above[second] = first
        kept.written |= lost.written
        kept.created |= lost.created
        kept.compared_with_text |= lost.compared_with_text
        kept.listed = kept.listed or lost.listed
        kept.read = kept.read or lost.read


def _bare(text: str) -> str:
    """Return the key of a reference; empty for any other text."""
    try:
        reference = references.Reference.parse(text.strip(" "))
    except ValueError:
        return ""
    return reference.key if reference is not None else text.strip(" ") if "{" not in text else ""


def _compared_with_text(part: expression_syntax.Part) -> Iterator[str]:
    """Yield the names that are compared with a literal text."""
    for each in expression_syntax.walk(part):
        if isinstance(each, expression_syntax.ComparisonChain):
            sides = (each.first, *(link.operand for link in each.rest))
            if any(
                isinstance(side, expression_syntax.LiteralValue) and isinstance(side.value, str)
                for side in sides
            ):
                yield from (side.name for side in sides if isinstance(side, expression_syntax.Name))


def port_type(text: str) -> PortType:
    """Return the type for a C++ type's name."""
    return PortType.parse(type_name(text))
