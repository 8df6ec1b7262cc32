"""Translation of BehaviorTree.CPP's nodes to other nodes of a mission, and of the nodes for inexpressible
scripts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

from ...files.expressions.syntax_tree import Not, Part
from ...files.marks import Mark
from ...files.yaml.writer import MarkedValue
from ...trees.port_types import PortType
from . import btcpp_vocabulary
from .attributes import COMMON, ElementReader, NodeDraft, alone
from .element import Element
from .key_flow import LOOPS
from .literal_text import is_pointer
from .script_export import expression_text
from .script_import import ScriptError, Statement, read_expression, read_parts

Translation: TypeAlias = Callable[[Element, str], NodeDraft]
_ANY = PortType("any")
_ELSE = {"FAILURE": "_failureIf", "SUCCESS": "_successIf", "SKIPPED": "_skipIf"}


class Translations:
    """Translator of elements to other nodes; `reader` reads their children and collects the errors."""

    def __init__(self, reader: ElementReader, enums: Mapping[str, int]) -> None:
        self._reader = reader
        self._enums = enums
        self.switches: dict[Mark, MarkedValue] = {}
        """Cases of the foreign Switches by their place."""
        self._ways: Mapping[str, Translation] = {
            "ScriptCondition": self._script_condition,
            "Script": self._script,
            "SetBlackboard": self._set_blackboard,
            "Precondition": self._precondition,
            btcpp_vocabulary.CHECK: self._check,
            btcpp_vocabulary.ASSIGN: self._assign,
            btcpp_vocabulary.GUARDED: self._guarded,
            "ForEach": self._for_each,
            **dict.fromkeys(LOOPS, self._loop),
        }

    def of(self, identity: str) -> Translation | None:
        """Return the translation for an ID; None for a node without one."""
        if btcpp_vocabulary.SWITCH.fullmatch(identity):
            return self._switch
        return self._ways.get(identity)

    def _script_condition(self, element: Element, trail: str) -> NodeDraft:
        self._reader.only(element, ("code",), trail)
        self._reader.count(element, element.identity, 0, 0, trail)
        draft = NodeDraft.of("Condition", element.mark)
        if not self._reader.needed(element, "code", trail):
            return draft
        assigned = self._assigned_before(element)
        if assigned is None:
            draft.put("if", self._reader.condition(element, "code", trail), element.place("code"))
            return draft
        statements, condition = assigned
        mark = element.place("code")
        script = NodeDraft.of("Script", element.mark)
        script.put("code", "; ".join(statement.text() for statement in statements), mark)
        draft.put("if", expression_text(condition), mark)
        both = NodeDraft.of("Sequence", element.mark)
        both.put("do", MarkedValue(element.mark, items=[script.written(), draft.written()]))
        return both

    def _assigned_before(self, element: Element) -> tuple[tuple[Statement, ...], Part] | None:
        """Return assignments and the condition behind them; None where there is only a condition."""
        try:
            *statements, last = read_parts(element.get("code"), self._enums)
        except ScriptError:
            return None
        if not statements or last.key or not all(statement.key for statement in statements):
            return None
        return tuple(statements), last.value

    def _script(self, element: Element, trail: str) -> NodeDraft:
        """Translate a Script; one constant or copy that the export has marked is a SetBlackboard."""
        self._reader.only(element, ("code", btcpp_vocabulary.SETS), trail)
        self._reader.count(element, element.identity, 0, 0, trail)
        code, mark = self._reader.needed(element, "code", trail), element.place("code")
        try:
            statements = self._reader.statements(element, "code", trail) if code else ()
        except ScriptError as error:
            self._reader.script_fault(element, "code", error, trail)
            return NodeDraft.of("AlwaysSuccess", element.mark)
        first = (
            statements[0] if len(statements) == 1 and btcpp_vocabulary.SETS in element.attributes else None
        )
        constant = first.constant() if first is not None else None
        if first is not None and constant is not None:
            draft = NodeDraft.of("SetBlackboard", element.mark)
            draft.put("value", MarkedValue(mark, constant), mark)
            draft.put("output_key", f"{{{first.key}}}", mark)
            return draft
        if not statements:
            return NodeDraft.of("AlwaysSuccess", element.mark)
        draft = NodeDraft.of("Script", element.mark)
        draft.put("code", "; ".join(statement.text() for statement in statements), mark)
        return draft

    def _assign(self, element: Element, trail: str) -> NodeDraft:
        self._reader.only(element, ("code",), trail)
        self._reader.count(element, element.identity, 0, 0, trail)
        draft = NodeDraft.of("Script", element.mark)
        draft.put("code", self._reader.needed(element, "code", trail), element.place("code"))
        return draft

    def _set_blackboard(self, element: Element, trail: str) -> NodeDraft:
        self._reader.only(element, ("value", "output_key"), trail)
        self._reader.count(element, element.identity, 0, 0, trail)
        draft = NodeDraft.of("SetBlackboard", element.mark)
        self._reader.needed(element, "value", trail)
        key = self._reader.needed(element, "output_key", trail)
        if is_pointer(key):
            message = f"'output_key': BehaviorTree.CPP looks into {key} for the name of the key"
            hint = f"write the name itself: {key.strip('{ }')!r}"
            self._reader.fault(element.place("output_key"), trail, message, hint, code="P911")
            key = key.strip("{ }")
        kind = self._reader.literal_type(self._reader.tree, key, _ANY)
        self._reader.port(draft, "value", kind, element, "value", trail)
        draft.put("output_key", f"{{{key}}}", element.place("output_key"))
        return draft

    def _precondition(self, element: Element, trail: str) -> NodeDraft:
        self._reader.only(element, ("if", "else"), trail)
        self._reader.needed(element, "if", trail)
        status = element.get("else", "FAILURE")
        if status not in _ELSE:
            message = f"'else': {status!r} has no counterpart"
            self._reader.fault(
                element.place("else"), trail, message, "FAILURE, SUCCESS or SKIPPED", code="P907"
            )
        condition = self._negated(element, trail)
        child = self._child(element, trail)
        if child is None:
            return NodeDraft.of("AlwaysSuccess", element.mark)
        guarded = child.guarded(_ELSE.get(status, "_failureIf"), condition, element.place("if"))
        return self._apart(element, guarded)

    def _negated(self, element: Element, trail: str) -> str:
        try:
            part = read_expression(element.get("if", "true"), self._enums)
        except ScriptError as error:
            self._reader.script_fault(element, "if", error, trail)
            return "false"
        return expression_text(part.operand if isinstance(part, Not) else Not(part.at, part))

    def _child(self, element: Element, trail: str) -> NodeDraft | None:
        self._reader.count(element, element.identity, 1, 1, trail)
        return self._reader.node(element.children[0], trail) if element.children else None

    def _apart(self, element: Element, child: NodeDraft) -> NodeDraft:
        """Return the child in place of a decorator that vanishes; attributes of the decorator need a node."""
        own = [key for key in element.attributes if key in COMMON and key not in btcpp_vocabulary.IGNORED]
        if not own:
            return child
        outer = NodeDraft.of("Sequence", element.mark)
        outer.put("do", MarkedValue(element.mark, items=[child.written()]))
        return outer

    def _for_each(self, element: Element, trail: str) -> NodeDraft:
        """Translate the ForEach of MoveIt Pro."""
        self._reader.only(element, ("vector_in", "out", "index"), trail)
        index = element.get("index").strip("{} ")
        if index and self._reader.is_read(index):
            message = "'index': a ForEach does not count its elements"
            hint = "count with a Script in the loop"
            self._reader.fault(element.place("index"), trail, message, hint, code="P907")
        elif index:
            message = f"nobody reads the index {index!r}; it is left out"
            self._reader.faults.note(element.place("index"), trail, message, code="P918")
        draft = NodeDraft.of("ForEach", element.mark)
        self._reader.needed(element, "out", trail)
        self._reader.port(draft, "in", PortType("any", many=True), element, "vector_in", trail)
        self._reader.port(draft, "out", _ANY, element, "out", trail)
        child = self._child(element, trail)
        if child is not None:
            draft.put("do", alone(child.written()))
        return draft

    def _loop(self, element: Element, trail: str) -> NodeDraft:
        self._reader.only(element, ("queue", "if_empty", "value"), trail)
        draft = NodeDraft.of("ForEach", element.mark)
        self._reader.needed(element, "queue", trail)
        self._reader.needed(element, "value", trail)
        self._reader.port(draft, "in", LOOPS[element.identity], element, "queue", trail)
        self._reader.port(draft, "out", _ANY, element, "value", trail)
        child = self._child(element, trail)
        if child is not None:
            draft.put("do", alone(child.written()))
        return self._ended(element, draft, trail)

    def _ended(self, element: Element, loop: NodeDraft, trail: str) -> NodeDraft:
        """Return the loop so that it ends as `if_empty` says, which it does behind the last element, too."""
        match element.get("if_empty", "SUCCESS"):
            case "SUCCESS":
                return loop
            case "FAILURE":
                outer = NodeDraft.of("ForceFailure", element.mark)
                outer.put("do", alone(loop.written()))
            case "SKIPPED":
                skipped = NodeDraft.of("AlwaysSuccess", element.mark)
                skipped.put("_skipIf", True)
                outer = NodeDraft.of("IfThenElse", element.mark)
                outer.put("do", MarkedValue(element.mark, items=[loop.written(), skipped.written()]))
            case other:
                message = f"'if_empty' is SUCCESS, FAILURE or SKIPPED, not {other!r}"
                self._reader.fault(element.place("if_empty"), trail, message, code="P911")
                return loop
        return outer

    def _switch(self, element: Element, trail: str) -> NodeDraft:
        count = int(element.identity.removeprefix("Switch")[:4])
        cases = tuple(f"case_{index}" for index in range(1, count + 1))
        self._reader.only(element, ("variable", *cases), trail)
        self._reader.needed(element, "variable", trail)
        draft = NodeDraft.of("Switch", element.mark)
        self._reader.port(draft, "variable", _ANY, element, "variable", trail)
        self._reader.count(element, element.identity, count + 1, count + 1, trail)
        table = MarkedValue.mapping(element.mark)
        for case, child in zip(cases, element.children, strict=False):
            label = self._reader.needed(element, case, trail)
            if table.get(label) is not None:
                self._reader.fault(
                    element.place(case), trail, f"the case {label!r} is given twice", code="P911"
                )
            table.put(label, self._reader.slot_value(child, label, trail), child.mark)
        draft.put("cases", table)
        self.switches[element.mark] = table
        if (
            len(element.children) > count
            and btcpp_vocabulary.NO_CASE not in element.children[count].attributes
        ):
            draft.put("default", self._reader.slot_value(element.children[count], "default", trail))
        return draft

    # Nodes of the export for inexpressible scripts.

    def _check(self, element: Element, trail: str) -> NodeDraft:
        self._reader.only(element, ("if",), trail)
        self._reader.count(element, element.identity, 0, 0, trail)
        draft = NodeDraft.of("Condition", element.mark)
        draft.put("if", self._reader.needed(element, "if", trail), element.place("if"))
        return draft

    def _guarded(self, element: Element, trail: str) -> NodeDraft:
        self._reader.only(element, tuple(btcpp_vocabulary.GUARDS.values()), trail)
        child = self._child(element, trail)
        if child is None:
            return NodeDraft.of("AlwaysSuccess", element.mark)
        given = {key: port for key, port in btcpp_vocabulary.GUARDS.items() if port in element.attributes}
        if any(child.body.get(key) for key in btcpp_vocabulary.GUARDS):
            outer = NodeDraft.of("Sequence", element.mark)
            outer.put("do", MarkedValue(element.mark, items=[child.written()]))
            child = outer
        entries = child.body.entries
        assert entries is not None
        own = entries[:]
        named = [entry for entry in own if entry.key == "name"]
        child.body.entries = named
        for key, port in given.items():
            child.put(key, element.get(port), element.place(port))
        child.body.entries += [entry for entry in own if entry.key != "name"]
        return self._apart(element, child)
