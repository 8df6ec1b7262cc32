"""Reading faults files. All faults come at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...errors import PicktreeError
from ...files.models.validation import Checker
from ...files.yaml.document import Document, Fault, FileError, open_document, read_document
from ...robots.description import RobotDescription
from ...robots.loading import load_robot
from ...world.scene.description import SceneDescription
from ...world.scene.loading.scene_loading import load_scene
from .fault_checks import Place, check_entry, check_expected, check_items, check_place
from .fault_description import Expect, FaultFile
from .fault_entries import spec
from .fault_schema import FaultEntryFile, FaultsRestFile


@dataclass(frozen=True, slots=True)
class FaultsCheck:
    """What was found in a faults file: its content, None when there are errors, and all faults."""

    file: FaultFile | None
    faults: tuple[Fault, ...]
    """Also those of the scene that it names, with their own places."""


def load_faults(
    path: Path, scene: SceneDescription | None = None, robot: RobotDescription | None = None
) -> FaultFile:
    """`scene` and `robot`: where it is to happen, where that is known; they must have the cameras, joints and
    kinds that the file names. Raises FileError with all faults of the file."""
    return _faultless(open_document(path, "faults"), _place(scene, robot))


def parse_faults(text: str, path: Path) -> FaultFile:
    """As `load_faults`, of a text as a log keeps it."""
    return _faultless(read_document(text, path, "faults"), None)


def check_faults(document: Document, place: Place | None = None) -> FaultsCheck:
    """Everything that can be said of a document of kind `faults`; never raises for what stands in it.

    Kinds, forms, colours and numbers of items are compared with the scene where the file names one; cameras,
    joints and what is to appear with `place`, or else with that scene.
    """
    check = Checker(document)
    check.keys(("scene", "expect", "faults"))
    rest = check.read(FaultsRestFile, ignore=[key for key in document.data if key not in ("scene", "expect")])
    scene: SceneDescription | None = None
    with check.readable():
        scene = _scene(check, rest.scene)
    with check.readable():
        if rest.expect is not None:
            check_expected(check, rest.expect)
    if "faults" not in document.data:
        check.fault((), "'faults' is missing", "a list of what is to go wrong", code="P105", key=True)
    entries = check.sequence(FaultEntryFile, "faults")
    if place is None and scene is not None:
        asked = any(document.get(("faults", n, "joint")) is not None for n in range(len(entries)))
        place = Place(scene, _joints(scene) if asked else None)
    for n, entry in enumerate(entries):
        check_entry(check, n, entry)
        if scene is not None:
            check_items(check, n, entry, scene)
        if place is not None:
            check_place(check, n, entry, place)
    if any(fault.severity == "error" for fault in check.faults):
        return FaultsCheck(None, tuple(check.faults))
    expect = None if rest.expect is None else Expect(tuple(rest.expect.causes), rest.expect.lost)
    specs = tuple(map(spec, entries))
    return FaultsCheck(FaultFile(specs, str(document.path), document.text, expect), tuple(check.faults))


def _faultless(document: Document, place: Place | None) -> FaultFile:
    found = check_faults(document, place)
    if found.file is None:
        raise FileError(found.faults)
    return found.file


def _scene(check: Checker, name: str | None) -> SceneDescription | None:
    if name is None:
        return None
    try:
        return load_scene(name, check.document.path)
    except FileError as error:
        check.faults += error.faults
    except PicktreeError as error:
        check.fault(("scene",), str(error), code="P607")
    return None


def _place(scene: SceneDescription | None, robot: RobotDescription | None) -> Place | None:
    if scene is None:
        return None
    return Place(scene, None if robot is None else tuple(robot.joints))


def _joints(scene: SceneDescription) -> tuple[str, ...] | None:
    """Of the scene's robot; None: its file says what is wrong with it itself."""
    try:
        return tuple(load_robot(scene.robot, Path(scene.source).parent).joints)
    except PicktreeError:
        return None
