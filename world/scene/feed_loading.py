"""Spawn and feed entries of scene files: checks that need several values, as whether items have room in
their area, and conversion to values.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import numpy as np

from picktree.files import Location, describe, suggest_name
from picktree.files.yaml import Document, DocumentChecker, file_models
from picktree.world import (
    Bounds,
    Box,
    Cylinder,
    ObjectId,
    Pose,
    Shape,
    Sphere,
    corners,
    extents,
    heap_geometry,
)

from .description import (
    ASSORTMENT,
    MESH_SETS,
    Assortment,
    AtTimes,
    Belt,
    Bin,
    CatalogueEntry,
    Delivery,
    Fixture,
    ItemLoad,
    Spawn,
    When,
    WhenClear,
    WhenFile,
)
from .scene_entries import body
from .scene_schema import FixtureFile

MAX_COVERED_SHARE = 0.8
"""Share of an area that items and their gaps may cover."""
Corners: TypeAlias = tuple[tuple[float, float], tuple[float, float]]
"""((x min, y min), (x max, y max)) in the world, m."""
Outline: TypeAlias = tuple[float, float]
"""Area of an item's footprint with half the gap around it, m², and its greatest reach from the centre, m."""


def check_spawn(
    check: DocumentChecker,
    n: int,
    entry: Spawn,
    catalogue: Mapping[str, CatalogueEntry | None],
    bodies: Sequence[Fixture | Bin] | None,
    workspace: Bounds | None,
    assorted: bool = False,
) -> None:
    """Check one spawn entry. Faulty kinds count as missing; None means an unreadable part.

    `assorted`: whether the scene has an assortment.
    """
    loc: Location = ("spawn", n)
    check_kinds(check, loc, entry, {**catalogue, ASSORTMENT: None} if assorted else catalogue)
    with check.readable():
        _check_heap(check, loc, entry, bodies)
    with check.readable():
        rim = 0.0 if entry.drop is None else heap_geometry.PILE_RIM
        may_lie = entry.area is not None and check_area(check, loc, entry.area, bodies, workspace, rim)
        if may_lie and entry.area is not None and entry.drop is None:
            check_crowding(check, loc, entry, entry.area, 0.0 if entry.touching else entry.gap, catalogue)
        if entry.touching and entry.tumbled:
            message = "'touching' and 'tumbled' exclude each other: dropped items come to rest anywhere"
            check.fault((*loc, "touching"), message, "give one of them", code="P112", key=True)


def _check_heap(
    check: DocumentChecker, loc: Location, entry: Spawn, bodies: Sequence[Fixture | Bin] | None
) -> None:
    """Check the pouring of items: manner and target."""
    area = _has_key(check, loc, "area")
    if not area and entry.into is None:
        hint = "give 'area', a rectangle on the table, or 'into', a tote"
        check.fault(loc, "'area' is missing", hint, code="P105", key=True)
    if area and entry.into is not None:
        message = "'area' and 'into' exclude each other"
        check.fault((*loc, "into"), message, "give one of them", code="P112", key=True)
    if entry.into is not None:
        check_tote(check, loc, entry.into, bodies)
    if entry.drop is None and (entry.into is not None or ASSORTMENT in entry.counts):
        which = "'drop: heap'" if entry.into is not None else "'drop: pile' or 'drop: packed'"
        hint = f"items are poured into a tote, and things of an assortment lie in heaps: add {which}"
        check.fault(loc, "'drop' is missing", hint, code="P105", key=True)
    if entry.drop is not None and (entry.drop == "heap") != (entry.into is not None):
        hint = "'heap' needs 'into', a tote; 'pile' and 'packed' need 'area', on the table"
        check.fault((*loc, "drop"), f"'drop: {entry.drop}' does not go with this place", hint, code="P112")
    for name in ("tumbled", "touching"):
        if entry.drop is not None and getattr(entry, name):
            message = f"'drop' and {name!r} exclude each other: poured items come to rest anywhere"
            check.fault((*loc, name), message, "give one of them", code="P112", key=True)


def check_tote(
    check: DocumentChecker, loc: Location, name: str, bodies: Sequence[Fixture | Bin] | None
) -> None:
    """Whether there is the tote into which items are poured."""
    totes = [str(b.id) for b in bodies or () if isinstance(b, Bin) and b.is_tote]
    if bodies is not None and name not in totes:
        hint = suggest_name(name, totes)
        check.fault((*loc, "into"), f"there is no tote {name!r}", hint, code="P416")


def check_kinds(
    check: DocumentChecker, loc: Location, entry: ItemLoad, catalogue: Mapping[str, CatalogueEntry | None]
) -> None:
    """Check that the catalogue has the kinds of the entry."""
    with check.readable():
        for name in entry.counts:
            if name not in catalogue:
                hint = suggest_name(name, catalogue)
                message = f"the catalogue has no {describe(name)}"
                check.fault((*loc, "of", name), message, hint, code="P410", key=True)


def check_area(
    check: DocumentChecker,
    loc: Location,
    area: Corners,
    bodies: Sequence[Fixture | Bin] | None,
    workspace: Bounds | None,
    rim: float = 0.0,
) -> bool:
    """Whether the area is one at all; faults also when it lies where nothing can be set down or reached.

    `rim`: width about it in which things of a heap may come to lie, m.
    """
    (x0, y0), (x1, y1) = area
    if x1 <= x0 or y1 <= y0:
        message = "the area is empty: 'max' must be greater than 'min' along x and y"
        check.fault((*loc, "area"), message, code="P411")
        return False
    _check_place(check, loc, area, bodies, workspace, rim)
    return True


def _check_place(
    check: DocumentChecker,
    loc: Location,
    area: Corners,
    bodies: Sequence[Fixture | Bin] | None,
    workspace: Bounds | None,
    rim: float,
) -> None:
    (x0, y0), (x1, y1) = area
    x0, y0, x1, y1 = x0 - rim, y0 - rim, x1 + rim, y1 + rim
    points = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)]
    about = f" with its rim of {1000 * rim:g} mm" if rim else ""
    if workspace is not None:
        (wx0, wy0, _), (wx1, wy1, _) = workspace.min, workspace.max
        if any(not (wx0 <= x <= wx1 and wy0 <= y <= wy1) for x, y in points):
            hint = f"which is x {wx0:g} … {wx1:g} m, y {wy0:g} … {wy1:g} m"
            check.fault((*loc, "area"), f"the area{about} is outside the workspace", hint, code="P412")
    # A table that could not be read is not missed a second time.
    if bodies is not None and any(not _covered(bodies, x, y) for x, y in points):
        message = f"the area{about} is not over a level fixture"
        check.fault((*loc, "area"), message, "items need a table below them", code="P413")
        return
    below = next((b for b in bodies or () if isinstance(b, Bin) and _overlaps(b, points)), None)
    if below is not None:
        hint = "move one of them: items are set down on the table, beside bins"
        check.fault((*loc, "area"), f"the area{about} lies over {below.id}", hint, code="P426")


def check_crowding(
    check: DocumentChecker,
    loc: Location,
    entry: ItemLoad,
    area: Corners,
    gap: float,
    catalogue: Mapping[str, CatalogueEntry | None],
) -> None:
    """Whether all items of the entry fit into the area together."""
    (x0, y0), (x1, y1) = area
    outlines = [
        (entry.counts[name], _outline(known.shape, gap, entry.lying))
        for name in entry.counts
        if (known := catalogue.get(name)) is not None
    ]
    if not outlines:
        return
    needed = sum(number * area for number, (area, _) in outlines)
    reach = max(reach for _, (_, reach) in outlines)
    offered = (x1 - x0 + 2 * reach + gap) * (y1 - y0 + 2 * reach + gap)
    if needed > MAX_COVERED_SHARE * offered:
        message = (
            f"{entry.number} items with gaps of {1000 * gap:g} mm do not fit: "
            f"they need {needed:.3f} m², and the area with its rim has {offered:.3f} m²"
        )
        hint = "enlarge the area, or ask for fewer items or smaller gaps"
        check.fault((*loc, "area"), message, hint, code="P414")


def _overlaps(each: Bin, area: Sequence[tuple[float, float]]) -> bool:
    """Return whether a bin is below an area with these corners: no axis of the two separates them."""
    x, y, _ = each.size
    own = [each.pose.apply(np.array([a * x / 2, b * y / 2, 0.0]))[:2] for a in (-1, 1) for b in (-1, 1)]
    across = each.pose.rotation()[:2, :2].T
    for axis in (*across, *np.eye(2)):
        one, other = np.array(own) @ axis, np.array(area) @ axis
        if one.max() <= other.min() + 1e-9 or other.max() <= one.min() + 1e-9:
            return False
    return True


def _covered(bodies: Iterable[Fixture | Bin], x: float, y: float) -> bool:
    for fixture in bodies:
        if isinstance(fixture, Bin):
            continue
        rotation = fixture.pose.rotation()
        if abs(rotation[2, 2]) < 0.999 or not isinstance(fixture.shape, Box):
            continue
        away = rotation.T @ (np.array([x, y, fixture.pose.position[2]]) - fixture.pose.position)
        width, depth, _ = fixture.shape.size
        if abs(away[0]) <= width / 2 + 1e-9 and abs(away[1]) <= depth / 2 + 1e-9:
            return True
    return False


def _outline(shape: Shape, gap: float, lying: float) -> Outline:
    match shape:
        case Sphere(radius):
            return math.pi * (radius + gap / 2) ** 2, radius
        case Cylinder(radius, height):
            upright = math.pi * (radius + gap / 2) ** 2
            flat = (2 * radius + gap) * (height + gap)
            reach = radius if lying == 0 else math.hypot(radius, height / 2)
            return (1 - lying) * upright + lying * flat, reach
        case _:
            spread = np.ptp(corners(shape)[:, :2], axis=0)
            # A hull fills at least half of the rectangle around it.
            share = 1.0 if isinstance(shape, Box) else 0.5
            return share * float(spread[0] + gap) * float(spread[1] + gap), float(np.hypot(*spread)) / 2


MAX_ASSORTMENT_BYTES = 32_000_000
"""Greatest size of all files of an assortment together: each log holds them."""


def check_assortment(check: DocumentChecker, entry: Assortment | None) -> bool:
    """Check the assortment, and return whether there is one."""
    if entry is None:
        return False
    folder = Path(_meshes(check.document, entry.meshes))
    if entry.meshes not in MESH_SETS and not any(folder.glob("*.obj")):
        hint = f"a folder beside this file, or {', '.join(MESH_SETS)}"
        message = f"there are no OBJ files in {entry.meshes!r}"
        check.fault(("assortment", "meshes"), message, hint, code="P409")
    elif entry.meshes not in MESH_SETS:
        size = sum(file.stat().st_size for file in folder.glob("*.obj"))
        if size > MAX_ASSORTMENT_BYTES:
            message = f"the OBJ files in {entry.meshes!r} have {size / 1e6:.0f} MB together"
            hint = f"{MAX_ASSORTMENT_BYTES / 1e6:.0f} MB at most, because each log holds them"
            check.fault(("assortment", "meshes"), message, hint, code="P409")
    return True


def assortment(document: Document, entry: Assortment | None) -> Assortment | None:
    """Return the assortment of a file without faults; None without one."""
    if entry is None:
        return None
    return replace(entry, meshes=_meshes(document, entry.meshes))


def _meshes(document: Document, name: str) -> str:
    """Return the name of a set, or the path of a folder, which counts from the file that names it."""
    if name in MESH_SETS:
        return name
    return str(file_models.path_of(document, ("assortment", "meshes"), name).resolve())


def tote_area(tote: Bin) -> Corners:
    """Return the corners of the area about a tote, which is not turned for it, m."""
    (x, y, _), (wide, deep, _) = tote.pose.position, tote.size
    return (x - wide / 2, y - deep / 2), (x + wide / 2, y + deep / 2)


def spawn(entry: Spawn, bins: Mapping[str, Bin]) -> Spawn:
    """Return a spawn entry without faults, with the area of its tote where it has one."""
    return entry if entry.into is None else replace(entry, area=tote_area(bins[entry.into]))


MIN_BELT_GAP = 0.01
"""Least distance between two items on a belt, m."""
SPACING_SPREAD = 0.25
"""Share of the spacing by which an item may come earlier or later than evenly."""


def check_feed(
    check: DocumentChecker,
    n: int,
    entry: Delivery,
    catalogue: Mapping[str, CatalogueEntry | None],
    bodies: Mapping[str, FixtureFile],
    standing: Sequence[Fixture | Bin] | None,
    workspace: Bounds | None,
    assorted: bool = False,
) -> None:
    """Check one entry; `standing` are the fixtures and bins.

    Faulty kinds count as missing; None means an unreadable part. `assorted`: whether the scene has an
    assortment.
    """
    loc: Location = ("feed", n)
    which = check.one_of(loc, Delivery.one_of)
    poured = which == "into" and assorted
    check_kinds(check, loc, entry, {**catalogue, ASSORTMENT: None} if poured else catalogue)
    with check.readable():
        if which == "area" and entry.area is not None:
            if _has_key(check, loc, "spacing"):
                check.fault((*loc, "spacing"), "only items on a belt have a spacing", code="P112", key=True)
            if check_area(check, loc, entry.area, standing, workspace):
                check_crowding(check, loc, entry, entry.area, entry.gap, catalogue)
    with check.readable():
        if which == "belt" and entry.belt is not None:
            _check_on_belt(check, loc, entry, entry.belt, catalogue, bodies)
    with check.readable():
        if which == "into" and entry.into is not None:
            check_tote(check, loc, entry.into, standing)
            for key in ("gap", "spacing", "tumbled", "when"):
                if _has_key(check, loc, key):
                    hint = "a tote comes full when it is exchanged, and its items lie anywhere"
                    check.fault((*loc, key), "items come with their tote", hint, code="P112", key=True)
    with check.readable():
        if which == "area" and not isinstance(entry.when, WhenClear):
            _check_times(check, loc, entry, entry.when)


def _check_on_belt(
    check: DocumentChecker,
    loc: Location,
    entry: Delivery,
    name: str,
    catalogue: Mapping[str, CatalogueEntry | None],
    bodies: Mapping[str, FixtureFile],
) -> None:
    known = [each for each in bodies if _may_be_belt(check, bodies[each])]
    if name not in known:
        hint = suggest_name(name, known) if known else "a fixture with 'belt'"
        check.fault((*loc, "belt"), f"there is no belt {describe(name)}", hint, code="P420")
    for key in ("gap", "tumbled", "when"):
        with check.readable():
            if _has_key(check, loc, key):
                hint = "a belt runs whenever the robot is ready" if key == "when" else "give its 'spacing'"
                check.fault((*loc, key), "items on a belt come one by one", hint, code="P112", key=True)
    with check.readable():
        size = bodies[name].belt if name in bodies else None
        for kind in entry.counts:
            item = catalogue.get(kind)
            if item is not None and size is not None:
                _check_room(check, loc, entry, kind, item.shape, size[1])
        known_items = [item for kind in entry.counts if (item := catalogue.get(kind)) is not None]
        if size is not None and known_items:
            widest = max(reach(item.shape, entry.lying) for item in known_items)
            _check_barrier(check, name, bodies[name].eye, size[0], widest)


def _check_barrier(
    check: DocumentChecker, name: str, eye: float | None, length: float, widest: float
) -> None:
    """Whether items come to the light barrier from where they are set down."""
    least = -length / 2 + 2 * widest + 2 * MIN_BELT_GAP
    if eye is not None and -length / 2 < eye < least:
        message = "items are set down in the light barrier, or beyond it"
        hint = f"at {math.ceil(100 * least) / 100:g} m or more the items reach the barrier"
        check.fault(("fixtures", name, "eye"), message, hint, code="P421")


def _check_room(
    check: DocumentChecker, loc: Location, entry: Delivery, kind: str, shape: Shape, width: float
) -> None:
    """Whether an item lies on the belt and keeps apart from the next, however it is turned."""
    across = 2 * reach(shape, entry.lying)
    if across > width:
        message = f"a {kind} is {1000 * across:.0f} mm across, and the belt is {1000 * width:g} mm wide"
        check.fault((*loc, "of", kind), message, code="P414", key=True)
    least = (across + MIN_BELT_GAP) / (1 - SPACING_SPREAD)
    if entry.spacing < least:
        given = _has_key(check, loc, "spacing")
        at: Location = (*loc, "spacing") if given else (*loc, "of", kind)
        message = f"items that are {1000 * across:.0f} mm across would touch on the belt"
        hint = f"give a spacing of at least {1000 * math.ceil(1000 * least) / 1000:.0f} mm"
        check.fault(at, message, hint, code="P414", key=not given)


def reach(shape: Shape, lying: float) -> float:
    """Return the greatest distance of a point of the shape from its centre, seen from above, m. `lying`:
    share of the cylinders on their side."""
    match shape:
        case Sphere(radius):
            return radius
        case Cylinder(radius, height):
            return radius if lying == 0 else math.hypot(radius, height / 2)
        case Box((x, y, _)):
            return math.hypot(x, y) / 2
        case _:
            low, high = extents(shape, Pose().rotation())
            return max(math.hypot(x, y) for x in (low[0], high[0]) for y in (low[1], high[1]))


def _check_times(check: DocumentChecker, loc: Location, entry: Delivery, when: When) -> None:
    check.one_of((*loc, "when"), WhenFile.one_of)
    if not isinstance(when, AtTimes):
        return
    for k, (one, other) in enumerate(pairwise(when.times), start=1):
        if other <= one:
            given = check.written((*loc, "when", "at", k), other, "s")
            message = f"{given} does not come after the load before it"
            check.fault((*loc, "when", "at", k), message, "times ascend", code="P422")
            return
    if entry.total is not None and entry.total > entry.number * len(when.times):
        message = f"{entry.total} items do not fit into {len(when.times)} loads of {entry.number}"
        check.fault((*loc, "total"), message, "give more times, or leave the total out", code="P423")


def check_totes(check: DocumentChecker, feed: Sequence[Delivery], *, exchanged: bool) -> None:
    """Check for totes that two entries fill, or that are never exchanged."""
    feeding: dict[str, int] = {}
    for n, entry in enumerate(feed):
        with check.readable():
            if entry.into is None:
                continue
            loc: Location = ("feed", n, "into")
            if entry.into in feeding:
                message = f"feed[{feeding[entry.into]}] comes into the tote {entry.into!r} already"
                check.fault(loc, message, "a full tote has one entry: use a mixture", code="P424")
            elif not exchanged:
                message = f"nobody exchanges the tote {entry.into!r}, so no full one comes"
                check.fault(loc, message, "add 'exchange: {takes: 6 s}'", code="P425", severity="warning")
            feeding.setdefault(entry.into, n)


def check_belts(
    check: DocumentChecker,
    bodies: Mapping[str, FixtureFile],
    feed: Sequence[Delivery],
    workspace: Bounds | None,
) -> None:
    """Check for belts without items or with too many, and for belts that stop out of reach."""
    feeding: dict[str, int] = {}
    for n, entry in enumerate(feed):
        with check.readable():
            if entry.belt is not None and entry.belt in feeding:
                message = f"feed[{feeding[entry.belt]}] comes on the belt {entry.belt!r} already"
                hint = "a belt has one entry: use a mixture"
                check.fault(("feed", n, "belt"), message, hint, code="P424")
            elif entry.belt is not None:
                feeding[entry.belt] = n
    for name, entry in bodies.items():
        with check.readable():
            if entry.belt is None:
                continue
            loc: Location = ("fixtures", name)
            if workspace is not None and entry.eye is not None:
                x, y, _ = (body(name, entry).pose @ Pose((entry.eye, 0.0, 0.0))).position
                (x0, y0, _), (x1, y1, _) = workspace.min, workspace.max
                if not (x0 <= x <= x1 and y0 <= y <= y1):
                    message = f"the belt stops at x {x:.2f} m, y {y:.2f} m, outside of the workspace"
                    hint = f"which is x {x0:g} … {x1:g} m, y {y0:g} … {y1:g} m"
                    check.fault((*loc, "eye"), message, hint, code="P412")
            if not any(_may_feed(check, each, name, bodies) for each in feed):
                message = f"nothing comes on the belt {name!r}"
                hint = f"add an entry to 'feed' with 'belt: {name}'"
                check.fault(loc, message, hint, code="P425", key=True, severity="warning")


def _may_feed(check: DocumentChecker, entry: Delivery, name: str, bodies: Mapping[str, FixtureFile]) -> bool:
    """Whether the entry may feed this belt; True also when its belt is wrong, missing or unreadable."""
    with check.readable():
        if entry.belt is None:
            return entry.area is None and entry.into is None
        return entry.belt == name or entry.belt not in bodies or bodies[entry.belt].belt is None
    return True


def _may_be_belt(check: DocumentChecker, entry: FixtureFile) -> bool:
    with check.readable():
        return entry.belt is not None or (entry.box is None and entry.bin is None and entry.tote is None)
    return True


def belt(name: str, entry: FixtureFile) -> Belt:
    """Return a belt without faults."""
    assert entry.speed is not None and entry.eye is not None
    return Belt(ObjectId(name), entry.speed, entry.eye)


def delivery(entry: Delivery, bodies: Mapping[str, FixtureFile]) -> Delivery:
    """Return an entry of the feed without faults, with the area of its belt or tote, and with its total."""
    area, total = entry.area, entry.total
    if entry.belt is not None:
        area = _top(entry.belt, bodies[entry.belt])
    elif entry.into is not None:
        tote = body(entry.into, bodies[entry.into])
        assert isinstance(tote, Bin)
        area = tote_area(tote)
    if isinstance(entry.when, AtTimes) and total is None:
        total = entry.number * len(entry.when.times)
    return replace(entry, area=area, total=total)


def _top(name: str, entry: FixtureFile) -> Corners:
    """Return the rectangle in the world around a belt's top."""
    fixture = body(name, entry)
    assert isinstance(fixture, Fixture)
    low, high = extents(fixture.shape, fixture.pose.rotation())
    x, y, _ = fixture.pose.position
    return (x + float(low[0]), y + float(low[1])), (x + float(high[0]), y + float(high[1]))


def _has_key(check: DocumentChecker, loc: Location, key: str) -> bool:
    """Return whether an entry has a key; `clear` is the same as no `when`."""
    return check.document.get((*loc, key)) not in (None, "clear")
