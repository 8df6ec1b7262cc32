"""Holes in the fixtures of a scene file, with what may be wrong about them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence

from ...files.expressions.expression import Expression
from ...files.marks import Location
from ...files.value_wording import listed
from ...files.yaml.document_checker import DocumentChecker
from ..belief.hole_matching import tightest_hole
from ..shapes import Box, Cylinder, Shape, Sphere, greatest_length
from ..values import Array, ObjectId, Pose
from .body_schema import FixtureFile, HoleFile
from .description import NO_UNCERTAINTY, CatalogueEntry, Hole, HoleForm, PlacementUncertainty
from .destinations import ItemTraits, rule_holds
from .hole_geometry import MIN_WALL, InterlockedHoles, outline, partition_top, wall_thickness


def check_holes(check: DocumentChecker, loc: Location, entry: FixtureFile, which: str | None) -> None:
    """Faults of the holes of a fixture, and of what is not known of where it stands."""
    with check.readable():
        if which not in (None, "box", "marker") and entry.uncertainty is not None:
            message = "only a box may stand elsewhere than it says"
            check.fault((*loc, "uncertainty"), message, code="P112", key=True)
    with check.readable():
        if entry.holes is None:
            return
        if which not in (None, "box"):
            check.fault((*loc, "holes"), "only a box has holes", code="P112", key=True)
            return
        if not entry.holes:
            check.fault((*loc, "holes"), "there is no hole", "leave out 'holes'", code="P105", key=True)
        for name, hole in entry.holes.items():
            _check_form(check, (*loc, "holes", name), hole)
        with check.readable():
            if entry.rpy is not None and any(abs(math.sin(angle)) > 1e-9 for angle in entry.rpy[:2]):
                message = "a fixture with holes lies level: give its 'yaw'"
                check.fault((*loc, "rpy"), message, code="P405", key=True)
        if entry.box is not None:
            _check_places(check, (*loc, "holes"), entry.box, _readable(check, entry.holes, entry.box[2]))


def _check_form(check: DocumentChecker, loc: Location, entry: HoleFile) -> None:
    which = check.one_of(loc, HoleFile.one_of)
    with check.readable():
        if which == "round" and entry.yaw is not None:
            check.fault((*loc, "yaw"), "a round hole is not turned", code="P112", key=True)
    with check.readable():
        if entry.slot is not None and entry.slot[0] < entry.slot[1]:
            hint = "the length comes first, and runs along the hole's x; 'yaw' turns it"
            check.fault((*loc, "slot"), "the slot is wider than it is long", hint, code="P430")


def _readable(check: DocumentChecker, entries: Mapping[str, HoleFile], height: float) -> dict[str, Hole]:
    """Those that could be read."""
    found: dict[str, Hole] = {}
    for name, entry in entries.items():
        with check.readable():
            hole = _hole(ObjectId(name), entry, height)
            if hole is not None:
                found[name] = hole
    return found


def _check_places(
    check: DocumentChecker, loc: Location, box: tuple[float, float, float], found: Mapping[str, Hole]
) -> None:
    x, y, z = box
    good: dict[str, Hole] = {}
    for name, hole in found.items():
        at: Location = (*loc, name)
        faults = len(check.faults)
        if hole.depth > z + 1e-9:
            message = f"{check.written((*at, 'depth'), hole.depth, 'm')} is deeper than the box is high"
            check.fault((*at, "depth"), message, f"{1000 * z:g} mm", code="P431")
        if hole.chamfer >= hole.depth:
            message = (
                f"a chamfer of {check.written((*at, 'chamfer'), hole.chamfer, 'm')} leaves no straight wall"
            )
            hint = f"the hole is {1000 * hole.depth:g} mm deep"
            check.fault((*at, "chamfer"), message, hint, code="P432")
        if not _inside(outline(hole), x, y):
            hint = f"the top face reaches {500 * x:g} mm along x and {500 * y:g} mm along y from its middle"
            check.fault((*at, "at"), "the hole is not inside its box", hint, code="P433")
        elif not _inside(outline(hole, hole.chamfer), x, y):
            message = "the chamfer reaches beyond the box"
            check.fault((*at, "chamfer"), message, "it widens the mouth on every side", code="P432")
        if len(check.faults) == faults:
            good[name] = hole
    clashes = [
        (one, other)
        for one, other in itertools.combinations(good, 2)
        if wall_thickness(good[one], good[other]) < MIN_WALL - 1e-9
    ]
    for one, other in clashes:
        message = f"{one!r} and {other!r} leave no wall between them"
        hint = f"{1000 * MIN_WALL:g} mm at least, beside their chamfers"
        check.fault((*loc, other), message, hint, code="P434", key=True)
    if not clashes and isinstance(cut := partition_top(Box(box), tuple(good.values())), InterlockedHoles):
        names = listed(repr(str(hole.id)) for hole in cut.holes)
        hint = "move or turn one of them"
        check.fault(loc, f"no straight line parts the holes {names}", hint, code="P434", key=True)


def _inside(corners: Array, x: float, y: float) -> bool:
    room = MIN_WALL - 1e-9
    return bool((abs(corners[:, 0]) <= x / 2 - room).all() and (abs(corners[:, 1]) <= y / 2 - room).all())


def check_fits(
    check: DocumentChecker,
    rules: Sequence[tuple[Expression, str]],
    coming: Iterable[tuple[str, str]],
    catalogue: Mapping[str, CatalogueEntry | None],
    bored: Mapping[str, tuple[Hole, ...]],
) -> None:
    """Whether each kind that comes, in each colour in which it comes, fits a hole of where it belongs.

    `rules` are those of the destinations with what they name; `bored` are the holes by the names of fixtures
    and by their own.
    """
    told: set[tuple[int, str]] = set()
    for kind, colour in coming:
        entry = catalogue.get(kind)
        if entry is None:
            continue
        item = ItemTraits(colour, entry.form, kind, entry.mass, greatest_length(entry.shape))
        n = next((n for n, (rule, _) in enumerate(rules) if rule_holds(rule, item)), None)
        if n is None or rules[n][1] not in bored or (n, kind) in told:
            continue
        told.add((n, kind))
        to = rules[n][1]
        if tightest_hole(bored[to], entry.shape) is None:
            misses = f"does not fit the hole {to!r}" if "/" in to else f"fits no hole of {to!r}"
            hint = _wanted(entry.shape)
            check.fault(("destinations", n, "to"), f"a {kind} {misses}", hint, code="P435")


def _wanted(shape: Shape) -> str:
    match shape:
        case Cylinder(radius, _) | Sphere(radius):
            return f"it needs a round hole wider than {2000 * radius:g} mm"
        case Box((x, y, _)):
            size = f"{1000 * max(x, y):g} mm × {1000 * min(x, y):g} mm"
            return f"it needs a square hole or a slot larger than {size}"
        case _:
            return "a mesh fits no hole: its section is not known"


def holes(name: str, entry: FixtureFile) -> tuple[Hole, ...]:
    """The holes of a box."""
    assert entry.box is not None
    made = [_hole(ObjectId(f"{name}/{key}"), hole, entry.box[2]) for key, hole in (entry.holes or {}).items()]
    return tuple(hole for hole in made if hole is not None)


def uncertainty(entry: FixtureFile) -> PlacementUncertainty:
    """How far a box may really stand from where it should."""
    if entry.uncertainty is None:
        return NO_UNCERTAINTY
    return PlacementUncertainty(entry.uncertainty.position, entry.uncertainty.angle)


def _hole(hole_id: ObjectId, entry: HoleFile, height: float) -> Hole | None:
    """None when it has no form."""
    form: HoleForm
    if entry.round is not None:
        form, size = "round", (entry.round, entry.round)
    elif entry.square is not None:
        form, size = "square", (entry.square, entry.square)
    elif entry.slot is not None:
        form, size = "slot", entry.slot
    else:
        return None
    pose = Pose.from_rpy((*entry.at, height / 2), (0.0, 0.0, entry.yaw or 0.0))
    return Hole(hole_id, form, size, entry.depth, entry.chamfer, pose)
