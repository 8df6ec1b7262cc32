"""Loading and checking of fault files. All diagnostics of a file are reported at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import cast

from picktree.files import CheckedFile, FileError, Location, PicktreeError, describe, suggest_name
from picktree.files.yaml import Document, DocumentChecker, file_models, read_document
from picktree.world import all_causes
from picktree.world.robot_model import RobotDescription, load_robot
from picktree.world.scene import SceneDescription, check_unknown, load_scene

from .fault_entries import (
    KINDS,
    AtTime,
    CameraMislabel,
    Fault,
    FaultExpectation,
    FaultFile,
    FaultSpec,
    FaultsSettings,
    FaultTarget,
    ItemFault,
    JointWeak,
    Obstacle,
    WhenFile,
)


def required_keys(kind: type[Fault]) -> tuple[str, ...]:
    """Return the keys that entries of a kind of fault need besides `when`."""
    fields = file_models.model_fields(kind)
    return tuple(key for key, field in fields.items() if field.is_required() and key != "when")


@cache
def own_keys() -> tuple[str, ...]:
    """Return the keys that some faults take and others do not."""
    keys = (key for kind in KINDS.values() for key in file_models.keys_of(kind))
    return tuple(dict.fromkeys(key for key in keys if key not in file_models.keys_of(Fault)))


@dataclass(frozen=True, slots=True)
class FaultContext:
    """Surroundings of the faults: a scene, and the joints of its robot's arm; None: unknown."""

    scene: SceneDescription
    joints: tuple[str, ...] | None = None


def read_entry(check: DocumentChecker, loc: Location) -> Fault | None:
    """Read the entry at `loc` as its kind of fault; None when its kind is not known."""
    value = check.document.get(loc)
    name = value.get("fault") if isinstance(value, dict) else None
    kind = KINDS.get(name) if isinstance(name, str) else None
    own = () if kind is None else file_models.keys_of(kind)
    needed = () if kind is None else required_keys(kind)
    ignore = {"fault"}
    if isinstance(value, dict):
        known = ("fault", *(own or (*file_models.keys_of(Fault), *own_keys())))
        for key in value:
            if key not in known and key not in own_keys():
                ignore.add(key)
                hint = suggest_name(key, known)
                check.fault((*loc, key), f"unknown key {describe(key)}", hint, code="P104", key=True)
        if "fault" not in value:
            check.fault(loc, "'fault' is missing", code="P105", key=True)
        elif kind is None:
            hint = suggest_name(name, KINDS) if isinstance(name, str) else f"one of {', '.join(KINDS)}"
            check.fault((*loc, "fault"), f"{describe(name)} is not known here", hint, code="P108")
        for key in (key for key in own_keys() if kind is not None or key in value):
            given = value.get(key) is not None
            if not given or key not in own:
                ignore.add(key)
            if given and kind is not None and key not in own:
                hint = "it has 'stays'" if (name, key) == ("obstacle", "lasts") else ""
                check.fault((*loc, key), f"{name!r} takes no {key!r}", hint, code="P602", key=True)
            if not given and key in needed:
                check.fault(loc, f"{name!r} needs {key!r}", code="P601")
    entry = check.read(kind or Fault, loc, ignore=ignore, needed=needed)
    _check_when(check, (*loc, "when"))
    return None if kind is None else entry


def _check_entry(check: DocumentChecker, loc: Location, entry: Fault) -> None:
    """Check the combination of values of an entry."""
    match entry:
        case ItemFault():
            with check.readable():
                if entry.target == FaultTarget():
                    hint = "index, kind, form, colour or nearest_to"
                    check.fault((*loc, "target"), "no item is named", hint, code="P603")
            with check.readable():
                if entry.target.nearest_to == "object" and isinstance(entry.when, AtTime):
                    message = "'object' needs a node in 'when', whose port it is"
                    check.fault((*loc, "target", "nearest_to"), message, code="P604")
        case Obstacle():
            with check.readable():
                check_unknown(check, (*loc, "body"), entry.body)
        case CameraMislabel():
            with check.readable():
                if entry.colour == entry.shown_as:
                    check.fault((*loc, "shown_as"), f"{entry.colour} is shown as itself", code="P609")
        case _:
            pass


def _check_when(check: DocumentChecker, loc: Location) -> None:
    chosen = check.one_of(loc, WhenFile.one_of)
    others = {"at": ("start", "delay", "each"), "node": ("every",)}
    for name in others.get(chosen or "", ()):
        if check.document.get((*loc, name)) is not None:
            owner = "node" if chosen == "at" else "at"
            check.fault((*loc, name), f"{name!r} belongs to {owner!r}", code="P605", key=True)


def check_target(check: DocumentChecker, loc: Location, target: FaultTarget, scene: SceneDescription) -> None:
    """Check that the scene has an item that a target can mean."""
    kinds = list(dict.fromkeys(kind for load in scene.loads for kind in load.counts))
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


def check_place(check: DocumentChecker, loc: Location, entry: Fault, place: FaultContext) -> None:
    """Check that the cell has the camera, the joint and the kind of item that an entry names."""
    scene = place.scene
    kinds = [each.kind for each in scene.catalogue]
    cameras = [camera.name for camera in scene.cameras]
    of = f"the scene {scene.name} has no"
    names: list[tuple[str, str, Sequence[str] | None]] = [
        ("camera", f"{of} camera", cameras),
        ("kind", f"the catalogue of {scene.name} has no", kinds),
        ("joint", f"the robot of {scene.name} has no joint", place.joints),
    ]
    for key, begun, known in names:
        with check.readable():
            name: str | None = getattr(entry, key, None)
            if name is not None and known is not None and name not in known:
                message = f"{begun} {describe(name)}"
                check.fault((*loc, key), message, suggest_name(name, known), code="P609")


def check_expected(check: DocumentChecker, expect: FaultExpectation) -> None:
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
    rest = check.read(FaultsSettings, ignore=[key for key in document.data if key not in ("scene", "expect")])
    scene: SceneDescription | None = None
    with check.readable():
        scene = _scene(check, rest.scene)
    with check.readable():
        if rest.expect is not None:
            check_expected(check, rest.expect)
    if "faults" not in document.data:
        check.fault((), "'faults' is missing", "a list of what is to go wrong", code="P105", key=True)
    entries: list[Fault] = []
    found = [(loc, read_entry(check, loc)) for loc in check.places("faults") if not check.full]
    if place is None and scene is not None:
        needs_joints = any(isinstance(entry, JointWeak) for _, entry in found)
        place = FaultContext(scene, _joints(scene) if needs_joints else None)
    for loc, entry in found:
        if entry is None:
            continue
        entries.append(entry)
        _check_entry(check, loc, entry)
        with check.readable():
            if scene is not None and isinstance(entry, ItemFault):
                check_target(check, (*loc, "target"), entry.target, scene)
        if place is not None:
            check_place(check, loc, entry, place)

    def file() -> FaultFile:
        faults = cast("list[FaultSpec]", entries)
        return FaultFile(tuple(faults), str(document.path), document.text, rest.expect)

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
