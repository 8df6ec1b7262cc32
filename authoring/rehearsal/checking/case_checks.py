"""Checking a cases file, by itself and against its mission: all faults at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ....errors import PicktreeError
from ....files.models.validation import Checker
from ....files.yaml.document import Document, Fault, FileError, load_document
from ....trees.loading.loader import load_mission
from ....trees.loading.registry import Registry
from ....trees.mission import Mission
from ....world.scene.description import SceneDescription
from ..cases.case import CaseFile
from ..cases.case_loading import read_cases
from ..stage.mission_staging import scene_of
from .expect_checks import ExpectChecks
from .known_names import Known
from .leaf_checks import LeafChecks
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
