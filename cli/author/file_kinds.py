"""Check functions by kind of file, each imported when a file of its kind is checked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from ...files.marks import Diagnostic, FileError
from ...files.yaml.document import Document, read_document
from ...robots.loading import check_robot
from ...world.scene.loading.scene_loading import check_scene

if TYPE_CHECKING:
    from ...files.diagnostics.file_checks import Check


def check_cell(document: Document) -> tuple[Diagnostic, ...]:
    """Check a document of kind `scene`, and the robot file that it names."""
    scene = check_scene(document)
    if scene.robot is None:
        return scene.faults
    try:
        return (*scene.faults, *check_robot(read_document(scene.robot, "robot")).faults)
    except FileError as error:
        return (*scene.faults, *error.faults)


def _mission(document: Document) -> Iterable[Diagnostic]:
    from ...authoring.check import check_mission

    return check_mission(document).faults


def _robot(document: Document) -> Iterable[Diagnostic]:
    return check_robot(document).faults


def _faults(document: Document) -> Iterable[Diagnostic]:
    from ...simulation.fault_files.fault_loading import check_faults

    return check_faults(document).faults


def _cases(document: Document) -> Iterable[Diagnostic]:
    from ...authoring.rehearsal.checking.case_checks import check_cases

    return check_cases(document)


def _plan(document: Document) -> Iterable[Diagnostic]:
    from ...batch.plan_loading import check_plan

    return check_plan(document).faults


CHECKS: Mapping[str, Check] = {
    "mission": _mission,
    "scene": check_cell,
    "robot": _robot,
    "faults": _faults,
    "cases": _cases,
    "plan": _plan,
}
