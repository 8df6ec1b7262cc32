"""Check of a cases file by itself and against its mission: its nodes, causes, facts and keys."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import cast, get_args

from picktree.files import (
    Diagnostic,
    FileError,
    Location,
    PicktreeError,
    node_matches,
    suggest_name,
    where,
)
from picktree.files.yaml import Document, DocumentChecker, YamlNode, file_models
from picktree.trees import (
    MAIN,
    ConditionNode,
    Mission,
    Skill,
    TreeSpec,
    convert_literal,
    parameter_value,
    references,
    show,
)
from picktree.trees.loading import NodeRegistry, load_mission
from picktree.world import ITEM_COLOURS, Cause, Plain, all_causes, internal, matches, tree, world, world_facts
from picktree.world.scene import Form, SceneDescription

from .cases import (
    ANY_LEAVES,
    EMPTY_HAND,
    OUTCOMES,
    BelievedObject,
    CaseFile,
    Destination,
    Effects,
    Expectation,
    ExpectedHandling,
    ExpectedStart,
    Objects,
    PlacedAnswer,
    RehearsalCase,
    entries,
    numbered,
    read_cases,
)
from .leaf_roles import NodeRole, may_fail_with, roles_of
from .mission_staging import StubbedMission, play_case, scene_of, stub_mission
from .rehearsal_world import HAND, TABLE, UNKNOWN, MissingOutput


class CaseNames:
    """Valid names, and the errors about unknown ones.

    Without a mission only names common to every mission are checked.
    """

    def __init__(
        self, check: DocumentChecker, mission: Mission | None, scene: SceneDescription | None
    ) -> None:
        self._check, self.mission, self.scene = check, mission, scene
        self.fault, self.readable, self._document = check.fault, check.readable, check.document
        self.roles = roles_of(mission) if mission else None
        self._object_names = _object_names(scene)
        self._fitting: dict[str, tuple[NodeRole, ...]] = {}

    def given(self, loc: Location) -> bool:
        """Whether the file has a value at that place."""
        node: YamlNode | None = self._document.root
        for part in loc:
            node = node and node.child(part)
        return node is not None

    # Nodes.

    def nodes(self, pattern: str, loc: Location, *, key: bool = False) -> tuple[NodeRole, ...]:
        """Return the nodes that match a pattern, `Main` excepted; report an error when there are none."""
        if self.roles is None or not pattern.strip("/"):
            return ()
        if pattern not in self._fitting:
            self._fitting[pattern] = tuple(role for role in self.roles if node_matches(pattern, role.path))
        found = self._fitting[pattern]
        if not found:
            message = f"no node of the mission fits {pattern!r}"
            self.fault(loc, message, self._near(pattern), code="P703", key=key)
        return found

    def leaves(self, pattern: str, loc: Location, remedy: str, *, key: bool = False) -> tuple[NodeRole, ...]:
        """Return the stubbed leaves that match a pattern; without any report an error with this remedy."""
        found = self.nodes(pattern, loc, key=key)
        played = tuple(role for role in found if role.played)
        if found and not played:
            kind = found[0].spec.id
            message = f"{pattern!r} is a node of the language ({kind}), for which a case cannot give answers"
            known = suggest_name("", self._names(played=True)) or "this mission has no leaf of that kind"
            self.fault(loc, message, f"{remedy}; {known}", code="P704", key=key)
        return played

    def _near(self, pattern: str) -> str:
        assert self.roles is not None
        last = pattern.rstrip("/").rpartition("/")[2]
        there = next((role.path for role in self.roles if role.spec.name.partition("#")[0] == last), None)
        return f"{last!r} stands at {there}" if there else suggest_name(last, self._names(played=False))

    def _names(self, *, played: bool) -> list[str]:
        """Return the names of nodes, the leaves first, each once."""
        assert self.roles is not None
        wanted = [role for role in self.roles if role.played or not played]
        ordered = sorted(wanted, key=lambda role: not role.played)
        return list(dict.fromkeys(role.spec.name.partition("#")[0] for role in ordered))

    # Causes.

    def cause(self, name: str, loc: Location, *, family: bool = False) -> tuple[Cause, ...]:
        """Return the causes of that name, or with `family` of the pattern; report an error without any."""
        known = [cause.name for cause in all_causes()]
        if family:
            stems = {one.rpartition(".")[0] for one in known}
            known += [f"{stem}.*" for stem in sorted(stems)]
        if name in known or (family and name == "*"):
            return tuple(cause for cause in all_causes() if matches(name, cause))
        prefixes = {cause.name.partition(".")[0] for cause in all_causes()}
        if self.mission is not None or name.partition(".")[0] in prefixes:  # else it may be a plug-in's
            self.fault(loc, f"no cause is called {name!r}", suggest_name(name, known), code="P705")
        return ()

    def object(self, entry: BelievedObject, loc: Location) -> None:
        """Report the names in an object's entry that the scene does not have."""
        for key, (what, known) in self._object_names.items():
            with self.readable():
                value = getattr(entry, key)
                name = value.name if isinstance(value, Destination) else value
                if name is not None and name not in known:
                    self.fault(
                        (*loc, key), f"there is no {what} {name!r}", suggest_name(name, known), code="P712"
                    )


def _object_names(scene: SceneDescription | None) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return the word and the valid names of each key of an object that names something.

    Without a scene only the keys whose names every scene has are there.
    """
    found = {"form": ("form", (*get_args(Form), UNKNOWN)), "colour": ("colour", (*ITEM_COLOURS, UNKNOWN))}
    if scene is None:
        return found
    bins = tuple(str(one.id) for one in scene.bins)
    holed = [fixture for fixture in scene.fixtures if fixture.holes]
    holes = tuple(str(hole.id) for fixture in holed for hole in fixture.holes)
    return found | {
        "kind": ("kind", (*(known.kind for known in scene.catalogue), UNKNOWN)),
        "destination": ("bin", (*bins, *(str(fixture.id) for fixture in holed), *holes)),
        "place": ("place", (TABLE, HAND, world_facts.ASIDE, *bins, *holes)),
    }


_SET_BY_CLOCK = "time"
_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
_NO_ANSWER = "answer for the leaves below it, or set what it reads by 'facts' or 'objects'"
_NOT_IN_ORDER = "leave it out: 'order' lists skills and conditions; 'handled' and 'never' name any node"
_ALWAYS_POSSIBLE = (tree.MISSING_INPUT, tree.TIMEOUT, world.UNKNOWN_OBJECT, internal.ERROR)
"""Causes with which every node may fail; a program fault is included, because missions may handle it."""


class CaseChecks:
    """Check of one case's world, answers and expectation against mission and scene."""

    def __init__(self, known: CaseNames, case: RehearsalCase) -> None:
        self._known, self._case = known, case
        scene = known.scene
        fixed = (*(f.id for f in scene.fixtures), *(b.id for b in scene.bins)) if scene else ()
        self._ids = [*_ids(case), *map(str, fixed)]

    def run(self) -> None:
        loc, entry = self._case.loc, self._case.entry
        self._parameters()
        self._facts(entry.facts, loc)
        self._objects(entry.objects, loc)
        self._answers()
        for check in (self._cause, self._starts, self._handling, self._never, self._end):
            with self._known.readable():
                check(entry.expect, (*loc, "expect"))

    # World.

    def _facts(self, given: Mapping[str, object], above: Location, *, may_set: bool = True) -> None:
        """Check facts. `may_set`: the case sets them; null resets a fact, and time cannot be set."""
        for name, value in given.items():
            loc = self._place((*above, "facts", name))
            if name not in world_facts.FACTS or (may_set and name == _SET_BY_CLOCK):
                known = [one for one in world_facts.FACTS if not may_set or one != _SET_BY_CLOCK]
                message = f"there is no fact {name!r}"
                if name == _SET_BY_CLOCK:
                    message = "the time passes by itself, tick by tick"
                self._known.fault(loc, message, suggest_name(name, known), code="P711", key=True)
            elif not (may_set and value is None) and not _is(value, world_facts.FACTS[name]):
                message = f"the fact {name!r} is {_WORDS[world_facts.FACTS[name]]}, not {show(value)}"
                self._known.fault(loc, message, "", code="P711")

    def _objects(self, given: Objects, above: Location) -> None:
        for name, entry in entries(given).items():
            if entry is not None:
                self._known.object(entry, self._place((*above, "objects", name)))

    def _objects_named(self, value: object, loc: Location) -> None:
        """Warn about an id that no object in the belief of this case ever has."""
        for one in cast("list[object]", value) if isinstance(value, list) else [value]:
            if isinstance(one, str) and one not in self._ids:
                hint = suggest_name(one, self._ids) or "list it under 'objects'"
                message = f"no object {one!r} is in the belief of this case"
                self._known.fault(loc, message, hint, code="P717", severity="warning")

    def _parameters(self) -> None:
        if self._known.mission is None:
            return
        ports = {port.key: port for port in self._known.mission.parameters}
        given = cast("Mapping[str, Plain]", self._case.entry.parameters)
        for name, value in given.items():
            loc = self._place((*self._case.loc, "parameters", name))
            if name not in ports:
                hint = suggest_name(name, ports) or "it has none"
                self._known.fault(loc, f"the mission has no parameter {name!r}", hint, code="P713", key=True)
                continue
            try:
                parameter_value(value, ports[name])
            except ValueError as error:
                self._known.fault(
                    loc, f"the mission's parameter {name!r}: {error}", ports[name].doc, code="P713"
                )
        for port in ports.values():
            if port.required and port.key not in given:
                message = f"the mission's parameter {port.key!r} needs a value"
                self._known.fault(self._case.loc, message, port.doc, code="P713", key=True)

    def _place(self, loc: Location) -> Location:
        """Return the place where a value is written: settings at the file's top apply to every case."""
        case = self._case.loc
        if loc[: len(case)] == case and not self._known.given(loc):
            above = loc[len(case) :]
            return above if self._known.given(above) else loc
        return loc

    # Expectation.

    def _cause(self, expect: Expectation, loc: Location) -> None:
        if expect.cause is not None:
            self._known.cause(expect.cause, (*loc, "cause"), family=True)

    def _starts(self, expect: Expectation, loc: Location) -> None:
        for number, turn in numbered(expect.order or ()):
            if turn.pattern != ANY_LEAVES:
                self._start(turn, (*loc, "order", number))

    def _handling(self, expect: Expectation, loc: Location) -> None:
        for number, wanted in numbered(expect.handled):
            with self._known.readable():
                self._handler(wanted, (*loc, "handled", number))

    def _never(self, expect: Expectation, loc: Location) -> None:
        for number, pattern in numbered(expect.never):
            self._known.nodes(pattern, (*loc, "never", number))

    def _end(self, expect: Expectation, loc: Location) -> None:
        with self._known.readable():
            self._facts(expect.facts, loc, may_set=False)
        with self._known.readable():
            self._objects(expect.objects, loc)
        for key in expect.blackboard:
            self._key(key, (*loc, "blackboard", key))

    def _start(self, turn: ExpectedStart, loc: Location) -> None:
        leaves = self._known.leaves(turn.pattern, loc, _NOT_IN_ORDER)
        if not turn.outcome or turn.outcome in OUTCOMES:
            return
        at = (*loc, turn.pattern)
        if "." not in turn.outcome and turn.outcome != "*":
            hint = suggest_name(turn.outcome, (*OUTCOMES, *(c for role in leaves for c in _causes(role))))
            self._known.fault(at, f"{turn.outcome!r} is neither an outcome nor a cause", hint, code="P714")
            return
        causes = self._known.cause(turn.outcome, at, family=True)
        if causes and leaves and not any(_may_fail(role, causes) for role in leaves):
            declared = ", ".join(dict.fromkeys(c for role in leaves for c in _causes(role))) or "none"
            message = f"{turn.pattern} does not fail with {turn.outcome}"
            self._known.fault(at, message, f"it declares {declared}", code="P706")

    def _handler(self, wanted: ExpectedHandling, loc: Location) -> None:
        self._known.cause(wanted.cause, (*loc, "cause"), family=True)
        if self._known.roles is None:
            return
        by = self._known.nodes(wanted.by, (*loc, "by")) if wanted.by else self._known.roles
        labels = list(dict.fromkeys(label for role in by for label in _handlers(role)))
        if wanted.handler and by and wanted.handler not in labels:
            owner = wanted.by or "the mission"
            message = f"{owner} has no handler {wanted.handler!r}"
            hint = suggest_name(wanted.handler, labels) or "there are none"
            self._known.fault((*loc, "handler"), message, hint, code="P718")

    def _key(self, key: str, loc: Location) -> None:
        mission = self._known.mission
        if mission is None or self._known.roles is None:
            return
        owner, _, name = key.rpartition("/")
        trees = [mission.main] if not owner else [
            mission.trees[role.spec.id]
            for role in self._known.roles
            if role.spec.node is None and node_matches(owner, role.path)
        ]  # fmt: skip
        if owner and not trees and node_matches(owner, MAIN):
            trees = [mission.main]
        if owner and not trees:
            names = [role.spec.name for role in self._known.roles if role.spec.node is None]
            message = f"no sub-tree of the mission fits {owner!r}"
            self._known.fault(loc, message, suggest_name(owner, (MAIN, *names)), code="P715", key=True)
            return
        keys = list(dict.fromkeys(one for tree in trees for one in _keys(tree)))
        if name not in keys:
            hint = suggest_name(name, keys) or "it has none"
            message = f"{owner or MAIN} has no key {name!r}"
            self._known.fault(loc, message, hint, code="P715", key=True)

    # Answers.

    def _answers(self) -> None:
        answered: set[str] = set()
        for script in self._case.scripts:
            played = self._known.leaves(script.pattern, script.loc, _NO_ANSWER, key=True)
            left = [role for role in played if role.path not in answered]
            own = script.loc[:1] == ("cases",)
            if played and not left and own:
                message = f"{script.pattern!r} is never used: earlier patterns fit all nodes that it fits"
                self._known.fault(
                    script.loc, message, "put it first", code="P716", key=True, severity="warning"
                )
            for given in script.everything:
                with self._known.readable():
                    self._answer(given, left)
            if script.answers:
                answered.update(role.path for role in left)

    def _answer(self, given: PlacedAnswer, roles: list[NodeRole]) -> None:
        answer = given.answer
        with self._known.readable():
            self._effects(answer.effects, (*given.loc, "then"))
        causes = self._known.cause(answer.cause, (*given.loc, "cause")) if answer.cause else ()
        said: set[tuple[object, ...]] = set()
        for role in roles:
            alike = (role.spec.node, role.causes)  # which may differ with the wiring
            if alike in said:
                continue
            said.add(alike)
            self._possible(given, role, causes)
            self._given_outputs(given, role)

    def _effects(self, effects: Effects, loc: Location) -> None:
        self._facts(effects.facts, loc)
        self._objects(effects.objects, loc)
        if effects.hand not in (None, EMPTY_HAND):
            self._objects_named(effects.hand, (*loc, "hand"))

    def _possible(self, given: PlacedAnswer, role: NodeRole, causes: tuple[Cause, ...]) -> None:
        answer, node, identity = given.answer, role.spec.node, role.spec.id
        assert node is not None
        skill, condition = issubclass(node, Skill), issubclass(node, ConditionNode)

        def impossible(key: str, message: str, hint: str = "", *, code: str = "P710") -> None:
            self._known.fault((*given.loc, key), message, hint, code=code)

        if condition and (answer.end in ("RUNNING", "SKIPPED") or answer.ticks):
            what = "it takes no ticks" if answer.ticks else f"it is never {answer.end}"
            impossible("ticks" if answer.ticks else "status", f"{identity} is a condition: {what}")
        if skill and answer.end == "SKIPPED":
            hint = "only its '_skipIf' or '_while' can skip it; a rehearsal checks them, too"
            impossible("status", f"{identity} is a skill, which does not skip itself", hint)
        declared = ", ".join(map(str, role.causes))
        if skill and answer.end == "FAILURE" and not answer.cause:
            hint = f"one of {declared}" if declared else "it declares none: it cannot fail"
            impossible("status", f"{identity} is a skill, which fails for a cause", hint)
        for cause in causes:
            if not _may_fail(role, (cause,)):
                hint = f"it declares {declared or 'none'}"
                impossible("cause", f"{identity} does not fail with {cause}", hint, code="P706")

    def _given_outputs(self, given: PlacedAnswer, role: NodeRole) -> None:
        assert role.spec.node is not None
        declaration = role.spec.node.declaration
        for key, value in given.answer.outputs.items():
            loc: Location = (*given.loc, "outputs", key)
            port = declaration.port(key)
            if port is None or port.direction != "out":
                known = [port.key for port in declaration.outputs]
                hint = suggest_name(key, known) if known else "it has none"
                message = f"{declaration.id} has no output {key!r}"
                self._known.fault(loc, message, hint, code="P707", key=True)
                continue
            try:
                converted = convert_literal(value, port.type, port.unit, port.choices, port.within)
            except ValueError as error:
                self._known.fault(loc, f"output {key!r} of {declaration.id}: {error}", port.doc, code="P708")
                continue
            if port.type.name == "object":
                self._objects_named(converted, loc)


def _ids(case: RehearsalCase) -> Iterator[str]:
    """Yield the ids of all objects that are ever in the belief of a case."""
    given = [case.entry.objects]
    for script in case.scripts:
        for placed in script.everything:
            with suppress(file_models.UnreadPart):
                given.append(placed.answer.effects.objects)
    for objects in given:
        yield from (name for name, entry in entries(objects).items() if entry is not None)


def _is(value: object, kind: type) -> bool:
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))


def _keys(tree: TreeSpec) -> Iterator[str]:
    """Yield all blackboard keys that a tree's text names."""
    yield from (port.key for port in tree.ports)
    for spec in tree.root.iterate():
        yield from (bound.key for bound in spec.ports.values() if isinstance(bound, references.Reference))
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
    allowed = (*may_fail_with(role), *_ALWAYS_POSSIBLE)
    return any(matches(str(one), cause) for one in allowed for cause in causes)


@dataclass(frozen=True, slots=True)
class CasesCheck:
    """Result of the check of a cases file. With errors the cases are only those that could be read."""

    cases: CaseFile
    mission: Mission | None
    """The given mission, or the one that the file names."""
    faults: tuple[Diagnostic, ...]

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        return tuple(fault for fault in self.faults if fault.severity == "error")


def check_cases(document: Document, registry: NodeRegistry | None = None) -> tuple[Diagnostic, ...]:
    """Return all faults of a document of kind `cases`, checked against the mission that it names."""
    return examine_cases(document, None, registry).faults


def examine_cases(
    document: Document, mission: Mission | None, registry: NodeRegistry | None = None
) -> CasesCheck:
    """Check a cases file as `check_cases` does, and return the cases, too.

    Raises only for a faulty scene of the given mission.
    """
    check = DocumentChecker(document)
    cases = read_cases(check)
    if mission is not None:
        scene = scene_of(mission)
        _other_mission(check, cases.mission, mission.document.path, registry)
    else:
        if "mission" not in document.data:
            message = "the file names no mission: its nodes, causes, outputs, keys and bins are not checked"
            check.fault((), message, "as 'mission: ../sorting.yaml'", code="P702", severity="warning")
        mission = _mission(check, cases.mission, registry) if cases.mission else None
        scene = _scene(check, mission)
    known = CaseNames(check, mission, scene)
    in_need = any(role.played and role.needed for role in known.roles or ())
    staging = stub_mission(mission, scene) if mission is not None and in_need else None
    for case in cases.cases:
        CaseChecks(known, case).run()
        if staging is not None and not any(_spoils(fault, case) for fault in check.faults):
            _check_outputs(known, staging, case)
    faults = dict.fromkeys(sorted(check.faults, key=lambda fault: fault.mark))
    return CasesCheck(cases, mission, tuple(faults))


def _spoils(fault: Diagnostic, case: RehearsalCase) -> bool:
    """Whether a case with that fault in its file cannot be played."""
    own = where(case.loc)
    if fault.severity != "error" or (fault.where == own and fault.code == "P111"):
        return False  # its name alone is wrong
    shared = ("mission", "objects", "facts", "leaves", "parameters")
    return fault.where.startswith(shared) or f"{fault.where}.".startswith((f"{own}.", f"{own}["))


def _check_outputs(known: CaseNames, staging: StubbedMission, case: RehearsalCase) -> None:
    """Report the first output that a leaf leaves out which the case reaches, and the mission reads."""
    _, played = play_case(staging, case)
    for found in played.contradictions:
        if not isinstance(found, MissingOutput):
            continue
        (role,) = (role for role in staging.roles if role.path == found.path)
        port = role.spec.node.declaration.port(found.port) if role.spec.node is not None else None
        if found.answer is None:
            message = f"{role.path} has no answer, but an output {found.port!r} that the mission uses"
        else:
            message = f"{found}, used at {role.path}"
        hint = f"as {{outputs: {{{found.port}: …}}}}" + (f": {port.doc}" if port is not None else "")
        loc = case.loc if found.answer is None else found.answer.loc
        known.fault(loc, message, hint, code="P709", key=found.answer is None)


def _mission(check: DocumentChecker, path: Path, registry: NodeRegistry | None) -> Mission | None:
    try:
        return load_mission(path, registry)
    except FileError as error:
        first, *more = error.faults
        others = f", and {len(more)} more" if more else ""
        hint = "" if path.is_file() or first.hint else "the path counts from this file's folder"
        check.fault(("mission",), f"the mission cannot be read: {first}{others}", hint, code="P702")
    return None


def _other_mission(
    check: DocumentChecker, named: Path | None, given: Path, registry: NodeRegistry | None
) -> None:
    """Warn where the file names another mission than the given one; a named mission must be readable."""
    if named is None or os.path.abspath(named) == os.path.abspath(given):
        return
    if _mission(check, named, registry) is None or os.path.realpath(named) == os.path.realpath(given):
        return
    here = os.path.relpath(given, check.document.path.parent)
    message = f"the cases are played with {given}, not with this mission"
    check.fault(("mission",), message, f"write 'mission: {here}'", code="P702", severity="warning")


def _scene(check: DocumentChecker, mission: Mission | None) -> SceneDescription | None:
    if mission is None:
        return None
    try:
        return scene_of(mission)
    except PicktreeError as error:
        first = str(error).splitlines()[0]
        check.fault(("mission",), f"the mission's scene cannot be read: {first}", code="P702")
    return None
