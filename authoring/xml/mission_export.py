"""Export of a mission as BehaviorTree.CPP XML, with its comments."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from graphlib import CycleError
from typing import Final, cast

from picktree.files import Diagnostic, Expression, FileError, Mark
from picktree.trees import (
    AUTOREMAP,
    MAIN,
    POSTCONDITIONS,
    Mission,
    Node,
    NodeSpec,
    PortDeclaration,
    PortType,
    TreeSpec,
    data_flow,
    references,
)

from . import btcpp_vocabulary, tree_nodes_model
from .btcpp_vocabulary import SlotRow, indexes_text, table_text
from .element import Comments, Element, LooseComment, to_text, unfit
from .key_types import KeyTypes, fits
from .literal_text import is_pointer, value_text
from .scripts import NotExpressible, assignments_script, constant_script, expression_text, script


def with_loose_comments(
    trees: tuple[Element, ...], comments: Iterable[LooseComment]
) -> tuple[tuple[Element, ...], tuple[str, ...]]:
    """Return the trees with their comments, and the comments below all trees.

    A comment belongs to the innermost element before it that is indented less.
    """
    done, below = list(trees), list[str]()
    for comment in comments:
        before = [index for index, tree in enumerate(done) if 0 < tree.mark.line < comment.line]
        home = max(before, key=lambda index: done[index].mark.line, default=None)
        placed = _placed(done[home], comment) if home is not None and comment.indent else None
        if home is None or placed is None:
            below.append(comment.text)
        else:
            done[home] = placed
    return tuple(done), tuple(below)


def _placed(element: Element, comment: LooseComment) -> Element | None:
    """Return the element with the comment in it, or in one below it; None when it is outside of the
    element."""
    before = [index for index, child in enumerate(element.children) if 0 < child.mark.line < comment.line]
    if not before:
        return None
    last = before[-1]
    child = element.children[last]
    inner = _placed(child, comment)
    if inner is not None:
        return replace(element, children=(*element.children[:last], inner, *element.children[last + 1 :]))
    if comment.indent + 1 <= element.mark.column:
        return None
    if last + 1 < len(element.children):
        after = element.children[last + 1]
        after = replace(after, comments=(comment.text, *after.comments))
        return replace(
            element, children=(*element.children[: last + 1], after, *element.children[last + 2 :])
        )
    return replace(element, end_comments=(*element.end_comments, comment.text))


TRUTH_LABELS: Final = {"true": "1", "false": "0"}


class TruthSwitches:
    """Finder of the mission's Switches over truth values."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission

    def decides(self, spec: NodeSpec) -> bool | None:
        """Return whether the value of a Switch is a truth value; None when it may also have another type."""
        bound = spec.ports["variable"]
        if isinstance(bound, references.Constant):
            return isinstance(bound.value, bool)
        keys = self._keys.get(id(spec))
        if keys is None or not isinstance(bound, references.Reference):
            return False
        kinds = {source.type.kind for source in keys.reference(bound)}
        if kinds == {"bool"}:
            return True
        return None if "bool" in kinds else False

    @cached_property
    def _keys(self) -> dict[int, data_flow.TreeKeys]:
        """Return the keys of a node's tree, by `id` of the node's spec."""
        try:
            flow = data_flow.ValueFlow(self._mission.trees, data_flow.FACT_TYPES)
        except CycleError:
            return {}
        return {place: keys for keys in flow.keys.values() for place in keys.places}


_DELETE = "\x7f"


def mission_to_xml(mission: Mission) -> str:
    """Return the mission as XML text. Raises FileError with all parts that XML cannot express."""
    exporter = XmlExporter(mission)
    root = exporter.root()
    if exporter.faults:
        raise FileError(exporter.faults)
    return to_text(root)


class XmlExporter:
    """Converter of the trees of one mission to elements."""

    def __init__(self, mission: Mission) -> None:
        self.faults: list[Diagnostic] = []
        self._mission = mission
        self._comments = Comments(mission.text)
        self._models: dict[str, Element] = {}
        self._called: set[str] = set()
        """Names of the sub-tree instances of the present tree: each may be used once."""
        self._types = KeyTypes(mission)
        self._switches = TruthSwitches(mission)

    def root(self) -> Element:
        comments = self._comments.at_the_top()
        for key in ("kind", "name", "scene", "goal", "include", "plugins", "library", "trees"):
            if key in self._mission.document.data:
                comments += self._comments.above(self._mission.document.key_mark((key,)).line)
        trees = tuple(self.tree(tree) for tree in self._mission.trees.values())
        trees, below = with_loose_comments(trees, self._comments.rest())
        models = [*self._tree_models(), *(self._models[identity] for identity in sorted(self._models))]
        parts = (*trees, Element("TreeNodesModel", {}, tuple(models)))
        attributes = {"BTCPP_format": btcpp_vocabulary.XML_FORMAT}
        if MAIN in self._mission.trees:
            attributes["main_tree_to_execute"] = MAIN
        root = Element("root", attributes, parts, comments=comments, comments_below=below)
        self.faults += self._types.faults
        self._check_characters(root)
        return root

    def tree(self, tree: TreeSpec) -> Element:
        if btcpp_vocabulary.taken(tree.name):
            self._fault(tree.mark, f"trees.{tree.name}", f"{tree.name!r} is a name of BehaviorTree.CPP's own",
                        "give the tree another name", code="P920")  # fmt: skip
        for port in tree.ports:
            self._check_port(port, tree.mark, f"trees.{tree.name}")
        self._called = set()
        comments = self._above(tree.mark)
        root = self.node(tree.root, tree.name)
        attributes = {btcpp_vocabulary.DESCRIPTION: tree.doc} if tree.doc else {}
        return Element(
            "BehaviorTree", {"ID": tree.name, **attributes}, (root,), comments=comments, mark=tree.mark
        )

    # Models.

    def _tree_models(self) -> Iterable[Element]:
        for index, tree in enumerate(self._mission.trees.values()):
            fields = tree_nodes_model.head(self._mission) if index == 0 else []
            if not self._is_own(tree.mark):
                fields.append({tree_nodes_model.INCLUDED: "true"})
            yield tree_nodes_model.tree_model(tree, fields, self._default)

    def _use(self, identity: str, model: Callable[[], Element]) -> None:
        if identity not in self._models:
            self._models[identity] = model()

    # Nodes.

    def node(self, spec: NodeSpec, above: str) -> Element:
        trail = f"{above}/{spec.name}"
        comments = self._above(spec.mark)
        element = self._of_class(spec, spec.node, trail) if spec.node else self._call(spec, trail)
        if spec.breakpoint is not None:
            element = _with(element, {btcpp_vocabulary.BREAKPOINT: spec.breakpoint})
        return replace(self._conditioned(spec, element), comments=comments, mark=spec.mark)

    def _of_class(self, spec: NodeSpec, node: type[Node], trail: str) -> Element:
        match spec.id:
            case "Condition":
                return self._condition(spec)
            case "SetBlackboard":
                return self._set_blackboard(spec, trail)
            case "Script":
                return self._script(spec)
            case "Switch":
                return self._switch(spec, trail)
            case "Repeat" if "while" in spec.ports:
                identity = btcpp_vocabulary.REPEAT_WHILE
                loose = self._types.loose(identity)
                self._use(identity, lambda: tree_nodes_model.repeat_while_model(node.declaration, loose))
                return self._plain(spec, node, identity, trail)
            case identity if identity in btcpp_vocabulary.SHARED_NODES:
                return self._plain(spec, node, identity, trail)
            case identity:
                if btcpp_vocabulary.taken(identity):
                    message = f"{identity!r} is a name of BehaviorTree.CPP's own"
                    self._fault(spec.mark, trail, message, "give the node another ID", code="P920")
                for port in node.declaration.ports:
                    self._check_port(port, spec.mark, trail)
                loose = self._types.loose(identity)
                self._use(identity, lambda: tree_nodes_model.node_model(node.declaration, loose))
                return self._plain(spec, node, identity, trail)

    def _plain(self, spec: NodeSpec, node: type[Node], identity: str, trail: str) -> Element:
        """Return a node with its ports as attributes, and its children as elements."""
        attributes = self._named(spec, identity)
        for key, bound in spec.ports.items():
            port = node.declaration.port(key)
            if port is not None:
                attributes[key] = self._bound(bound, port, spec, trail)
        children: list[Element] = []
        for key, filled in spec.slots.items():
            slot = node.declaration.slot(key)
            rows = [SlotRow(label, len(children) + index) for index, (label, _) in enumerate(filled)]
            if slot is not None and key != "do":
                table = slot.arity == "table"
                attributes[key] = table_text(rows) if table else indexes_text(row.child for row in rows)
            children += (self.node(child, trail) for _, child in filled)
        return Element(identity, attributes, tuple(children))

    def _bound(self, bound: references.Binding, port: PortDeclaration, spec: NodeSpec, trail: str) -> str:
        if isinstance(bound, references.Reference):
            return str(bound)
        mark = spec.places.get(port.key, spec.mark)
        if isinstance(bound, references.PortExpression):
            message = f"port {port.key!r}: BehaviorTree.CPP has no expressions as values of ports"
            hint = f'set a key with SetBlackboard before this node, and give "{{{port.key}}}" here'
            self._fault(mark, trail, message, hint, code="P929")
            return ""
        text = value_text(bound.value, port.type)
        if spec.node is None:
            text = self._literal(spec.id, port, bound.value, spec.mark_at(port.key), trail)
        self._check_text(text, f"port {port.key!r}", mark, trail)
        kind = btcpp_vocabulary.PORT_TYPES.get(port.key, "")
        if spec.id in btcpp_vocabulary.SHARED_NODES and not fits(kind, bound.value):
            message = f"port {port.key!r}: BehaviorTree.CPP counts with 32 bits; {text} is too large"
            self._fault(mark, trail, message, code="P923")
        elif spec.id in btcpp_vocabulary.SHARED_NODES and kind == "unsigned" and not _whole(bound.value):
            message = f"port {port.key!r}: BehaviorTree.CPP counts whole milliseconds, not {text}"
            self._fault(mark, trail, message, code="P923")
        return text

    def _literal(self, tree: str, port: PortDeclaration, value: object, mark: Mark, trail: str) -> str:
        """Return a literal or default of a sub-tree's port. BehaviorTree.CPP stores some texts as numbers."""
        text = self._types.literal(tree, port, value)
        if text is None:
            message = (
                f"port {port.key!r}: BehaviorTree.CPP takes {value!r} for a number, "
                "and a node reads a text from it"
            )
            hint = "write a text that is no number, or set a key with SetBlackboard and give that"
            self._fault(mark, trail, message, hint, code="P926")
        return text or ""

    def _default(self, tree: TreeSpec, port: PortDeclaration) -> str:
        mark = tree.places.get(port.key, tree.mark)
        return self._literal(tree.name, port, port.default, mark, f"trees.{tree.name}")

    def _named(self, spec: NodeSpec, identity: str) -> dict[str, str]:
        """Return the attribute `name` if the node's name differs from its ID, else nothing."""
        name = spec.name.partition("#")[0]
        if name == spec.id:
            return {}
        if _DELETE in name:  # which BehaviorTree.CPP refuses in a name
            return {"name": name.replace(_DELETE, ""), btcpp_vocabulary.OWN_NAME: name}
        return {btcpp_vocabulary.OWN_NAME: name} if name == identity else {"name": name}

    def _condition(self, spec: NodeSpec) -> Element:
        bound = cast("references.Constant", spec.ports["if"])
        expression = cast("Expression", bound.value)
        try:
            identity, attributes = "ScriptCondition", {"code": script(expression)}
        except NotExpressible:
            identity, attributes = btcpp_vocabulary.CHECK, {"if": expression.text}
            self._use(identity, tree_nodes_model.check_model)
        return Element(identity, self._named(spec, identity) | attributes)

    def _set_blackboard(self, spec: NodeSpec, trail: str) -> Element:
        """Export a SetBlackboard. Numbers and truth values keep their type in a Script only."""
        bound, key = spec.ports["value"], cast("references.Reference", spec.ports["output_key"]).key
        named = self._named(spec, "SetBlackboard")
        if isinstance(bound, references.PortExpression):
            with suppress(NotExpressible):
                code = assignments_script([references.Assignment(key, bound.value)])
                return Element("Script", {**named, "code": code})
            port = cast("type[Node]", spec.node).declaration.port("value")
            assert port is not None
            text = self._bound(bound, port, spec, trail)
        elif isinstance(bound, references.Constant):
            value = bound.value
            text = value_text(value, PortType("any"))
            if text != value:
                with suppress(NotExpressible):
                    attributes = {"code": constant_script(key, value), btcpp_vocabulary.SETS: "true"}
                    return Element("Script", {**named, **attributes})
            self._check_text(text, "port 'value'", spec.places.get("value", spec.mark), trail)
        else:
            text = str(bound)
        return Element("SetBlackboard", {**named, "value": text, "output_key": key})

    def _script(self, spec: NodeSpec) -> Element:
        assignments = spec.postconditions["code"]
        try:
            identity, code = "Script", assignments_script(assignments)
        except NotExpressible:
            identity, code = btcpp_vocabulary.ASSIGN, _assignments(assignments)
            self._use(identity, tree_nodes_model.assign_model)
        return Element(identity, self._named(spec, identity) | {"code": code})

    def _switch(self, spec: NodeSpec, trail: str) -> Element:
        cases = spec.slots["cases"]
        identity = f"Switch{len(cases)}"
        if identity not in btcpp_vocabulary.BUILT_IN:
            self._use(identity, lambda: tree_nodes_model.switch_model(len(cases)))
        attributes = self._named(spec, identity)
        port = cast("type[Node]", spec.node).declaration.port("variable")
        assert port is not None
        attributes["variable"] = self._bound(spec.ports["variable"], port, spec, trail)
        truth = self._switches.decides(spec)
        for index, (label, _) in enumerate(cases, 1):
            self._check_text(label, f"the case {label!r}", spec.mark, trail)
            if truth is None and label in TRUTH_LABELS:
                message = (
                    f"{spec.ports['variable']} may be a truth value, which BehaviorTree.CPP "
                    f"compares as a number, not as {label!r}"
                )
                hint = "compare it in Conditions, or switch over a text"
                self._fault(spec.mark_at(f"cases/{label}"), trail, message, hint, code="P927")
            attributes[f"case_{index}"] = TRUTH_LABELS.get(label, label) if truth else label
        default = spec.slots.get("default")
        if default:
            last = self.node(default[0][1], trail)
        else:
            last = Element("AlwaysFailure", {btcpp_vocabulary.NO_CASE: "true"})
        return Element(identity, attributes, (*(self.node(child, trail) for _, child in cases), last))

    def _above(self, mark: Mark) -> tuple[str, ...]:
        """Return the comments above a line of the mission's own file."""
        return self._comments.above(mark.line) if self._is_own(mark) else ()

    def _is_own(self, mark: Mark) -> bool:
        return mark.file == str(self._mission.document.path)

    # Sub-trees.

    def _call(self, spec: NodeSpec, trail: str) -> Element:
        attributes = {"ID": spec.id} | self._instance(spec)
        left_out: list[str] = []
        if spec.autoremap is not None:
            attributes[AUTOREMAP] = "true"
        for port in self._mission.trees[spec.id].ports:
            bound = spec.ports.get(port.key)
            if port.key in (spec.autoremap or ()) or (port.remapped and bound is None):
                continue
            if bound is not None:
                attributes[port.key] = self._bound(bound, port, spec, trail)
            elif port.direction == "out":
                # Without a key to write to, BehaviorTree.CPP refuses the whole file.
                attributes[port.key] = f"{{_unused_{spec.id}_{port.key}}}"
                left_out.append(port.key)
            elif value_text(port.default, port.type) == "":
                # BehaviorTree.CPP ignores an empty default.
                attributes[port.key] = ""
                left_out.append(port.key)
        if left_out:
            attributes[btcpp_vocabulary.LEFT_OUT] = " ".join(left_out)
        return Element("SubTree", attributes)

    def _instance(self, spec: NodeSpec) -> dict[str, str]:
        """Return the name of a sub-tree instance; BehaviorTree.CPP refuses equal names in one tree."""
        named = self._named(spec, spec.id)
        name = named.get("name")
        if name is None:
            return {}
        instance, number = name, 1
        while instance in self._called:
            number += 1
            instance = f"{name} ({number})"
        self._called.add(instance)
        own = {btcpp_vocabulary.OWN_NAME: name} if instance != name else {}
        return {"name": instance} | own | {key: value for key, value in named.items() if key != "name"}

    # Conditions.

    def _conditioned(self, spec: NodeSpec, element: Element) -> Element:
        """Return the element with conditions as attributes, or in a Guarded where scripts cannot express
        them."""
        after = {key: spec.postconditions[key] for key in POSTCONDITIONS if key in spec.postconditions}
        if not spec.preconditions and not after:
            return element
        try:
            attributes = {key: script(expression) for key, expression in spec.preconditions.items()}
            attributes |= {key: assignments_script(assignments) for key, assignments in after.items()}
            return _with(element, attributes)
        except NotExpressible:
            self._use(btcpp_vocabulary.GUARDED, tree_nodes_model.guarded_model)
            ours = {
                btcpp_vocabulary.GUARDS[key]: expression.text
                for key, expression in spec.preconditions.items()
            }
            ours |= {
                btcpp_vocabulary.GUARDS[key]: _assignments(assignments) for key, assignments in after.items()
            }
            return Element(btcpp_vocabulary.GUARDED, ours, (element,))

    # Faults.

    def _check_port(self, port: PortDeclaration, mark: Mark, trail: str) -> None:
        if port.key == "ID":
            message = "BehaviorTree.CPP keeps the attribute 'ID' for itself"
            self._fault(mark, trail, message, "give the port another name", code="P921")

    def _check_text(self, text: str, what: str, mark: Mark, trail: str) -> None:
        if is_pointer(text):
            message = f"{what}: BehaviorTree.CPP reads {text!r} as a key of the blackboard"
            self._fault(mark, trail, message, "leave out the braces", code="P922")

    def _check_characters(self, root: Element) -> None:
        for element in root.iterate():
            for text in (*element.attributes.values(), element.text):
                if character := unfit(text):
                    shown = f"U+{ord(character):04X}"
                    mark = Mark(str(self._mission.document.path), 1, 1)
                    message = f"<{element.name}>: no XML file can hold the character {shown}"
                    self._fault(mark, "", message, "leave it out", code="P924")

    def _fault(self, mark: Mark, trail: str, message: str, hint: str = "", *, code: str) -> None:
        self.faults.append(Diagnostic(mark, trail, message, hint, code))


def _with(element: Element, attributes: Mapping[str, str]) -> Element:
    return Element(element.name, {**element.attributes, **attributes}, element.children, element.text)


def _assignments(assignments: Iterable[references.Assignment]) -> str:
    return "; ".join(f"{a.key} {':=' if a.new else '='} {expression_text(a.value.root)}" for a in assignments)


def _whole(value: object) -> bool:
    return not isinstance(value, float) or (value.is_integer() and value >= 0)
