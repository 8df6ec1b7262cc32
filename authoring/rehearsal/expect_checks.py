"""Check that the nodes, causes, facts and keys that a case names exist."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, cast

from ...files.marks import Location
from ...files.node_patterns import node_matches
from ...files.value_wording import suggest_name
from ...trees.mission import MAIN, TreeSpec
from ...trees.port_types import show
from ...trees.references import Reference
from ...trees.run_settings import parameter_value
from ...world.belief.facts import FACTS
from ...world.causes import Cause, matches
from ...world.journal import Plain
from .cases_schema import (
    ANY_LEAVES,
    EMPTY_HAND,
    OUTCOMES,
    Effects,
    Expectation,
    ExpectedHandling,
    ExpectedStart,
    ObjectFile,
    Objects,
    RehearsalCase,
    or_else,
)
from .known_names import CaseNames
from .trace import NodeRole, may_fail_with

_SET_BY_CLOCK = "time"
_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


class WorldChecks:
    """Check of one case's world against mission and scene."""

    def __init__(self, known: CaseNames, case: RehearsalCase) -> None:
        self._known, self._case = known, case
        scene = known.scene
        fixed = (*(f.id for f in scene.fixtures), *(b.id for b in scene.bins)) if scene else ()
        self._ids = [*_ids(case), *map(str, fixed)]

    def run(self) -> None:
        """Check everything but answers and expectations."""
        loc = self._case.loc
        self._parameters()
        self.facts(self._case.facts, loc, "facts", may_set=True)
        self.objects(self._case.objects, loc, "objects")

    def facts(self, given: Mapping[str, object], above: Location, key: str, *, may_set: bool) -> None:
        """Check facts. `may_set`: the case sets them; null resets a fact, and time cannot be set."""
        for name, value in given.items():
            loc = self._place((*above, key, name))
            if name not in FACTS or (may_set and name == _SET_BY_CLOCK):
                known = [one for one in FACTS if not may_set or one != _SET_BY_CLOCK]
                message = f"there is no fact {name!r}"
                if name == _SET_BY_CLOCK:
                    message = "the time passes by itself, tick by tick"
                self._fault(loc, message, suggest_name(name, known), "P711", key=True)
            elif not (may_set and value is None) and not _is(value, FACTS[name]):
                message = f"the fact {name!r} is {_WORDS[FACTS[name]]}, not {show(value)}"
                self._fault(loc, message, "", "P711")

    def objects(self, given: Objects, above: Location, key: str) -> None:
        for name, entry in given.items():
            if entry is not None:
                self._object(entry, self._place((*above, key, name)))

    def effects(self, effects: Effects, loc: Location) -> None:
        self.facts(effects.facts, loc, "facts", may_set=True)
        self.objects(effects.objects, loc, "objects")
        if effects.hand is not None and effects.hand != EMPTY_HAND:
            self.objects_named(effects.hand, (*loc, "hand"))

    def objects_named(self, value: object, loc: Location) -> None:
        """Warn about an id that no object in the belief of this case ever has."""
        for one in cast("list[object]", value) if isinstance(value, list) else [value]:
            if isinstance(one, str) and one not in self._ids:
                hint = suggest_name(one, self._ids) or "list it under 'objects'"
                message = f"no object {one!r} is in the belief of this case"
                self._known.fault(loc, message, hint, code="P717", severity="warning")

    def _object(self, entry: ObjectFile, loc: Location) -> None:
        known = self._known

        def value(key: str) -> Any:
            return or_else(lambda: getattr(entry, key), None)

        known.name((*loc, "kind"), value("kind"), "kind", known.kinds)
        known.name((*loc, "form"), value("form"), "form", known.forms)
        known.name((*loc, "colour"), value("colour"), "colour", known.colours)
        known.name((*loc, "destination"), value("destination"), "bin", known.destinations)
        known.name((*loc, "place"), value("place"), "place", known.places)

    def _parameters(self) -> None:
        if self._known.mission is None:
            return
        ports = {port.key: port for port in self._known.mission.parameters}
        given = cast("Mapping[str, Plain]", self._case.parameters)
        for name, value in given.items():
            loc = self._place((*self._case.loc, "parameters", name))
            if name not in ports:
                hint = suggest_name(name, ports) or "it has none"
                self._fault(loc, f"the mission has no parameter {name!r}", hint, "P713", key=True)
                continue
            try:
                parameter_value(value, ports[name])
            except ValueError as error:
                self._fault(loc, f"the mission's parameter {name!r}: {error}", ports[name].doc, "P713")
        for port in ports.values():
            if port.required and port.key not in given:
                message = f"the mission's parameter {port.key!r} needs a value"
                self._fault(self._case.loc, message, port.doc, "P713", key=True)

    def _fault(self, loc: Location, message: str, hint: str, code: str, *, key: bool = False) -> None:
        self._known.fault(loc, message, hint, code=code, key=key)

    def _place(self, loc: Location) -> Location:
        """Return the place where a value is written: settings at the file's top apply to every case."""
        case = self._case.loc
        if loc[: len(case)] == case and not self._known.given(loc):
            above = loc[len(case) :]
            return above if self._known.given(above) else loc
        return loc


def _ids(case: RehearsalCase) -> Iterator[str]:
    yield from (name for name, entry in case.objects.items() if entry is not None)
    for script in case.scripts:
        for answer in script.everything:
            yield from (name for name, entry in answer.then.objects.items() if entry is not None)


def _is(value: object, kind: type) -> bool:
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))


class ExpectChecks:
    """Check of one case's expectation against the mission."""

    def __init__(self, known: CaseNames, expect: Expectation, worlds: WorldChecks) -> None:
        self._known, self._expect, self._worlds = known, expect, worlds

    def run(self) -> None:
        expect, loc = self._expect, self._expect.loc
        if expect.cause is not None:
            self._known.cause(expect.cause, (*loc, "cause"), family=True)
        for turn in expect.order or ():
            if turn.pattern != ANY_LEAVES:
                self._turn(turn)
        for taken_up in expect.handled:
            self._taken_up(taken_up)
        for number, pattern in enumerate(expect.never):
            self._known.nodes(pattern, (*loc, "never", number))
        self._worlds.facts(expect.facts, loc, "facts", may_set=False)
        self._worlds.objects(expect.objects, loc, "objects")
        for key in expect.blackboard:
            self._key(key, (*loc, "blackboard", key))

    def _turn(self, turn: ExpectedStart) -> None:
        leaves = self._known.leaves(turn.pattern, turn.loc)
        if not turn.outcome or turn.outcome in OUTCOMES:
            return
        at = (*turn.loc, turn.pattern)
        if "." not in turn.outcome and turn.outcome != "*":
            hint = suggest_name(turn.outcome, (*OUTCOMES, *(c for role in leaves for c in _causes(role))))
            self._known.fault(at, f"{turn.outcome!r} is neither an outcome nor a cause", hint, code="P714")
            return
        causes = self._known.cause(turn.outcome, at, family=True)
        if causes and leaves and not any(_may_fail(role, causes) for role in leaves):
            declared = ", ".join(dict.fromkeys(c for role in leaves for c in _causes(role))) or "none"
            message = f"{turn.pattern} does not fail with {turn.outcome}"
            self._known.fault(at, message, f"it declares {declared}", code="P706")

    def _taken_up(self, wanted: ExpectedHandling) -> None:
        self._known.cause(wanted.cause, (*wanted.loc, "cause"), family=True)
        if self._known.roles is None:
            return
        by = self._known.nodes(wanted.by, (*wanted.loc, "by")) if wanted.by else self._known.roles.all
        labels = list(dict.fromkeys(label for role in by for label in _handlers(role)))
        if wanted.handler and by and wanted.handler not in labels:
            owner = wanted.by or "the mission"
            message = f"{owner} has no handler {wanted.handler!r}"
            hint = suggest_name(wanted.handler, labels) or "there are none"
            self._known.fault((*wanted.loc, "handler"), message, hint, code="P718")

    def _key(self, key: str, loc: Location) -> None:
        mission = self._known.mission
        if mission is None or self._known.roles is None:
            return
        owner, _, name = key.rpartition("/")
        trees = [mission.main] if not owner else [
            mission.trees[role.spec.id]
            for role in self._known.roles.all
            if role.spec.node is None and node_matches(owner, role.path)
        ]  # fmt: skip
        if owner and not trees and node_matches(owner, MAIN):
            trees = [mission.main]
        if owner and not trees:
            names = [role.spec.name for role in self._known.roles.all if role.spec.node is None]
            message = f"no sub-tree of the mission fits {owner!r}"
            self._known.fault(loc, message, suggest_name(owner, (MAIN, *names)), code="P715", key=True)
            return
        keys = list(dict.fromkeys(one for tree in trees for one in _keys(tree)))
        if name not in keys:
            hint = suggest_name(name, keys) or "it has none"
            message = f"{owner or MAIN} has no key {name!r}"
            self._known.fault(loc, message, hint, code="P715", key=True)


def _keys(tree: TreeSpec) -> Iterator[str]:
    """Yield all blackboard keys that a tree's text names."""
    yield from (port.key for port in tree.ports)
    for spec in tree.root.iterate():
        yield from (bound.key for bound in spec.ports.values() if isinstance(bound, Reference))
        for assignments in spec.postconditions.values():
            yield from (one.key for one in assignments)


def _handlers(role: NodeRole) -> Iterator[str]:
    """Yield the labels of a node's handlers: patterns of its cause table, and `otherwise`."""
    node = role.spec.node
    tables = [slot for slot in node.declaration.slots if slot.of == "cause"] if node else []
    for slot in tables:
        yield from (label for label, _ in role.spec.slots.get(slot.key, ()))
    if tables and "otherwise" in role.spec.slots:
        yield "otherwise"


def _causes(role: NodeRole) -> Iterator[str]:
    return map(str, role.causes)


def _may_fail(role: NodeRole, causes: tuple[Cause, ...]) -> bool:
    declared = (*may_fail_with(role), "tree.missing_input", "world.unknown_object", "internal.error")
    return any(matches(str(one), cause) for one in declared for cause in causes)
