"""Reading faults files. All faults come at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..errors import PicktreeError
from ..files.checked import Checker, describe
from ..files.document import Document, Fault, FileError, Location, nearest, open_document, read_document
from ..scene.description import SceneDescription
from ..scene.entries import check_unknown, unknown
from ..scene.load import load_scene
from .description import AtNode, AtTime, Bump, FaultFile, FaultSpec, Friction, Obstacle, Remove, Target, When
from .schema import MAY, NEEDS, FaultEntryFile, FaultsRestFile, TargetFile, WhenFile

_OWN_KEYS = ("target", "friction", "mass", "velocity", "spin", "body", "name", "stays")


@dataclass(frozen=True, slots=True)
class FaultsCheck:
    """What was found in a faults file: its content, None when there are errors, and all faults."""

    file: FaultFile | None
    faults: tuple[Fault, ...]
    """Also those of the scene that it names, with their own places."""


def load_faults(path: Path) -> FaultFile:
    """Raises FileError with all faults of the file."""
    return _faultless(open_document(path, "faults"))


def parse_faults(text: str, path: Path) -> FaultFile:
    """As `load_faults`, of a text as a log keeps it."""
    return _faultless(read_document(text, path, "faults"))


def check_faults(document: Document) -> FaultsCheck:
    """Everything that can be said of a document of kind `faults`; never raises for what stands in it.

    Kinds, forms, colours and numbers of items are compared with the scene where the file names one.
    """
    check = Checker(document)
    check.keys(("scene", "faults"))
    rest = check.read(FaultsRestFile, ignore=[key for key in document.data if key != "scene"])
    scene: SceneDescription | None = None
    with check.readable():
        scene = _scene(check, rest.scene)
    if "faults" not in document.data:
        check.fault((), "'faults' is missing", "a list of what is to go wrong", code="P105", key=True)
    entries = check.sequence(FaultEntryFile, "faults")
    for n, entry in enumerate(entries):
        _check_entry(check, n, entry)
        if scene is not None:
            with check.readable():
                if entry.target is not None:
                    _check_target(check, ("faults", n, "target"), entry.target, scene)
    if any(fault.severity == "error" for fault in check.faults):
        return FaultsCheck(None, tuple(check.faults))
    specs = tuple(_spec(entry) for entry in entries)
    return FaultsCheck(FaultFile(specs, str(document.path), document.text), tuple(check.faults))


def _faultless(document: Document) -> FaultFile:
    found = check_faults(document)
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


def _check_entry(check: Checker, n: int, entry: FaultEntryFile) -> None:
    loc: Location = ("faults", n)
    with check.readable():
        _check_when(check, (*loc, "when"), entry.when)
    with check.readable():
        for name in _OWN_KEYS:
            given = check.document.get((*loc, name)) is not None
            if given and name not in MAY[entry.fault]:
                check.fault((*loc, name), f"{entry.fault!r} takes no {name!r}", code="P602", key=True)
            if not given and name in NEEDS[entry.fault]:
                check.fault(loc, f"{entry.fault!r} needs {name!r}", code="P601")
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


def _check_when(check: Checker, loc: Location, when: WhenFile) -> None:
    if check.one_of(loc, WhenFile.one_of) == "at":
        for name in ("start", "delay"):
            if getattr(when, name) is not None:
                check.fault((*loc, name), f"{name!r} belongs to 'node'", code="P605", key=True)


def _check_target(check: Checker, loc: Location, target: TargetFile, scene: SceneDescription) -> None:
    """Whether the scene has an item that is meant."""
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
                check.fault((*loc, key), message, nearest(name, known), code="P608")
    with check.readable():
        if target.index is not None and total is not None and target.index >= total:
            hint = f"it has {total} items, counted from 0" if total else "it has no items"
            message = f"the scene {scene.name} has no item {target.index}"
            check.fault((*loc, "index"), message, hint, code="P608")


def _spec(entry: FaultEntryFile) -> FaultSpec:
    """A fault without faults."""
    when, chosen = _when(entry.when), entry.target or TargetFile()
    target = Target(chosen.index, chosen.kind, chosen.form, chosen.colour, chosen.nearest_to)
    match entry.fault:
        case "remove":
            return Remove(when, target)
        case "friction":
            return Friction(when, target, entry.friction or 0.0, entry.mass)
        case "bump":
            return Bump(when, target, entry.velocity or (0.0, 0.0, 0.0), entry.spin or (0.0, 0.0, 0.0))
        case "obstacle":
            assert entry.body is not None
            return Obstacle(when, unknown(entry.name or "obstacle", entry.body), entry.stays)


def _when(when: WhenFile) -> When:
    if when.node is not None:
        return AtNode(when.node, when.start or 1, when.delay or 0.0)
    return AtTime(when.at or 0.0)
