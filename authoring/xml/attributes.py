"""Reader of an element's attributes: values of ports, conditions, names; and number of children."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace

from picktree.files import Mark, expression_syntax, suggest_name
from picktree.files.yaml import MarkedValue, Scalar, from_value
from picktree.trees import POSTCONDITIONS, PRECONDITIONS, PortType

from . import btcpp_vocabulary
from .element import Element, one_line
from .literal_text import is_pointer, read_value
from .renaming import MAX_NAME_LENGTH, node_name
from .scripts import ScriptError, Statement, expression_text, read_expression, read_parts
from .source import ImportFaults

CONDITIONS = (*PRECONDITIONS, *POSTCONDITIONS)


@dataclass(slots=True)
class NodeDraft:
    """Node under construction. `keys`: those of the node's class; a child of such an ID is under `do:`."""

    id: str
    mark: Mark
    body: MarkedValue
    keys: Collection[str] = ()
    comments: tuple[str, ...] = field(default=())
    end_comments: tuple[str, ...] = field(default=())

    @classmethod
    def of(cls, identity: str, mark: Mark, keys: Collection[str] = ()) -> NodeDraft:
        return cls(identity, mark, MarkedValue.mapping(mark), keys)

    def put(self, key: str, value: MarkedValue | Scalar, mark: Mark | None = None) -> None:
        self.body.put(key, value, mark)

    @classmethod
    def around(cls, identity: str, mark: Mark, *children: NodeDraft) -> NodeDraft:
        """Return a node with these nodes in a list under `do`."""
        outer = cls.of(identity, mark)
        outer.put("do", MarkedValue(mark, items=[child.written() for child in children]))
        return outer

    def guarded(self, conditions: Mapping[str, tuple[str, Mark]]) -> NodeDraft:
        """Return the node with more conditions, evaluated before its own."""
        guarded = self
        if any(self.body.get(known) for known in CONDITIONS):
            guarded = NodeDraft.around("Sequence", self.mark, self)
        entries = guarded.body.entries or []
        guarded.body.entries = [entry for entry in entries if entry.key == "name"]
        for key, (condition, mark) in conditions.items():
            guarded.put(key, condition, mark)
        guarded.body.entries += [entry for entry in entries if entry.key != "name"]
        return guarded

    def written(self) -> MarkedValue:
        """Return the node in the shortest form that a mission allows."""
        entries = self.body.entries or []
        if not entries:
            return MarkedValue(self.mark, self.id, comments=(*self.comments, *self.end_comments))
        body = self.body
        body.end_comments = self.end_comments
        if len(entries) == 1 and entries[0].key == "do":
            child = entries[0].value
            named = child.entries[0].key if child.entries is not None and len(child.entries) == 1 else ""
            if named not in (*self.keys, "do"):
                body = child
                body.end_comments = (*body.end_comments, *self.end_comments)
        whole = MarkedValue.mapping(self.mark)
        whole.comments = self.comments
        whole.put(self.id, body, self.mark)
        return whole


def alone(child: MarkedValue) -> MarkedValue:
    """Return a child for the place of a single node: its comments go above its ID."""
    if not child.comments or child.items is not None:
        return child
    if child.entries is None:
        whole = MarkedValue.mapping(child.mark)
        whole.put(str(child.scalar), MarkedValue.mapping(child.mark), child.mark)
    else:
        whole = child
    assert whole.entries is not None
    first = whole.entries[0].value
    first.comments, child.comments = (*child.comments, *first.comments), ()
    return whole


COMMON = (
    "name",
    btcpp_vocabulary.OWN_NAME,
    btcpp_vocabulary.BREAKPOINT,
    *PRECONDITIONS,
    *POSTCONDITIONS,
    *btcpp_vocabulary.IGNORED,
)
"""Attributes that every node may have."""


class ElementReader(ABC):
    """Reader of elements and their attributes; errors and notes go to `faults`."""

    def __init__(self, faults: ImportFaults) -> None:
        self.faults = faults
        self.enums: Mapping[str, int] = {}
        """Numbers by their names in scripts."""
        self.tree = ""
        """ID of the tree that is being read."""

    @abstractmethod
    def literal_type(self, tree: str, key: str, declared: PortType) -> PortType:
        """Return the type with which a literal for a key of a tree is read."""
        ...

    @abstractmethod
    def node(self, element: Element, above: str) -> NodeDraft:
        """Read one element and its descendants."""
        ...

    @abstractmethod
    def is_read(self, key: str) -> bool:
        """Whether any node reads a key of the present tree."""
        ...

    @abstractmethod
    def is_created(self, key: str) -> bool:
        """Whether any node creates a key of the present tree."""
        ...

    def slot_value(self, child: Element, label: str, trail: str) -> MarkedValue:
        """Return a child in a slot; a Sequence with the slot's name is written as a list."""
        if child.name == "Sequence" and dict(child.attributes) == {"name": label} and child.children:
            below = f"{trail}/{label}"
            items = [self.node(grandchild, below).written() for grandchild in child.children]
            return MarkedValue(
                child.mark, items=items, comments=child.comments, end_comments=child.end_comments
            )
        return alone(self.node(child, trail).written())

    def fault(self, mark: Mark, trail: str, message: str, hint: str = "", *, code: str) -> None:
        self.faults.fault(mark, trail, message, hint, code=code)

    def port(
        self, draft: NodeDraft, key: str, kind: PortType, element: Element, attribute: str, trail: str
    ) -> None:
        """Put the attribute's value under the port's key."""
        draft.put(key, self.value(element, attribute, kind, trail), element.place(attribute))

    def value(self, element: Element, attribute: str, kind: PortType, trail: str) -> MarkedValue:
        """Return a literal or a reference in the form of a mission."""
        text, mark = element.get(attribute), element.place(attribute)
        if is_pointer(text) and kind.name != "expression":
            bare = text.strip(" ")
            return MarkedValue(mark, f"{{{attribute}}}" if bare == "{=}" else bare)
        try:
            return from_value(read_value(text, kind), mark)
        except ValueError as error:
            self.fault(mark, trail, f"{attribute!r}: {error}", code="P911")
            return MarkedValue(mark, text)

    def no_port(self, element: Element, key: str, identity: str, known: Iterable[str], trail: str) -> None:
        """Report an attribute that is no port. BehaviorTree.CPP ignores those that begin with `_`."""
        if key.startswith("_"):
            near = suggest_name(key, CONDITIONS)
            hint = near if near.startswith("did") else ""
            message = f"the attribute {key!r} has no meaning for a run"
            self.faults.note(element.place(key), trail, message, hint, code="P908")
            return
        message = f"{identity} has no port {key!r}"
        self.fault(element.place(key), trail, message, suggest_name(key, known), code="P908")

    def only(self, element: Element, known: tuple[str, ...], trail: str) -> None:
        """Report attributes that a node of BehaviorTree.CPP does not have."""
        for key in element.attributes:
            if key not in (*COMMON, *known, "ID"):
                self.no_port(element, key, element.identity, (*known, "name"), trail)

    def needed(self, element: Element, attribute: str, trail: str) -> str:
        if attribute not in element.attributes:
            message = f"{element.identity} needs the port {attribute!r}"
            self.fault(element.mark, trail, message, code="P908")
        return element.get(attribute)

    def count(
        self, element: Element, identity: str, least: int, most: int, trail: str, given: int | None = None
    ) -> None:
        count = len(element.children) if given is None else given
        if not least <= count <= most:
            words = "no child" if most == 0 else str(most)
            hint = "put several into a Sequence" if 0 < most < count else ""
            message = f"{identity} has {count} children; it takes {words}"
            self.fault(element.mark, trail, message, hint, code="P909")

    def common(self, element: Element, draft: NodeDraft, trail: str) -> None:
        description = one_line(element.get(btcpp_vocabulary.DESCRIPTION))
        draft.comments = (*element.comments, *((description,) if description else ()), *draft.comments)
        draft.end_comments = (*draft.end_comments, *element.end_comments)
        name = self._name(element, trail)
        entries = draft.body.entries
        assert entries is not None
        own, draft.body.entries = entries, []
        default = (draft.id, "" if element.name == "SubTree" else element.identity)
        if (name and name not in default) or btcpp_vocabulary.OWN_NAME in element.attributes:
            draft.put("name", name, element.place("name"))
        for key in PRECONDITIONS:
            if key in element.attributes:
                draft.put(key, self.condition(element, key, trail), element.place(key))
        for key in POSTCONDITIONS:
            code = self.assignments(element, key, trail) if key in element.attributes else ""
            if code:
                draft.put(key, code, element.place(key))
        if btcpp_vocabulary.BREAKPOINT in element.attributes:
            mark = element.place(btcpp_vocabulary.BREAKPOINT)
            draft.put("breakpoint", element.get(btcpp_vocabulary.BREAKPOINT), mark)
        draft.body.entries += own

    def _name(self, element: Element, trail: str) -> str:
        """Return the node's name, or a similar one that is valid in a mission."""
        name = element.get(btcpp_vocabulary.OWN_NAME) or element.get("name")
        fit = node_name(name) if name else ""
        if len(name) > MAX_NAME_LENGTH or re.search(r"[/#\n\r]", name):
            message = f"the node {name[:80]!r} is called {fit!r} in the mission"
            self.faults.note(element.place("name"), trail, message, code="P917")
            return fit
        return name

    def condition(self, element: Element, attribute: str, trail: str) -> str | bool:
        """Return a script as an expression."""
        try:
            part = read_expression(element.get(attribute), self.enums)
        except ScriptError as error:
            self.script_fault(element, attribute, error, trail)
            return True
        if isinstance(part, expression_syntax.LiteralValue) and isinstance(part.value, bool):
            return part.value
        return expression_text(part)

    def assignments(self, element: Element, attribute: str, trail: str) -> str:
        try:
            return "; ".join(each.text() for each in self.statements(element, attribute, trail))
        except ScriptError as error:
            self.script_fault(element, attribute, error, trail)
            return ""

    def statements(self, element: Element, attribute: str, trail: str) -> tuple[Statement, ...]:
        """Return the assignments of a script; unassigned values are left out. Raises ScriptError."""
        statements = read_parts(element.get(attribute), self.enums)
        for bare in (each for each in statements if not each.key):
            message = (
                f"{attribute}: nothing gets the value of '{expression_text(bare.value)}'; it is left out"
            )
            mark, hint = element.place(attribute), "an assignment is written with ':='"
            self.faults.note(mark, trail, message, hint, code="P910")
        return tuple(self._created(each, element, attribute, trail) for each in statements if each.key)

    def _created(self, statement: Statement, element: Element, attribute: str, trail: str) -> Statement:
        """Return a statement that creates its key when otherwise only the program could have created it."""
        names = (
            part.name
            for part in expression_syntax.walk(statement.value)
            if isinstance(part, expression_syntax.Name)
        )
        if statement.new or self.is_created(statement.key) or statement.key in names:
            return statement
        message = f"the program makes the key {statement.key!r}; it is made here"
        self.faults.note(element.place(attribute), trail, message, code="P918")
        return replace(statement, new=True)

    def script_fault(self, element: Element, attribute: str, error: ScriptError, trail: str) -> None:
        text = element.get(attribute)
        at = f", at character {error.offset + 1} of {text[:60]!r}"
        self.fault(element.place(attribute), trail, f"{attribute}: {error}{at}", code="P910")
