"""Check of a cases file, by itself and against its mission, with all errors at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...files.errors import PicktreeError
from ...files.marks import Diagnostic, FileError, Location, where
from ...files.yaml.document import Document, read_document
from ...files.yaml.document_checker import DocumentChecker
from ...trees.controls.leaves import ConditionNode
from ...trees.declaration import NodeDeclaration
from ...trees.loading.loader import load_mission
from ...trees.loading.registry import NodeRegistry
from ...trees.mission import Mission
from ...trees.port_types import convert_literal
from ...trees.skill import Skill
from ...world.causes import Cause, internal, matches, tree, world
from ...world.scene.description import SceneDescription
from .case_loading import read_cases
from .cases_schema import CaseFile, LeafAnswer, RehearsalCase
from .expect_checks import ExpectChecks, WorldChecks
from .known_names import CaseNames
from .mission_staging import StubbedMission, play_case, scene_of, stub_mission
from .rehearsal_world import MissingOutput
from .trace import NodeRole, may_fail_with

_ALWAYS_POSSIBLE = (tree.MISSING_INPUT, tree.TIMEOUT, world.UNKNOWN_OBJECT, internal.ERROR)
"""Causes with which every node may fail; a program fault is included, because missions may handle it."""


class LeafChecks:
    """Check of one case's answers against the leaves that give them."""

    def __init__(self, known: CaseNames, case: RehearsalCase, worlds: WorldChecks) -> None:
        self._known, self._case, self._worlds = known, case, worlds

    def run(self) -> None:
        answered: set[str] = set()
        for script in self._case.scripts:
            played = self._known.leaves(script.pattern, script.loc, key=True)
            left = [role for role in played if role.path not in answered]
            own = script.loc[:1] == ("cases",)
            if played and not left and own:
                message = f"{script.pattern!r} is never used: patterns before it fit all that it fits"
                self._known.fault(
                    script.loc, message, "put it first", code="P716", key=True, severity="warning"
                )
            for answer in script.everything:
                self._answer(answer, left)
            if script.answers:
                answered.update(role.path for role in left)

    def _answer(self, answer: LeafAnswer, roles: list[NodeRole]) -> None:
        self._worlds.effects(answer.then, (*answer.loc, "then"))
        causes = self._known.cause(answer.cause, _at(answer, "cause")) if answer.cause else ()
        said: set[tuple[object, ...]] = set()
        for role in roles:
            alike = (role.spec.node, role.causes)  # which may differ with the wiring
            if alike in said:
                continue
            said.add(alike)
            self._possible(answer, role, causes)
            self._given_outputs(answer, role)

    def _possible(self, answer: LeafAnswer, role: NodeRole, causes: tuple[Cause, ...]) -> None:
        node, identity = role.spec.node, role.spec.id
        assert node is not None
        skill, condition = issubclass(node, Skill), issubclass(node, ConditionNode)

        def impossible(key: str, message: str, hint: str = "") -> None:
            self._known.fault(_at(answer, key), message, hint, code="P710")

        if condition and (answer.status in ("RUNNING", "SKIPPED") or answer.ticks):
            what = "it takes no ticks" if answer.ticks else f"it is never {answer.status}"
            impossible("ticks" if answer.ticks else "status", f"{identity} is a condition: {what}")
        if skill and answer.status == "SKIPPED":
            hint = "it is skipped by its '_skipIf' or '_while', which is asked in a rehearsal, too"
            impossible("status", f"{identity} is a skill, which does not skip itself", hint)
        declared = role.causes
        if skill and answer.status == "FAILURE" and not answer.cause:
            names = ", ".join(map(str, declared))
            hint = f"one of {names}" if names else "it declares none: it cannot fail"
            impossible("status", f"{identity} is a skill, which fails for a cause", hint)
        allowed = (*may_fail_with(role), *_ALWAYS_POSSIBLE)
        for cause in causes:
            if not any(matches(str(one), cause) for one in allowed):
                names = ", ".join(map(str, declared)) or "none"
                message = f"{identity} does not fail with {cause}"
                self._known.fault(_at(answer, "cause"), message, f"it declares {names}", code="P706")

    def _given_outputs(self, answer: LeafAnswer, role: NodeRole) -> None:
        assert role.spec.node is not None
        declaration = role.spec.node.declaration
        for key, value in answer.outputs.items():
            loc: Location = (*answer.loc, "outputs", key)
            port = declaration.port(key)
            if port is None or port.direction != "out":
                self._unknown_output(declaration, key, loc)
                continue
            try:
                converted = convert_literal(value, port.type, port.unit, port.choices, port.within)
            except ValueError as error:
                self._known.fault(loc, f"output {key!r} of {declaration.id}: {error}", port.doc, code="P708")
                continue
            if port.type.name == "object":
                self._worlds.objects_named(converted, loc)

    def _unknown_output(self, declaration: NodeDeclaration, key: str, loc: Location) -> None:
        from ...files.value_wording import suggest_name

        known = [port.key for port in declaration.outputs]
        hint = suggest_name(key, known) if known else "it has none"
        self._known.fault(loc, f"{declaration.id} has no output {key!r}", hint, code="P707", key=True)


def _at(answer: LeafAnswer, key: str) -> Location:
    return (*answer.loc, key)


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
    """Return all errors of a document of kind `cases`, checked against the mission that it names."""
    return examine_cases(document, None, registry).faults


def load_cases(path: Path, mission: Mission | None = None) -> CaseFile:
    """Load the cases of a file, for that mission or for the one that it names.

    Raises FileError with all errors, also those of the scene when the mission is given.
    """
    found = examine_cases(read_document(path, "cases"), mission)
    if found.errors:
        raise FileError(found.errors)
    return found.cases


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
    else:
        mission = _mission(check, cases.mission, registry) if cases.mission else None
        scene = _scene(check, mission)
    known = CaseNames(check, mission, scene)
    staging = stub_mission(mission, scene) if mission is not None and known.in_need else None
    for case in cases.cases:
        worlds = WorldChecks(known, case)
        worlds.run()
        LeafChecks(known, case, worlds).run()
        ExpectChecks(known, case.expect, worlds).run()
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
        (role,) = (role for role in staging.roles.all if role.path == found.path)
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
        check.fault(("mission",), f"the mission cannot be read: {first}{others}", code="P702")
    return None


def _scene(check: DocumentChecker, mission: Mission | None) -> SceneDescription | None:
    if mission is None:
        return None
    try:
        return scene_of(mission)
    except PicktreeError as error:
        first = str(error).splitlines()[0]
        check.fault(("mission",), f"the mission's scene cannot be read: {first}", code="P702")
    return None
