"""Grammar of nodes: converts the values under `trees:` to NodeSpecs, with their children, and reports
all errors with their places. A name of another library's node gets a suggestion.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, TypeAlias

from picktree.files import Location, Mark
from picktree.files.yaml import Document, Value, syntax_faults
from picktree.trees import (
    AUTOREMAP,
    COMMON_KEYS,
    IDENTIFIER,
    MissionDiagnostics,
    Node,
    NodeDeclaration,
    NodeSpec,
    PortDeclaration,
    PortValues,
    Sequence,
    SlotDeclaration,
    library_trees,
    references,
    show,
)
from picktree.world import OUR_PREFIXES

from .port_reader import PortReader
from .registry import NodeRegistry

FOREIGN_WORDS: Final[Mapping[str, str]] = {
    # BehaviorTree.CPP
    "LoopBool": "a loop over a list is 'ForEach: {in: …, out: \"{key}\", do: …}'",
    "LoopDouble": "a loop over a list is 'ForEach: {in: …, out: \"{key}\", do: …}'",
    "LoopInt": "a loop over a list is 'ForEach: {in: …, out: \"{key}\", do: …}'",
    "LoopString": "a loop over a list is 'ForEach: {in: …, out: \"{key}\", do: …}'",
    "ManualSelector": "there is no choosing by hand",
    "Precondition": "write the condition at the node itself, as '_skipIf: …' or '_failureIf: …'",
    "ScriptCondition": "an expression is asked by 'Condition: {if: …}'",
    "SequenceStar": "this is of format 3; in format 4 it is <SequenceWithMemory>",
    "SubTree": "a tree is used by its name, as 'PutDown: {object: \"{item}\"}'",
    "SubTreePlus": "this is of format 3; in format 4 it is <SubTree>",
    "Switch2": "Switch, with any number of cases",
    "Switch3": "Switch, with any number of cases",
    "Switch4": "Switch, with any number of cases",
    "Switch5": "Switch, with any number of cases",
    "Switch6": "Switch, with any number of cases",
    "UnsetBlackboard": "a key cannot be taken away; write null with SetBlackboard",
    # Nav2
    "BackUp": "Jog moves the tool, SafeRetreat gets the arm clear",
    "DistanceController": "RateController bounds how often a child begins",
    "DriveOnHeading": "Jog moves the tool, GoTo the arm",
    "GoalUpdated": "WasEntryUpdated",
    "SingleTrigger": "RunOnce, with 'then_skip: false'",
    "SpeedController": "RateController bounds how often a child begins",
    "Wait": "Sleep",
    "GoalUpdatedController": "SkipUnlessUpdated",
    "IsGoalUpdated": "WasEntryUpdated",
    "NonblockingSequence": "PipelineSequence is similar; it continues past a child that runs again",
    "PersistentSequence": "SequenceWithMemory",
    # py_trees
    "CheckBlackboardVariableExists": "ask for the key in a Condition, as 'Condition: {if: key != null}'",
    "CheckBlackboardVariableValue": "ask for the value in a Condition, as 'Condition: {if: key == 3}'",
    "EternalGuard": "write the condition at the node itself, as '_while: …'",
    "Failure": "AlwaysFailure",
    "FailureIsRunning": "RetryUntilSuccessful, with 'num_attempts: -1'",
    "FailureIsSuccess": "ForceSuccess",
    "OneShot": "RunOnce",
    "Retry": "RetryUntilSuccessful, or a Recover where the cause decides",
    "RunningIsFailure": "a Timeout bounds how long a child may be RUNNING",
    "RunningIsSuccess": "a Timeout bounds how long a child may be RUNNING",
    "SetBlackboardVariable": "SetBlackboard",
    "Assign": "Script",
    "StatusToBlackboard": "write the assignment at the node itself, as '_onSuccess: …' and '_onFailure: …'",
    "Success": "AlwaysSuccess",
    "SuccessIsFailure": "ForceFailure",
    "SuccessIsRunning": "KeepRunningUntilFailure",
    "TickCounter": "Sleep",
    "UnsetBlackboardVariable": "a key cannot be taken away; write null with SetBlackboard",
    "WaitForBlackboardVariable": "wait by 'RetryUntilSuccessful: {num_attempts: -1, do: {Condition: …}}'",
    # Words of every day, and of game engines
    "Catch": "Recover",
    "Cooldown": "a Delay in it waits; RateController bounds how often a child begins",
    "Drop": "Place puts down, OpenGripper lets go",
    "Failer": "AlwaysFailure, or ForceFailure around a child",
    "For": "ForEach over a list, Repeat for a number of times",
    "If": "IfThenElse, or '_skipIf: …' at the node itself",
    "Limiter": "Repeat and RetryUntilSuccessful count; Budget bounds recovery",
    "Look": "Observe",
    "Loop": "Repeat for a number of times, ForEach over a list",
    "Move": "GoTo for a named pose, Jog for a distance",
    "MoveTo": "GoTo for a named pose, Jog for a distance",
    "Negate": "Inverter",
    "Not": "Inverter",
    "Pick": "Grasp",
    "PickUp": "Grasp",
    "Priority": "Fallback",
    "PrioritySelector": "Fallback",
    "Release": "OpenGripper lets go, Place puts down",
    "Repeater": "Repeat",
    "Selector": "Fallback",
    "SelectorWithMemory": "Fallback",
    "Succeeder": "AlwaysSuccess, or ForceSuccess around a child",
    "Try": "Fallback tries one after the other, Recover handles causes",
    "UntilFail": "KeepRunningUntilFailure",
    "UntilFailure": "KeepRunningUntilFailure",
    "UntilSuccess": "RetryUntilSuccessful",
    "While": "'Repeat: {while: …, do: …}' for a loop, WhileDoElse for a choice at each tick",
}
"""Hint for each name that is no node here; a single word is the node that is meant."""
_FOLDED: Final = {word.casefold(): hint for word, hint in FOREIGN_WORDS.items()}


def foreign_word(name: str) -> str:
    """Return what to write for a node of another library or engine; "" for an unknown word.

    >>> foreign_word("selector"), foreign_word("Graps")
    ("did you mean 'Fallback'?", '')
    """
    hint = _FOLDED.get(name.replace("_", "").casefold(), "")
    return f"did you mean {hint!r}?" if hint.isidentifier() else hint


NAME_PATTERN = re.compile(r"[^/#\x00-\x1f]{1,60}")
"""Valid name of a node, or of a case."""
Filled: TypeAlias = tuple[tuple[str, NodeSpec], ...]
"""Children of a slot as (label, node); the label is the name in a table, else empty."""


@dataclass(slots=True)
class ChildNames:
    """Allocator of unique names among siblings: the second `Observe` is `Observe#2`."""

    _counts: dict[str, int] = field(default_factory=dict[str, int])

    def take(self, name: str) -> str:
        count = self._counts[name] = self._counts.get(name, 0) + 1
        return name if count == 1 else f"{name}#{count}"


class ChildReader:
    """Reader of the slots of nodes. `node` reads a single node."""

    def __init__(
        self,
        document: Document,
        registry: NodeRegistry,
        faults: MissionDiagnostics,
        node: Callable[[Value, Location, str, ChildNames], NodeSpec | None],
    ) -> None:
        self._document = document
        self._registry = registry
        self._faults = faults
        self._fault = partial(faults.at, document)
        self._node = node

    def read(
        self,
        declaration: NodeDeclaration,
        slot: SlotDeclaration,
        value: Value,
        loc: Location,
        trail: str,
        names: ChildNames,
    ) -> Filled:
        match slot.arity:
            case "one":
                label = "" if slot.key == "do" else slot.key
                found = self._node_or_sequence(value, loc, trail, names, label)
                return (("", found),) if found else ()
            case "many":
                return self._many(declaration, slot, value, loc, trail, names)
            case "table":
                return self._table(slot, value, loc, trail, names)

    def _node_or_sequence(
        self, value: Value, loc: Location, trail: str, names: ChildNames, label: str
    ) -> NodeSpec | None:
        """Read one node. A list is a Sequence, named so under `do` and after its slot elsewhere."""
        if not isinstance(value, list):
            return self._node(value, loc, trail, names)
        if not value:
            message = "the list is empty; at least one node is needed here"
            self._fault(loc, trail, message, code="P231")
            return None
        name = names.take(label or Sequence.declaration.id)
        parts = self.listed(value, loc, f"{trail}/{name}", ChildNames())
        mark = self._document.mark(loc)
        slots = {"do": parts}
        return NodeSpec(Sequence.declaration.id, name, mark, Sequence, slots=slots, places={"do": mark})

    def _many(
        self,
        declaration: NodeDeclaration,
        slot: SlotDeclaration,
        value: Value,
        loc: Location,
        trail: str,
        names: ChildNames,
    ) -> Filled:
        if not isinstance(value, list):
            found = self._node(value, loc, trail, names)
            count, parts = 1, (("", found),) if found else ()
        else:
            count, parts = len(value), self.listed(value, loc, trail, names)
        if count < slot.least or (slot.most is not None and count > slot.most):
            limit = f"at least {slot.least}" if slot.most is None else f"{slot.least} to {slot.most}"
            limit = f"{slot.least}" if slot.least == slot.most else limit
            message = (
                f"{declaration.id} has {count} {'child' if count == 1 else 'children'}; it takes {limit}"
            )
            self._fault(loc, trail, message, code="P229")
        return parts

    def listed(self, value: list[Value], loc: Location, trail: str, names: ChildNames) -> Filled:
        found = (self._node(item, (*loc, index), trail, names) for index, item in enumerate(value))
        return tuple(("", node) for node in found if node is not None)

    def _table(
        self, slot: SlotDeclaration, value: Value, loc: Location, trail: str, names: ChildNames
    ) -> Filled:
        if not isinstance(value, dict) or not value:
            self._fault(loc, trail, f"{slot.key!r} is a mapping: {slot.doc}", code="P232")
            return ()
        found: list[tuple[str, NodeSpec]] = []
        for key, body in value.items():
            if slot.of == "cause":
                self._check_pattern(key, (*loc, key), trail)
            elif not NAME_PATTERN.fullmatch(key):
                self._fault((*loc, key), trail, f"{show(key)} cannot name a case", code="P232", key=True)
            node = self._node_or_sequence(body, (*loc, key), trail, names, key)
            if node is not None:
                found.append((key, node))
        return tuple(found)

    def _check_pattern(self, pattern: str, loc: Location, trail: str) -> None:
        patterns = self._registry.patterns
        ours = pattern.partition(".")[0] in OUR_PREFIXES
        if pattern not in patterns and not self._registry.is_lost(pattern, near=ours):
            plugin = self._registry.registers(pattern)
            if plugin:
                message = f"{show(pattern)} is registered by {plugin}, but no node declares it"
                hint = f"add it to the 'causes' of the skill in {plugin} that fails with it"
            else:
                message = f"no cause is called {show(pattern)}"
                hint = self._faults.nearest(pattern, patterns)
            self._fault(loc, trail, message, hint, code="P233", key=True)


def labels_of(slot: SlotDeclaration, value: Value) -> tuple[str, ...]:
    """Return one label for each child under a slot: its name in a table, else empty."""
    if slot.arity == "table":
        return tuple(value) if isinstance(value, dict) else ()
    return ("",) * len(value) if isinstance(value, list) else ("",)


@dataclass(frozen=True, slots=True)
class _Site:
    """Place of a node: `loc` of the body under its ID, `start` of the whole node, and its path in the
    tree."""

    loc: Location
    start: Location
    trail: str

    @property
    def keyed(self) -> bool:
        """Whether the ID is the key of a mapping, not a bare text."""
        return self.loc != self.start


def _brief(value: Value) -> str:
    """Return a node of a list in a word."""
    name = next(iter(value), "") if isinstance(value, dict) else value
    return name[:30] if isinstance(name, str) else "…"


class NodeSpecReader:
    """Reader of the nodes of one document."""

    def __init__(
        self,
        document: Document,
        registry: NodeRegistry,
        trees: Mapping[str, tuple[PortDeclaration, ...]],
        faults: MissionDiagnostics,
        pointer: references.ExpressionLocator,
        *,
        lacking: bool = False,
        ambiguous: frozenset[str] = frozenset(),
    ) -> None:
        """`lacking`: a file with more trees could not be read, so unknown names are not reported.
        `ambiguous`: names of trees that are names of nodes, too, which is a fault already."""
        self._ambiguous = ambiguous
        self._lacking = lacking
        self._document = document
        self._registry = registry
        self._trees = trees
        self._faults = faults
        self._fault = partial(faults.at, document)
        self._wires = PortReader(document, faults, pointer)
        self._children = ChildReader(document, registry, faults, self.node)

    def node(self, value: Value, loc: Location, above: str, names: ChildNames) -> NodeSpec | None:
        """Read a node with all its descendants; None when it cannot be read at all."""
        if not self._faults.has_room(self._document, loc):
            return None
        match value:
            case str():
                return self._known(value, None, loc, loc, above, names)
            case dict() if len(value) == 1:
                ((identity, body),) = value.items()
                return self._known(identity, body, (*loc, identity), loc, above, names)
            case dict() if value:
                self._several(value, loc, above, names)
            case list() if value:
                shown = ", ".join([*map(_brief, value[:3]), *(["…"] if len(value) > 3 else [])])
                hint = f"write 'Sequence: [{shown}]'"
                self._fault(loc, above, "a node is needed here, not a list", hint, code="P216")
            case _:
                hint = "as 'Grasp: {object: \"{item}\"}' or a bare ID"
                self._fault(loc, above, "a node is needed here", hint, code="P216")
        return None

    def _several(self, value: dict[str, Value], loc: Location, above: str, names: ChildNames) -> None:
        """Report a mapping of several keys: nodes without dashes, or ports that are not indented."""
        keys = list(value)
        shown = ", ".join(map(show, keys[:4])) + (", …" if len(keys) > 4 else "")
        if not all(map(self._is_node, keys)):
            message = f"a node is a mapping with one key, its ID; here are {len(keys)}: {shown}"
            hint = f"what belongs to {show(keys[0])} is indented under it"
            self._fault(loc, above, message, hint, code="P215")
            return
        if not any(key.startswith("-") for key in keys):  # else each of them is no ID
            message = f"there are {len(keys)} nodes here, and only one is possible: {shown}"
            hint = f"in a list each node begins with a '-': write '- {keys[0][:30]}', then '- {keys[1][:30]}'"
            self._fault((*loc, keys[0]), above, message, hint, code="P215", key=True)
        for key in keys:
            self.node({key: value[key]}, loc, above, names)

    def _known(
        self, identity: str, body: Value, loc: Location, start: Location, above: str, names: ChildNames
    ) -> NodeSpec | None:
        given = body.get("name") if isinstance(body, dict) else None
        named = isinstance(given, str) and NAME_PATTERN.fullmatch(given) is not None
        name = names.take(given if named and isinstance(given, str) else identity[:60])
        site = _Site(loc, start, f"{above}/{name}")
        if given is not None and not named:
            message = "a name is a text without '/' and '#', 60 characters at most"
            self._fault((*loc, "name"), site.trail, message, code="P217")
        if identity in self._trees:
            return self._subtree(identity, name, body, site)
        if identity in self._ambiguous:
            return None  # the tree of that name is a fault already
        node = self._registry.find(identity)
        if node is None:
            self._unknown(identity, body, above, site)
            return None
        return self._node(node, name, body, site)

    def _unknown(self, identity: str, body: Value, above: str, site: _Site) -> None:
        loc = site.loc
        key = bool(loc) and loc[-1] == identity
        if IDENTIFIER.fullmatch(identity):
            library = dict(library_trees()).get(identity)
            taken = f"take it from the library: include: [{library}]" if library else ""
            foreign = self._called_tree(identity, body) or foreign_word(identity) or taken
            hint = foreign or self._faults.nearest(identity, (*self._trees, *self._registry.ids()))
            detail, near = "", bool(foreign) or hint.startswith("did you mean")
            if not near:
                hint = "`picktree nodes` lists all nodes"
            if not near and self._registry.problems:
                # The name may be right, and its plug-in installed but broken.
                hint = "; ".join(problem.message for problem in self._registry.problems)
                detail = "\n".join(filter(None, (problem.traceback for problem in self._registry.problems)))
            if self._registry.is_lost(identity, near=near):
                self._faults.leave_out(site.trail)  # the plug-in is a fault already
            elif near or not self._lacking:
                message = f"unknown node {show(identity)}"
                self._fault(loc, above, message, hint, code="P207", key=key, detail=detail)
        else:
            words = identity.split()
            hint = syntax_faults.structure_hint(identity)
            if not hint and len(words) > 1 and all(map(self._is_node, words)):
                hint = f"each node of a list begins with a '-': write '- {words[0]}'"
            hint = hint or "an ID is a letter or '_', then letters, digits and '_'"
            self._fault(loc, above, f"{show(identity)} is not an ID", hint, code="P208", key=key)
        # Descendants are checked too, so that all errors are reported at once.
        inner, at = (body.get("do"), (*loc, "do")) if isinstance(body, dict) else (body, loc)
        if isinstance(inner, list):
            self._children.listed(inner, at, site.trail, ChildNames())
        elif inner is not None and at != loc:
            self.node(inner, at, site.trail, ChildNames())

    def _called_tree(self, identity: str, body: Value) -> str:
        """Return what to write for BehaviorTree.CPP's call of a tree of this mission; "" for another node."""
        if identity not in ("SubTree", "SubTreePlus") or not isinstance(body, dict):
            return ""
        name = body.get("ID")
        if not isinstance(name, str) or name not in self._trees:
            return ""
        ports = ", ".join(f"{key}: …" for key in body if key != "ID")
        return f"a tree is used by its name: write '{name}{f': {{{ports}}}' if ports else ''}'"

    # A sub-tree.

    def _subtree(self, identity: str, name: str, body: Value, site: _Site) -> NodeSpec | None:
        ports = {port.key: port for port in self._trees[identity]}
        given = self._mapping(identity, body, site)
        bindings: dict[str, references.Binding] = {}
        for key, value in given.items():
            port, loc = ports.get(key), (*site.loc, key)
            if port is not None:
                bound = self._wires.binding(port, value, loc, site.trail)
                if bound is not None:
                    bindings[key] = bound
            elif key == AUTOREMAP and not isinstance(value, bool):
                message = f"{AUTOREMAP!r} is true or false, not {show(value)}"
                self._fault(loc, site.trail, message, code="P220")
            elif key not in (*COMMON_KEYS, AUTOREMAP):
                self._unknown_key(identity, key, (*ports, *COMMON_KEYS, AUTOREMAP), loc, site.trail)
        remaps = given.get(AUTOREMAP) is True
        if not remaps:
            self._wires.missing(ports.values(), given, site.loc, site.trail, key=site.keyed)
        places = {key: self._document.mark((*site.loc, key)) for key in given}
        spec = self._spec(identity, name, None, site, given, bindings, {}, places)
        return replace(spec, autoremap=frozenset[str]()) if remaps else spec

    # A node of a class.

    def _node(self, node: type[Node], name: str, body: Value, site: _Site) -> NodeSpec:
        declaration = node.declaration
        given, locations = self._body(declaration, body, site)
        bindings: dict[str, references.Binding] = {}
        slots: dict[str, Filled] = {}
        places: dict[str, Mark] = {}
        names = ChildNames()
        for key, value in given.items():
            port, slot, at = declaration.port(key), declaration.slot(key), locations[key]
            places[key] = self._document.mark(at)
            if port is not None:
                bound = self._wires.binding(port, value, at, site.trail)
                if bound is not None:
                    bindings[key] = bound
            elif slot is not None:
                slots[key] = self._children.read(declaration, slot, value, at, site.trail, names)
                for label, _ in slots[key]:
                    if label:
                        places[f"{key}/{label}"] = self._document.key_mark((*at, label))
            elif key not in COMMON_KEYS:
                self._unknown_key(declaration.id, key, declaration.keys, at, site.trail)
        self._wires.missing(declaration.ports, given, site.loc, site.trail, key=site.keyed)
        for slot in declaration.slots:
            if slot.required and slot.key not in given:
                what = "its children are" if slot.arity == "many" else "its child is"
                what = what if slot.key == "do" else f"{slot.key!r} is"
                message = f"{what} missing: {slot.doc}"
                self._fault(site.loc, site.trail, message, code="P228", key=site.keyed)
        self._rules(node, given, bindings, locations, site)
        ordered = {slot.key: slots[slot.key] for slot in declaration.slots if slot.key in slots}
        return self._spec(declaration.id, name, node, site, given, bindings, ordered, places)

    def _rules(
        self,
        node: type[Node],
        given: Mapping[str, Value],
        bindings: Mapping[str, references.Binding],
        locations: Mapping[str, Location],
        site: _Site,
    ) -> None:
        """Report the errors that the node's class finds in its values (`check_ports`)."""
        constants = {
            key: bound.value for key, bound in bindings.items() if isinstance(bound, references.Constant)
        }
        slots = [slot for slot in node.declaration.slots if slot.key in given]
        labels = {slot.key: labels_of(slot, given[slot.key]) for slot in slots}
        for wrong in node.check_ports(PortValues(frozenset(given), constants, labels)):
            if isinstance(wrong, str):
                self._fault(site.loc, site.trail, wrong, code="P234", key=site.keyed)
                continue
            key, _, label = wrong.key.partition("/")
            at = locations.get(key, site.loc)
            message = f"port {key!r}: {wrong.message}" if not label else wrong.message
            self._fault(
                (*at, label) if label else at, site.trail, message, wrong.hint, code="P234", key=bool(label)
            )

    def _spec(
        self,
        identity: str,
        name: str,
        node: type[Node] | None,
        site: _Site,
        given: Mapping[str, Value],
        bindings: Mapping[str, references.Binding],
        slots: Mapping[str, Filled],
        places: Mapping[str, Mark],
    ) -> NodeSpec:
        """Return the NodeSpec with the keys that every node may have."""
        loc, trail = site.loc, site.trail
        return NodeSpec(
            identity,
            name,
            self._document.key_mark(loc) if site.keyed else self._document.mark(loc),
            node,
            bindings,
            slots,
            self._wires.preconditions(given, loc, trail),
            self._wires.postconditions(given, loc, trail, node.declaration.scripts if node else ()),
            self._wires.breakpoint(given, loc, trail),
            places,
        )

    def _body(
        self, declaration: NodeDeclaration, body: Value, site: _Site
    ) -> tuple[dict[str, Value], dict[str, Location]]:
        """Return the node's keys with their values, and the place of each value."""
        main, loc = declaration.slot("do"), site.loc
        if main is not None and isinstance(body, str | list):
            return {"do": body}, {"do": loc}
        given = dict(self._mapping(declaration.id, body, site))
        places: dict[str, Location] = {key: (*loc, key) for key in given}
        strange = [key for key in given if key not in declaration.keys]
        children = [key for key in strange if self._is_node(key)]
        if main is not None and "do" not in given and children:
            # `Inverter: {Condition: {if: holding}}`: the single key that is no port is the child.
            given["do"] = {child: given.pop(child) for child in children}
            places["do"] = loc
        return given, places

    def _is_node(self, key: str) -> bool:
        key = key.removeprefix("-")
        return key in self._trees or self._registry.find(key) is not None or key[:1].isupper()

    def _mapping(self, identity: str, body: Value, site: _Site) -> dict[str, Value]:
        match body:
            case None:
                return {}
            case dict():
                return body
            case list():
                self._fault(site.loc, site.trail, f"{identity} has no children", code="P230")
            case _:
                message = f"the ports of {identity} are a mapping"
                hint = syntax_faults.structure_hint(body) if isinstance(body, str) else ""
                self._fault(site.loc, site.trail, message, hint or "as '{port: value}'", code="P230")
        return {}

    def _unknown_key(self, identity: str, key: str, known: Iterable[str], loc: Location, trail: str) -> None:
        # Hints omit the condition keys unless the author has written an underscore: they are seldom meant.
        names = [name for name in known if not name.startswith("_") or key.startswith("_")]
        hint = self._faults.nearest(key, names)
        self._fault(loc, trail, f"{identity} has no port {show(key)}", hint, code="P218", key=True)
