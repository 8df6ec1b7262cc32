"""Loader of plan files, with a full check of the files that a plan names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from pydantic import ValidationError

from ...authoring.check import MissionCheck, check_mission
from ...errors import PicktreeError
from ...files.marks import CheckedFile, Diagnostic, FileError
from ...files.yaml.document import Document, read_document
from ...files.yaml.document_checker import DocumentChecker
from ...simulation.fault_files.fault_loading import load_faults
from ...trees.loading.scene_names import SceneNames, load_surroundings
from ...trees.running.run_settings import read_settings
from ...world.scene.loading.scene_loading import scene_names
from .plan import BatchPlan, JobLimits
from .plan_schema import NO_FAULTS, PlanFile


def load_plan(path: Path) -> BatchPlan:
    """Load a plan. Raises FileError with all errors of the plan and of every file that it names."""
    return check_plan(read_document(path, "plan")).required()


def plan_of(words: Mapping[str, object]) -> BatchPlan:
    """Return the plan with these keys of a plan file; their paths are absolute.

    Raises FileError with all errors of the named files, PicktreeError for an invalid key or setting.
    """
    given = {key: value for key, value in words.items() if value not in (None, [])}
    try:
        file = PlanFile.model_validate(given)
    except ValidationError as error:
        detail = error.errors(include_url=False)[0]
        option = str(detail["loc"][0]).replace("_", "-")
        raise PicktreeError(f"--{option}: {detail['msg'].removeprefix('Value error, ')}") from None
    plan = _plan(file, Path(file.missions[0]))
    faults = list(check_files_of(plan))
    if faults:
        raise FileError(faults)
    check_settings(plan)
    return plan


def check_plan(document: Document) -> CheckedFile[BatchPlan]:
    """Check a document of kind `plan` completely; never raises for its content."""
    check = DocumentChecker(document)
    file = check.read(PlanFile)
    if check.faults:
        return CheckedFile(None, tuple(check.faults))
    plan = _plan(file, document.path)
    faults = list(check_files_of(plan))
    if not faults:
        for name in plan.settings:
            for message in _misfits(plan, name):
                check.fault(("set", name), message, code="P802", key=True)
    check.faults += faults
    return check.result(lambda: plan)


def check_files_of(plan: BatchPlan) -> Iterator[Diagnostic]:
    """Yield the errors in missions, scenes, robots and faults files that the plan names, each once."""
    seen: dict[Diagnostic, None] = {}
    for scene in plan.scenes:
        for mission in plan.missions:
            seen.update(dict.fromkeys(_faults_of_mission(mission, scene)))
    for file in plan.faults:
        if file is not None:
            try:
                load_faults(file)
            except FileError as error:
                seen.update(dict.fromkeys(error.faults))
    yield from (fault for fault in seen if fault.severity == "error")


def check_settings(plan: BatchPlan) -> None:
    """Check the settings. Raises PicktreeError for the first that is invalid for one of the missions."""
    for name in plan.settings:
        for message in _misfits(plan, name):
            raise PicktreeError(message)


def _faults_of_mission(mission: Path, scene: str | None) -> Iterable[Diagnostic]:
    try:
        check = _checked(mission, scene)
    except FileError as error:
        return error.faults
    return check.faults


def _checked(mission: Path, scene: str | None) -> MissionCheck:
    known: SceneNames | None = load_surroundings(scene) if scene is not None else None
    return check_mission(read_document(mission, "mission"), known=known)


def _misfits(plan: BatchPlan, name: str) -> Iterator[str]:
    """Yield the error of a setting, for the first mission in which it is invalid."""
    for path in plan.missions:
        mission = _checked(path, plan.scenes[0]).mission
        if mission is None:
            continue
        required = {p.key: plan.settings[p.key][0] for p in mission.parameters if p.key in plan.settings}
        for value in plan.settings[name]:
            try:
                read_settings(mission, {**required, name: value})
            except PicktreeError as error:
                yield f"{path.name}: {error}" if len(plan.missions) > 1 else str(error)
                return


def _plan(file: PlanFile, source: Path) -> BatchPlan:
    folder = source.parent.absolute()
    settings = {
        name: tuple(values) if isinstance(values, list) else (values,) for name, values in file.set.items()
    }
    return BatchPlan(
        name=file.name or source.stem,
        missions=tuple(folder / mission for mission in file.missions),
        seeds=file.seeds,
        scenes=tuple(_scene(name, folder) for name in file.scenes) or (None,),
        faults=tuple(None if name == NO_FAULTS else folder / name for name in file.faults) or (None,),
        settings=settings,
        backend=file.backend,
        verify=file.verify,
        limits=JobLimits(file.limit, file.wall_limit, file.memory, file.disk),
        keep=file.keep,
    )


def _scene(name: str, folder: Path) -> str:
    return name if name in scene_names() else str(folder / name)
