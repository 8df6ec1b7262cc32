"""Importer of nodes: elements of trees as nodes of a mission, and the translation of those that missions do
not have.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from picktree.files import Mark, expression_syntax, suggest_name
from picktree.files.yaml import MarkedValue
from picktree.trees import AUTOREMAP, Node, NodeDeclaration, PortType, SlotDeclaration
from picktree.trees.loading import NodeRegistry

from . import btcpp_vocabulary
from .attributes import COMMON, ElementReader, NodeDraft, alone
from .btcpp_vocabulary import SlotRow, read_indexes, read_table
from .element import Element
from .key_flow import FALSE_WORDS, LOOPS, TRUE_WORDS, KeyFlow
from .literal_text import is_pointer
from .port_import import TreePort, literal_type
from .renaming import identifier
from .scripts import ScriptError, Statement, expression_text, read_expression, read_parts
from .source import ImportFaults, XmlSource
from .stubs import StubNode, stub_class

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
        draft = self._leaf("Condition", element, ("code",), trail)
        if not self._reader.needed(element, "code", trail):
            return draft
        assigned = self._assigned_before(element)
        if assigned is None:
            draft.put("if", self._reader.condition(element, "code", trail), element.place("code"))
            return draft
        statements, condition = assigned
        draft.put("if", expression_text(condition), element.place("code"))
        return NodeDraft.around("Sequence", element.mark, _script_of(element, statements), draft)

    def _leaf(self, identity: str, element: Element, ports: tuple[str, ...], trail: str) -> NodeDraft:
        """Return a node without children; report children, and attributes that are no ports."""
        self._reader.only(element, ports, trail)
        self._reader.count(element, element.identity, 0, 0, trail)
        return NodeDraft.of(identity, element.mark)

    def _assigned_before(
        self, element: Element
    ) -> tuple[tuple[Statement, ...], expression_syntax.Part] | None:
        """Return assignments and the condition behind them; None for a condition alone."""
        try:
            *statements, last = read_parts(element.get("code"), self._enums)
        except ScriptError:
            return None
        if not statements or last.key or not all(statement.key for statement in statements):
            return None
        return tuple(statements), last.value

    def _script(self, element: Element, trail: str) -> NodeDraft:
        """Translate a Script; one constant or copy that the export has marked is a SetBlackboard."""
        draft = self._leaf("SetBlackboard", element, ("code", btcpp_vocabulary.SETS), trail)
        code, mark = self._reader.needed(element, "code", trail), element.place("code")
        try:
            statements = self._reader.statements(element, "code", trail) if code else ()
        except ScriptError as error:
            self._reader.script_fault(element, "code", error, trail)
            return NodeDraft.of("AlwaysSuccess", element.mark)
        if len(statements) == 1 and btcpp_vocabulary.SETS in element.attributes:
            (statement,) = statements
            constant = statement.constant()
            if constant is not None:
                draft.put("value", MarkedValue(mark, constant), mark)
                draft.put("output_key", f"{{{statement.key}}}", mark)
                return draft
        return _script_of(element, statements) if statements else NodeDraft.of("AlwaysSuccess", element.mark)

    def _assign(self, element: Element, trail: str) -> NodeDraft:
        draft = self._leaf("Script", element, ("code",), trail)
        draft.put("code", self._reader.needed(element, "code", trail), element.place("code"))
        return draft

    def _set_blackboard(self, element: Element, trail: str) -> NodeDraft:
        draft = self._leaf("SetBlackboard", element, ("value", "output_key"), trail)
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
            hint = "FAILURE, SUCCESS or SKIPPED"
            self._reader.fault(element.place("else"), trail, message, hint, code="P907")
        condition = self._negated(element, trail)
        child = self._child(element, trail)
        if child is None:
            return NodeDraft.of("AlwaysSuccess", element.mark)
        guard = _ELSE.get(status, "_failureIf")
        return self._apart(element, child.guarded({guard: (condition, element.place("if"))}))

    def _negated(self, element: Element, trail: str) -> str:
        try:
            part = read_expression(element.get("if", "true"), self._enums)
        except ScriptError as error:
            self._reader.script_fault(element, "if", error, trail)
            return "false"
        return expression_text(
            part.operand if isinstance(part, expression_syntax.Not) else expression_syntax.Not(part.at, part)
        )

    def _child(self, element: Element, trail: str) -> NodeDraft | None:
        self._reader.count(element, element.identity, 1, 1, trail)
        return self._reader.node(element.children[0], trail) if element.children else None

    def _apart(self, element: Element, child: NodeDraft) -> NodeDraft:
        """Return the child in place of a decorator that vanishes; attributes of the decorator need a node."""
        own = [key for key in element.attributes if key in COMMON and key not in btcpp_vocabulary.IGNORED]
        return NodeDraft.around("Sequence", element.mark, child) if own else child

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
        return self._repeated(draft, element, trail)

    def _repeated(self, loop: NodeDraft, element: Element, trail: str) -> NodeDraft:
        child = self._child(element, trail)
        if child is not None:
            loop.put("do", alone(child.written()))
        return loop

    def _loop(self, element: Element, trail: str) -> NodeDraft:
        self._reader.only(element, ("queue", "if_empty", "value"), trail)
        draft = NodeDraft.of("ForEach", element.mark)
        self._reader.needed(element, "queue", trail)
        self._reader.needed(element, "value", trail)
        self._reader.port(draft, "in", LOOPS[element.identity], element, "queue", trail)
        self._reader.port(draft, "out", _ANY, element, "value", trail)
        return self._ended(element, self._repeated(draft, element, trail), trail)

    def _ended(self, element: Element, loop: NodeDraft, trail: str) -> NodeDraft:
        """Return the loop with the outcome of `if_empty`, which also applies behind the last element."""
        match element.get("if_empty", "SUCCESS"):
            case "SUCCESS":
                return loop
            case "FAILURE":
                outer = NodeDraft.of("ForceFailure", element.mark)
                outer.put("do", alone(loop.written()))
            case "SKIPPED":
                skipped = NodeDraft.of("AlwaysSuccess", element.mark)
                skipped.put("_skipIf", True)
                outer = NodeDraft.around("IfThenElse", element.mark, loop, skipped)
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
                message = f"the case {label!r} is given twice"
                self._reader.fault(element.place(case), trail, message, code="P911")
            table.put(label, self._reader.slot_value(child, label, trail), child.mark)
        draft.put("cases", table)
        self.switches[element.mark] = table
        for last in element.children[count : count + 1]:
            if btcpp_vocabulary.NO_CASE not in last.attributes:
                draft.put("default", self._reader.slot_value(last, "default", trail))
        return draft

    # Nodes of the export for inexpressible scripts.

    def _check(self, element: Element, trail: str) -> NodeDraft:
        draft = self._leaf("Condition", element, ("if",), trail)
        draft.put("if", self._reader.needed(element, "if", trail), element.place("if"))
        return draft

    def _guarded(self, element: Element, trail: str) -> NodeDraft:
        self._reader.only(element, tuple(btcpp_vocabulary.GUARDS.values()), trail)
        child = self._child(element, trail)
        if child is None:
            return NodeDraft.of("AlwaysSuccess", element.mark)
        conditions = {
            key: (element.get(port), element.place(port))
            for key, port in btcpp_vocabulary.GUARDS.items()
            if port in element.attributes
        }
        return self._apart(element, child.guarded(conditions))


def _script_of(element: Element, statements: Iterable[Statement]) -> NodeDraft:
    draft = NodeDraft.of("Script", element.mark)
    draft.put("code", "; ".join(statement.text() for statement in statements), element.place("code"))
    return draft


@dataclass(slots=True)
class ImportContext:
    """State of one import, for the reading of nodes."""

    source: XmlSource
    registry: NodeRegistry
    faults: ImportFaults
    flow: KeyFlow
    stubs: Mapping[str, StubNode]
    """Stubs by the ID in XML."""
    ports: Mapping[str, tuple[TreePort, ...]]
    aliases: Mapping[str, str]
    """IDs of nodes of plug-ins by the ID in XML."""
    enums: Mapping[str, int] = field(default_factory=dict[str, int])
    trails: dict[str, str] = field(default_factory=dict[str, str])
    """Path of the first use of each stub, by the ID in XML."""
    _classes: dict[str, type[Node]] = field(default_factory=dict[str, type[Node]])

    @property
    def ours(self) -> bool:
        """Whether picktree wrote the file."""
        return bool(self.source.said("picktree"))

    def stub_class(self, stub: StubNode) -> type[Node]:
        """Return the class of a stub, made once and known to the registry."""
        if stub.id not in self._classes:
            made = self._classes[stub.id] = stub_class(stub)
            self.registry.add([made], "stubs")
        return self._classes[stub.id]


class XmlNodeReader(ElementReader):
    """Reader of the elements of one import."""

    def __init__(self, context: ImportContext) -> None:
        super().__init__(context.faults)
        self._registry = context.registry
        self._trees = context.ports
        self._context = context
        self.enums = context.enums
        self._translations = Translations(self, context.enums)
        self.switches = self._translations.switches
        self._made = set[str]()
        """Keys that the import has created."""

    def literal_type(self, tree: str, key: str, declared: PortType) -> PortType:
        return declared if self._context.ours else literal_type(self._context.flow, tree, key, declared)

    def is_read(self, key: str) -> bool:
        return self._context.flow.group(self.tree, key).read is not None

    def is_created(self, key: str) -> bool:
        return self._context.ours or self._context.flow.group(self.tree, key).created

    def tree_root(self, name: str, element: Element) -> NodeDraft:
        self.tree = name
        return self.node(element.children[0], self._context.source.called(name))

    def node(self, element: Element, above: str) -> NodeDraft:
        identity = element.identity
        if not identity:
            message = f"<{element.name}> needs the attribute 'ID'"
            hint = 'as <ScriptCondition code="…"/>' if element.name == "Condition" else ""
            self.fault(element.mark, above, message, hint, code="P905")
            return NodeDraft.of("AlwaysSuccess", element.mark)
        trail = f"{above}/{element.get('name') or identity}"
        if element.text:
            message = f"the text {element.text[:30]!r} has no meaning here"
            self.faults.note(element.mark, trail, message, "write a comment as <!-- -->", code="P905")
        if element.name not in btcpp_vocabulary.ELEMENTS and "ID" in element.attributes:
            message = f"<{element.name}> has no attribute 'ID'"
            hint = "the ID is the element's name, or in <Action>, <Condition>, <Control>, <Decorator>"
            self.fault(element.place("ID"), trail, message, hint, code="P908")
        draft = self._draft(element, identity, trail)
        self.common(element, draft, trail)
        return draft

    def _draft(self, element: Element, identity: str, trail: str) -> NodeDraft:
        if element.name == "SubTree":
            return self._subtree(element, identity, trail)
        stub = self._context.stubs.get(identity)
        if stub is not None:
            return self._stubbed(element, stub, trail)
        node = self._registry.find(self._context.aliases.get(identity, identity))
        if identity == btcpp_vocabulary.REPEAT_WHILE:
            node = self._registry.find("Repeat")
        translation = self._translations.of(identity)
        # The ID is BehaviorTree.CPP's own: those names are refused for other nodes.
        foreign = identity == "ForEach" and "vector_in" in element.attributes
        if translation is not None and (node is None or foreign or identity in ("SetBlackboard", "Script")):
            return translation(element, trail)
        if node is not None:
            return self._declared(element, node.declaration, trail)
        self._unknown(element, identity, trail)
        for child in element.children:
            self.node(child, trail)
        return NodeDraft.of("AlwaysSuccess", element.mark)

    def _unknown(self, element: Element, identity: str, trail: str) -> None:
        mark = element.place("ID")
        if identity in btcpp_vocabulary.FOREIGN:
            message = f"{identity!r} has no counterpart"
            self.fault(mark, trail, message, btcpp_vocabulary.FOREIGN[identity], code="P907")
        elif identity in self._trees:
            hint = f'a sub-tree is called by <SubTree ID="{identity}"/>'
            self.fault(mark, trail, f"unknown node {identity!r}", hint, code="P906")

    def _stubbed(self, element: Element, stub: StubNode, trail: str) -> NodeDraft:
        """Read a node that picktree does not know; missing models are reported once for all of them."""
        self._context.trails.setdefault(stub.source, trail)
        declaration = self._context.stub_class(stub).declaration
        draft = NodeDraft.of(stub.id, element.mark, declaration.keys)
        for port in stub.ports:
            key = port.declared.key
            if port.name in element.attributes:
                text, mark = element.get(port.name), element.place(port.name)
                if port.declared.direction == "out" and not is_pointer(text):
                    if text.strip():
                        message = f"the output {port.name!r} needs a key in braces, not {text!r}"
                        self.faults.note(mark, trail, f"{message}; it is left out", code="P918")
                elif is_pointer(text):
                    bare = text.strip(" ")
                    draft.put(key, f"{{{port.name}}}" if bare == "{=}" else bare, mark)
                else:
                    draft.put(key, self.value(element, port.name, port.declared.type, trail), mark)
            elif port.remapped:
                draft.put(key, port.remapped, element.mark)
        names = {port.name for port in stub.ports}
        for key in element.attributes:
            if key not in names and key not in COMMON and key != "ID" and key.startswith("_"):
                self.no_port(element, key, stub.source, (), trail)
        if element.children and not declaration.slots:
            self.count(element, stub.source, 0, 0, trail)
        elif declaration.slots:
            self._children(draft, element, declaration, [], trail)
        return draft

    def _declared(self, element: Element, declaration: NodeDeclaration, trail: str) -> NodeDraft:
        draft = NodeDraft.of(declaration.id, element.mark, declaration.keys)
        slots = [slot for slot in declaration.slots if slot.key != "do"]
        for key in element.attributes:
            port = declaration.port(key) or declaration.port(identifier(key))
            if port is not None and port.takes == "key":
                draft.put(key, f"{{{element.get(key).strip('{} ')}}}", element.place(key))
            elif port is not None:
                self.port(draft, port.key, port.type, element, key, trail)
            elif key not in (*COMMON, "ID", *(slot.key for slot in slots)):
                known = (*(p.key for p in declaration.ports), *(slot.key for slot in slots), "name")
                self.no_port(element, key, declaration.id, known, trail)
        for port in self._context.source.node_models.get(element.identity, element).all("input_port"):
            key, default = port.get("name"), port.get("default")
            if is_pointer(default) and key not in element.attributes and declaration.port(key) is not None:
                draft.put(key, f"{{{key}}}" if default.strip() == "{=}" else default.strip(" "), element.mark)
        self._children(draft, element, declaration, slots, trail)
        return draft

    def _children(
        self,
        draft: NodeDraft,
        element: Element,
        declaration: NodeDeclaration,
        slots: list[SlotDeclaration],
        trail: str,
    ) -> None:
        main = declaration.slot("do")
        if main is None and not slots:
            self.count(element, declaration.id, 0, 0, trail)
            return
        children = list(element.children)
        rows = {slot.key: self._rows(element, slot, trail) for slot in slots}
        taken = [row.child for found in rows.values() for row in found]
        if slots and not self._fits(element, taken, len(children), trail):
            return
        free = [child for index, child in enumerate(children) if index not in taken]
        if main is not None and main.arity == "one":
            self.count(element, declaration.id, 1 if main.required else 0, 1, trail, len(free))
            if free:
                draft.put("do", alone(self.node(free[0], trail).written()))
        elif main is not None and free:
            items = [self.node(child, trail).written() for child in free]
            draft.put("do", MarkedValue(element.mark, items=items))
        elif free:
            message = "no slot is given for some of the children"
            self.fault(free[0].mark, trail, message, f"'{slots[0].key}' names them", code="P915")
        for slot in slots:
            if rows[slot.key]:
                self._slot(draft, slot, rows[slot.key], element, trail)

    def _rows(self, element: Element, slot: SlotDeclaration, trail: str) -> tuple[SlotRow, ...]:
        """Return the children in the slot, by label and index."""
        if slot.key not in element.attributes:
            return ()
        text = element.get(slot.key)
        try:
            if slot.arity == "table":
                return read_table(text)
            return tuple(SlotRow("", child) for child in read_indexes(text))
        except ValueError as error:
            hint = "as 'grasp.*=1; control.*=2'" if slot.arity == "table" else "children are counted from 0"
            self.fault(element.place(slot.key), trail, f"{slot.key!r}: {error}", hint, code="P915")
            return ()

    def _fits(self, element: Element, taken: list[int], children: int, trail: str) -> bool:
        wrong = [child for child in taken if child >= children or taken.count(child) > 1]
        if wrong:
            what = "is named twice" if wrong[0] < children else f"is not there; there are {children}"
            message = f"the child {wrong[0]} {what}"
            self.fault(element.mark, trail, message, "children are counted from 0", code="P915")
        return not wrong

    def _slot(
        self, draft: NodeDraft, slot: SlotDeclaration, rows: tuple[SlotRow, ...], element: Element, trail: str
    ) -> None:
        mark = element.place(slot.key)
        if slot.arity == "one":
            draft.put(slot.key, self.slot_value(element.children[rows[0].child], slot.key, trail), mark)
        elif slot.arity == "many":
            items = [self.node(element.children[row.child], trail).written() for row in rows]
            draft.put(slot.key, MarkedValue(mark, items=items), mark)
        else:
            table = MarkedValue.mapping(mark)
            for row in rows:
                if table.get(row.label) is not None:
                    self.fault(mark, trail, f"{slot.key!r} names {row.label!r} twice", code="P915")
                child = element.children[row.child]
                table.put(row.label, self.slot_value(child, row.label, trail), child.mark)
            draft.put(slot.key, table, mark)

    def _subtree(self, element: Element, identity: str, trail: str) -> NodeDraft:
        self.count(element, "SubTree", 0, 0, trail)
        if identity not in self._trees:
            hint = suggest_name(identity, self._trees) if self._trees else ""
            if not hint.startswith("did"):
                more = "give its file or folder, too, or take it for a node with --stubs"
                hint = "; ".join(filter(None, (hint, more)))
            self.fault(element.place("ID"), trail, f"there is no tree {identity!r}", hint, code="P913")
            return NodeDraft.of("AlwaysSuccess", element.mark)
        ports = {port.key: port for port in self._trees[identity]}
        left_out = element.get(btcpp_vocabulary.LEFT_OUT).split()
        draft = NodeDraft.of(self._context.source.called(identity), element.mark)
        begins: list[MarkedValue] = []
        remapping = self._autoremap(element, trail)
        for key, port in ports.items() if not self._context.ours else ():
            value = self._initial(element, identity, port, trail, shared=remapping)
            if value is not None:
                begins.append(self._begin(draft, identity, key, value))
        for key in element.attributes:
            if key in ports and draft.body.get(key) is not None:
                continue
            if key in ports and ports[key].direction == "out" and not is_pointer(element.get(key)):
                continue
            if key in ports and key not in left_out:
                kind = self.literal_type(identity, key, ports[key].kind)
                self.port(draft, key, kind, element, key, trail)
            elif key not in (*COMMON, *ports, "ID", AUTOREMAP, btcpp_vocabulary.LEFT_OUT) and (
                self._context.ours or self.faults.strict or key.startswith("_")
            ):
                self.no_port(element, key, f"the tree {identity!r}", (*ports, "name"), trail)
        if remapping:
            draft.put(AUTOREMAP, True, element.place(AUTOREMAP))
        for key, port in ports.items():
            if key not in element.attributes and port.remapped and not remapping:
                draft.put(key, port.remapped, element.mark)
        return _begun(draft, begins) if begins else draft

    def _initial(
        self, element: Element, tree: str, port: TreePort, trail: str, *, shared: bool
    ) -> MarkedValue | None:
        """Return the value with which a tree's own key begins: the literal at a port that the tree writes."""
        key = port.key
        if port.direction == "in" or is_pointer(element.get(key)):
            return None
        if key not in element.attributes:
            return None if shared else port.initial
        if key in self._context.flow.reads(tree):
            return self.value(element, key, self.literal_type(tree, key, port.kind), trail)
        message = f"the tree {tree!r} writes its port {key!r}, and does not read {element.get(key)[:30]!r}"
        self.faults.note(element.place(key), trail, f"{message}; it is left out", code="P918")
        return None

    def _begin(self, draft: NodeDraft, tree: str, key: str, value: MarkedValue) -> MarkedValue:
        """Wire a tree's port to a key of its own at this call; return the node that gives it its value."""
        flow = self._context.flow
        self._made.update(flow.reads(self.tree), flow.writes(self.tree))
        own = identifier(f"{tree}_{key}", self._made)
        self._made.add(own)
        draft.put(key, f"{{{own}}}", value.mark)
        setter = NodeDraft.of("SetBlackboard", value.mark)
        setter.put("value", value, value.mark)
        setter.put("output_key", f"{{{own}}}", value.mark)
        return setter.written()

    def _autoremap(self, element: Element, trail: str) -> bool:
        text = element.get(AUTOREMAP, "false")
        if text in TRUE_WORDS:
            return True
        if text not in FALSE_WORDS:
            message = f"{AUTOREMAP!r} is true or false, not {text!r}"
            self.fault(element.place(AUTOREMAP), trail, message, code="P911")
        return False


def _begun(call: NodeDraft, begins: list[MarkedValue]) -> NodeDraft:
    """Return a call whose own keys get their values before it runs for the first time, and only then.

    BehaviorTree.CPP sets them when it makes the tree.
    """
    once = NodeDraft.of("RunOnce", call.mark)
    once.put("then_skip", False)
    once.put("do", begins[0] if len(begins) == 1 else MarkedValue(call.mark, items=begins))
    return NodeDraft.around("IfThenElse", call.mark, once, call)
