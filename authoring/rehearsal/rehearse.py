"""Rehearsal of a mission: its real tree is ticked, and its leaves answer as each case defines."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from ...files.diagnostics.fault_codes import apply_suppressions, pages
from ...files.errors import PicktreeError
from ...files.marks import FileError
from ...files.node_patterns import short_names
from ...files.value_wording import suggest_name
from ...files.yaml.document import Document, read_document
from ...trees.loading.loader import read_mission
from ...trees.mission import Mission
from ...trees.status import NodeStatus
from ..check import check_mission
from .case_checks import examine_cases
from .cases_schema import CaseFile, RehearsalCase
from .mission_staging import StubbedMission, play_case, scene_of, stub_mission
from .rehearsal_result import CaseResult, CoverageRecord, Rehearsal, coverage
from .rehearsal_world import TICK_PERIOD
from .verdict import CaseOutcome, differences


def rehearse_files(
    mission: Path,
    cases: Path | None = None,
    names: Collection[str] = (),
    robot: str | None = None,
    *,
    text: str | None = None,
) -> Rehearsal:
    """Rehearse the files. Default for `cases`: the file with the mission's name in `cases` next to it.

    `robot`: shipped robot or robot file instead of the scene's; the mission is checked with its poses.
    `text`: the mission's text where it is not saved. Raises FileError with all errors of the mission, of its
    scene or of the cases.
    """
    if cases is None:
        cases = mission.parent / "cases" / mission.name
        if (text is not None or mission.is_file()) and not cases.is_file():
            raise PicktreeError(f"there are no cases {cases}; name the file with --cases")
    document = read_document(mission, "mission", text)
    loaded = read_mission(document)
    if robot is not None:
        checked = check_mission(document, robot=robot)
        if errors := [fault for fault in checked.faults if fault.severity == "error"]:
            raise FileError(errors)
    found = examine_cases(read_document(cases, "cases"), loaded)
    if found.errors:
        raise FileError(found.errors)
    given = found.cases.document
    codes = [page.code for page in pages()]
    warnings = apply_suppressions(found.faults, given.text, str(given.path), codes, complete=False)
    return replace(rehearse(loaded, found.cases, names), warnings=warnings)


def rehearse(mission: Mission, cases: CaseFile, names: Collection[str] = ()) -> Rehearsal:
    """Rehearse all cases of the file, or those with these names. The cases were checked for this mission.

    Raises PicktreeError for an unknown name, and for a faulty scene of the mission.
    """
    known = [case.name for case in cases.cases]
    for name in names:
        if name not in known:
            raise PicktreeError(f"{cases.document.path} has no case {name!r}; {suggest_name(name, known)}")
    staging = stub_mission(mission, scene_of(mission))
    reached = CoverageRecord()
    results = tuple(
        rehearse_case(staging, case, cases.document, reached)
        for case in cases.cases
        if not names or case.name in names
    )
    short = short_names([mission.main.name, *(role.path for role in staging.roles.all)])
    return Rehearsal(
        mission.name,
        cases.document.path,
        results,
        coverage(staging, reached),
        complete=len(results) == len(cases.cases),
        warnings=(),
        names=short,
    )


def rehearse_case(
    staging: StubbedMission, case: RehearsalCase, document: Document, reached: CoverageRecord
) -> CaseResult:
    """Rehearse one case, and add its coverage to `reached`."""
    tree, world = play_case(staging, case)
    trace = world.trace
    if trace.tick == case.halt_after and tree.status is NodeStatus.RUNNING:
        trace.flush(tree.halt().writes)
    outcome = CaseOutcome(trace.tick, tree.status, tree.failure, tree, world)
    reached.take(staging, trace)
    return CaseResult(
        name=case.name,
        doc=case.doc,
        mark=document.key_mark(case.loc),
        status=tree.status.value,
        cause=tree.failure.cause.name if tree.failure else "",
        message=tree.failure.message if tree.failure else "",
        ticks=trace.tick,
        seconds=round(trace.tick * TICK_PERIOD, 9),
        differences=differences(document, case, outcome),
        runs=tuple(trace.runs),
        handled=tuple(trace.handled),
        events=tuple(trace.events),
        unused=tuple(document.mark(loc) for loc in world.prompter.unused() if loc[:1] == ("cases",)),
    )
