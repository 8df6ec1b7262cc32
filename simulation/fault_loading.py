"""Loading and checking of fault files. All diagnostics of a file are reported at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from picktree.files import CheckedFile, FileError, Location, PicktreeError, describe, suggest_name
from picktree.files.yaml import Document, DocumentChecker, read_document
from picktree.world import all_causes
from picktree.world.robot_model import RobotDescription, load_robot
from picktree.world.scene import SceneDescription, check_unknown, load_scene

from .fault_entries import (
    ALLOWED_KEYS,
    OWN_KEYS,
    REQUIRED_KEYS,
    ExpectFile,
    FaultEntryFile,
    FaultExpectation,
    FaultFile,
    FaultsRestFile,
    TargetFile,
    WhenFile,
    fault_of_entry,
)


@dataclass(frozen=True, slots=True)
class FaultContext:
    """Surroundings of the faults: a scene, and the joints of its robot's arm; None: unknown."""

    scene: SceneDescription
    joints: tuple[str, ...] | None = None


def check_entry(check: DocumentChecker, n: int, entry: FaultEntryFile) -> None:
    """Check the n-th entry by itself."""
    loc: Location = ("faults", n)
    with check.readable():
        _check_when(check, (*loc, "when"), entry.when)
    with check.readable():
        kind = entry.fault
        for name in OWN_KEYS:
            given = check.document.get((*loc, name)) is not None
            if given and name not in ALLOWED_KEYS[kind]:
                hint = "it has 'stays'" if (kind, name) == ("obstacle", "lasts") else ""
                check.fault((*loc, name), f"{kind!r} takes no {name!r}", hint, code="P602", key=True)
            if not given and name in REQUIRED_KEYS[kind]:
                check.fault(loc, f"{kind!r} needs {name!r}", code="P601")
    with check.readable():
        if entry.target == TargetFile():
            hint = "index, kind, form, colour or nearest_to"
            check.fault((*loc, "target"), "no item is named", hint, code="P603")
    with check.readable():
        if entry.target and entry.target.nearest_to == "object" and entry.when.node is None:
            message = "'object' needs a node in 'when', whose port it is"
            check.fault((*loc, "target", "nearest_to"), message, code="P604")
    with check.readable():
        if entry.body is not None:
            check_unknown(check, (*loc, "body"), entry.body)
    with check.readable():
        if entry.colour is not None and entry.colour == entry.shown_as:
            check.fault((*loc, "shown_as"), f"{entry.colour} is shown as itself", code="P609")


def _check_when(check: DocumentChecker, loc: Location, when: WhenFile) -> None:
    chosen = check.one_of(loc, WhenFile.one_of)
    others = {"at": ("start", "delay", "each"), "node": ("every",)}
    for name in others.get(chosen or "", ()):
        if getattr(when, name) is not None:
            owner = "node" if chosen == "at" else "at"
            check.fault((*loc, name), f"{name!r} belongs to {owner!r}", code="P605", key=True)


def check_target(check: DocumentChecker, loc: Location, target: TargetFile, scene: SceneDescription) -> None:
    """Check that the scene has an item that a target can mean."""
    counts = [count for load in scene.loads for count in load.counts]
    kinds = list(dict.fromkeys(kind for kind, _ in counts))
    forms = list(dict.fromkeys(str(scene.entry(kind).form) for kind in kinds))
    colours = list(dict.fromkeys(colour for load in scene.loads for colour in load.colours))
    total = scene.items_in_all
    for key, known in (("kind", kinds), ("form", forms), ("colour", colours)):
        with check.readable():
            name: str | None = getattr(target, key)
            if name is not None and name not in known:
                message = f"the scene {scene.name} has no item of {key} {describe(name)}"
                check.fault((*loc, key), message, suggest_name(name, known), code="P608")
    with check.readable():
        if target.index is not None and total is not None and target.index >= total:
            hint = f"it has {total} items, counted from 0" if total else "it has no items"
            message = f"the scene {scene.name} has no item {target.index}"
            check.fault((*loc, "index"), message, hint, code="P608")


def check_place(check: DocumentChecker, n: int, entry: FaultEntryFile, place: FaultContext) -> None:
    """Check that the cell has the camera, the joint and the kind of item that an entry names."""
    scene = place.scene
    kinds = [each.kind for each in scene.catalogue]
    cameras = [camera.name for camera in scene.cameras]
    of = f"the scene {scene.name} has no"
    asked: list[tuple[str, str, Sequence[str] | None]] = [
        ("camera", f"{of} camera", cameras),
        ("kind", f"the catalogue of {scene.name} has no", kinds),
        ("joint", f"the robot of {scene.name} has no joint", place.joints),
    ]
    for key, begun, known in asked:
        with check.readable():
            name: str | None = getattr(entry, key)
            if name is not None and known is not None and name not in known:
                message = f"{begun} {describe(name)}"
                check.fault(("faults", n, key), message, suggest_name(name, known), code="P609")


def check_expected(check: DocumentChecker, expect: ExpectFile) -> None:
    """Check that the expected causes exist. A plug-in's own causes are not known before it is read."""
    known = [cause.name for cause in all_causes()]
    families = dict.fromkeys(f"{name.rpartition('.')[0]}.*" for name in known)
    named = [*known, *families, "*"]
    with check.readable():
        for n, pattern in enumerate(expect.causes):
            if pattern not in named:
                message = f"no cause is called {describe(pattern)}"
                check.fault(("expect", "causes", n), message, suggest_name(pattern, named), code="P610")


def load_faults(
    path: Path, scene: SceneDescription | None = None, robot: RobotDescription | None = None
) -> FaultFile:
    """Load a fault file. `scene` and `robot`, where given, must have the cameras, joints and kinds that the
    file names. Raises FileError with all diagnostics of the file."""
    joints = None if robot is None else tuple(robot.joints)
    place = None if scene is None else FaultContext(scene, joints)
    return check_faults(read_document(path, "faults"), place).required()


def parse_faults(text: str, path: Path) -> FaultFile:
    """Load faults from a text, as a log keeps it. Raises FileError like `load_faults`."""
    return check_faults(read_document(path, "faults", text)).required()


def check_faults(document: Document, place: FaultContext | None = None) -> CheckedFile[FaultFile]:
    """Check a document of kind `faults`; never raises for its content.

    Kinds, forms, colours and numbers of items are compared with the scene that the file names. Cameras,
    joints and items that appear are compared with `place`, or else with that scene. Diagnostics of the scene
    have their own places.
    """
    check = DocumentChecker(document)
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
        place = FaultContext(scene, _joints(scene) if asked else None)
    for n, entry in enumerate(entries):
        check_entry(check, n, entry)
        with check.readable():
            if scene is not None and entry.target is not None:
                check_target(check, ("faults", n, "target"), entry.target, scene)
        if place is not None:
            check_place(check, n, entry, place)

    def file() -> FaultFile:
        expect = (
            None
            if rest.expect is None
            else FaultExpectation(tuple(rest.expect.causes), rest.expect.lost, tuple(rest.expect.roots))
        )
        return FaultFile(tuple(map(fault_of_entry, entries)), str(document.path), document.text, expect)

    return check.result(file)


def _scene(check: DocumentChecker, name: str | None) -> SceneDescription | None:
    if name is None:
        return None
    try:
        return load_scene(name, check.document.path)
    except FileError as error:
        check.faults += error.faults
    except PicktreeError as error:
        check.fault(("scene",), str(error), code="P607")
    return None


def _joints(scene: SceneDescription) -> tuple[str, ...] | None:
    """Return the arm's joints of the scene's robot; None when its file has errors, which are reported
    elsewhere."""
    try:
        return tuple(load_robot(scene.robot, Path(scene.source).parent).joints)
    except PicktreeError:
        return None
