"""Checking a cases file, by itself and against its mission: all faults at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...world.errors import PicktreeError
from ...world.files.checked import Checker
from ...world.files.document import Document, Fault, FileError, load_document
from ...world.scene.description import SceneDescription
from ..loader import load_mission
from ..mission import Mission
from ..registry import Registry
from .case import CaseFile
from .expect_checks import ExpectChecks
from .known import Known
from .leaf_checks import LeafChecks
from .reading import read_cases
from .staging import scene_of
from .world_checks import WorldChecks


@dataclass(frozen=True, slots=True)
class CasesCheck:
    """What a cases file gave. With errors the cases are only what could be read of them."""

    cases: CaseFile
    mission: Mission | None
    """The given one, or the one that the file names."""
    faults: tuple[Fault, ...]

    @property
    def errors(self) -> tuple[Fault, ...]:
        return tuple(fault for fault in self.faults if fault.severity == "error")


def check_cases(document: Document, registry: Registry | None = None) -> tuple[Fault, ...]:
    """All that is wrong with a document of kind `cases`; the mission is the one that it names."""
    return examine_cases(document, None, registry).faults


def load_cases(path: Path, mission: Mission | None = None) -> CaseFile:
    """The cases of a file, for that mission or for the one that it names.

    Raises FileError with all faults, also those of the scene when the mission is given.
    """
    found = examine_cases(load_document(path, "cases"), mission)
    if found.errors:
        raise FileError(found.errors)
    return found.cases


def examine_cases(
    document: Document, mission: Mission | None, registry: Registry | None = None
) -> CasesCheck:
    """As `check_cases`, for who wants the cases, too. Raises only for a faulty scene of the given mission."""
    check = Checker(document)
    cases = read_cases(check)
    if mission is not None:
        scene = scene_of(mission)
    else:
        mission = _mission(check, cases.mission, registry) if cases.mission else None
        scene = _scene(check, mission)
    known = Known(check, mission, scene)
    for case in cases.cases:
        worlds = WorldChecks(known, case)
        worlds.run()
        LeafChecks(known, case, worlds).run()
        ExpectChecks(known, case.expect, worlds).run()
    faults = dict.fromkeys(sorted(check.faults, key=lambda fault: fault.mark))
    return CasesCheck(cases, mission, tuple(faults))


def _mission(check: Checker, path: Path, registry: Registry | None) -> Mission | None:
    try:
        return load_mission(path, registry)
    except FileError as error:
        first, *more = error.faults
        others = f", and {len(more)} more" if more else ""
        check.fault(("mission",), f"the mission cannot be read: {first}{others}", code="P702")
    return None


def _scene(check: Checker, mission: Mission | None) -> SceneDescription | None:
    if mission is None:
        return None
    try:
        return scene_of(mission)
    except PicktreeError as error:
        first = str(error).splitlines()[0]
        check.fault(("mission",), f"the mission's scene cannot be read: {first}", code="P702")
    return None
