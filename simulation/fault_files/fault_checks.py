"""What no single value of a faults file can be wrong about: keys of its kind, names of the cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...files.models.validation import Checker, describe
from ...files.spelling import nearest
from ...files.yaml.document import Location
from ...world.causes import all_causes
from ...world.scene.description import SceneDescription
from ...world.scene.loading.scene_entries import check_unknown
from .fault_schema import MAY, NEEDS, OWN_KEYS, ExpectFile, FaultEntryFile, TargetFile, WhenFile


@dataclass(frozen=True, slots=True)
class Place:
    """Where faults are to happen: a scene, and the joints of its robot's arm; None: not known."""

    scene: SceneDescription
    joints: tuple[str, ...] | None = None


def check_entry(check: Checker, n: int, entry: FaultEntryFile) -> None:
    """The n-th entry by itself."""
    loc: Location = ("faults", n)
    with check.readable():
        _check_when(check, (*loc, "when"), entry.when)
    with check.readable():
        kind = entry.fault
        for name in OWN_KEYS:
            given = check.document.get((*loc, name)) is not None
            if given and name not in MAY[kind]:
                hint = "it has 'stays'" if (kind, name) == ("obstacle", "lasts") else ""
                check.fault((*loc, name), f"{kind!r} takes no {name!r}", hint, code="P602", key=True)
            if not given and name in NEEDS[kind]:
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


def _check_when(check: Checker, loc: Location, when: WhenFile) -> None:
    chosen = check.one_of(loc, WhenFile.one_of)
    others = {"at": ("start", "delay", "each"), "node": ("every",)}
    for name in others.get(chosen or "", ()):
        if getattr(when, name) is not None:
            owner = "node" if chosen == "at" else "at"
            check.fault((*loc, name), f"{name!r} belongs to {owner!r}", code="P605", key=True)


def check_items(check: Checker, n: int, entry: FaultEntryFile, scene: SceneDescription) -> None:
    """Whether the scene has an item that is meant."""
    with check.readable():
        if entry.target is not None:
            _check_target(check, ("faults", n, "target"), entry.target, scene)


def _check_target(check: Checker, loc: Location, target: TargetFile, scene: SceneDescription) -> None:
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


def check_place(check: Checker, n: int, entry: FaultEntryFile, place: Place) -> None:
    """Whether the cell has the camera, the joint and the kind of item that an entry names."""
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
                check.fault(("faults", n, key), message, nearest(name, known), code="P609")


def check_expected(check: Checker, expect: ExpectFile) -> None:
    """Whether there are such causes. A plug-in's own are not known before it is read."""
    known = [cause.name for cause in all_causes()]
    families = dict.fromkeys(f"{name.rpartition('.')[0]}.*" for name in known)
    named = [*known, *families, "*"]
    with check.readable():
        for n, pattern in enumerate(expect.causes):
            if pattern not in named:
                message = f"no cause is called {describe(pattern)}"
                check.fault(("expect", "causes", n), message, nearest(pattern, named), code="P610")
