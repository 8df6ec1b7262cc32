"""Feed entries of scene files: checks that need several values, and conversion to values of the scene."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

from ...files.marks import Location
from ...files.value_wording import describe, suggest_name
from ...files.yaml.document_checker import DocumentChecker
from ..shapes import Box, Cylinder, Shape, Sphere, extents
from ..values import Bounds, ObjectId, Pose
from .body_schema import FixtureFile
from .description import (
    ASSORTMENT,
    AtIntervals,
    AtTimes,
    Belt,
    Bin,
    CatalogueEntry,
    Delivery,
    Fixture,
    Spawn,
    When,
    WhenClear,
)
from .scene_entries import body
from .scene_schema import FeedFile, WhenFile
from .spawn_areas import check_area, check_crowding, check_kinds, check_tote, tote_area

DEFAULT_GAP = 0.025
DEFAULT_SPACING = 0.15
MIN_BELT_GAP = 0.01
"""Least distance between two items on a belt, m."""
SPACING_SPREAD = 0.25
"""Share of the spacing by which an item may come earlier or later than evenly."""


def check_feed(
    check: DocumentChecker,
    n: int,
    entry: FeedFile,
    catalogue: Mapping[str, CatalogueEntry | None],
    bodies: Mapping[str, FixtureFile],
    standing: Sequence[Fixture | Bin] | None,
    workspace: Bounds | None,
    assorted: bool = False,
) -> None:
    """Faults of one entry; `standing` are the fixtures and bins.

    Faulty kinds count as none; None stands for what could not be read. `assorted`: whether the scene has an
    assortment.
    """
    loc: Location = ("feed", n)
    which = check.one_of(loc, FeedFile.one_of)
    poured = which == "into" and assorted
    check_kinds(check, loc, entry, {**catalogue, ASSORTMENT: None} if poured else catalogue)
    with check.readable():
        if which == "area" and entry.area is not None:
            if entry.spacing is not None:
                check.fault((*loc, "spacing"), "only items on a belt have a spacing", code="P112", key=True)
            if check_area(check, loc, entry.area, standing, workspace):
                check_crowding(check, loc, entry, entry.area, _gap(entry), catalogue)
    with check.readable():
        if which == "belt" and entry.belt is not None:
            _check_on_belt(check, loc, entry, entry.belt, catalogue, bodies)
    with check.readable():
        if which == "into" and entry.into is not None:
            check_tote(check, loc, entry.into, standing)
            for key in ("gap", "spacing", "tumbled", "when"):
                if getattr(entry, key) is not None:
                    hint = "a tote comes full when it is exchanged, and its items lie anywhere"
                    check.fault((*loc, key), "items come with their tote", hint, code="P112", key=True)
    with check.readable():
        if which == "area" and entry.when is not None:
            _check_times(check, loc, entry, entry.when)


def _check_on_belt(
    check: DocumentChecker,
    loc: Location,
    entry: FeedFile,
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
            if getattr(entry, key) is not None:
                hint = "a belt runs whenever the robot is ready" if key == "when" else "give its 'spacing'"
                check.fault((*loc, key), "items on a belt come one by one", hint, code="P112", key=True)
    with check.readable():
        size = bodies[name].belt if name in bodies else None
        for kind in entry.of:
            item = catalogue.get(kind)
            if item is not None and size is not None:
                _check_room(check, loc, entry, kind, item.shape, size[1])
        known_items = [item for kind in entry.of if (item := catalogue.get(kind)) is not None]
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
        hint = f"at {math.ceil(100 * least) / 100:g} m or more they come to it"
        check.fault(("fixtures", name, "eye"), message, hint, code="P421")


def _check_room(
    check: DocumentChecker, loc: Location, entry: FeedFile, kind: str, shape: Shape, width: float
) -> None:
    """Whether an item lies on the belt and keeps apart from the next, however it is turned."""
    across = 2 * reach(shape, entry.lying)
    if across > width:
        message = f"a {kind} is {1000 * across:.0f} mm across, and the belt is {1000 * width:g} mm wide"
        check.fault((*loc, "of", kind), message, code="P414", key=True)
    least = (across + MIN_BELT_GAP) / (1 - SPACING_SPREAD)
    spacing = DEFAULT_SPACING if entry.spacing is None else entry.spacing
    if spacing < least:
        at: Location = (*loc, "spacing") if entry.spacing is not None else (*loc, "of", kind)
        message = f"items that are {1000 * across:.0f} mm across would touch on the belt"
        hint = f"a spacing of at least {1000 * math.ceil(1000 * least) / 1000:.0f} mm"
        check.fault(at, message, hint, code="P414", key=entry.spacing is None)


def reach(shape: Shape, lying: float) -> float:
    """Greatest distance of a point of the shape from its centre as seen from above, m; `lying` is the share
    of the cylinders that lie."""
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


def _check_times(check: DocumentChecker, loc: Location, entry: FeedFile, when: WhenFile) -> None:
    check.one_of((*loc, "when"), WhenFile.one_of)
    if when.at is None:
        return
    for k, (one, other) in enumerate(pairwise(when.at), start=1):
        if other <= one:
            given = check.written((*loc, "when", "at", k), other, "s")
            message = f"{given} does not come after the load before it"
            check.fault((*loc, "when", "at", k), message, "times ascend", code="P422")
            return
    each = sum(entry.of.values())
    if entry.total is not None and entry.total > each * len(when.at):
        message = f"{entry.total} items do not come in {len(when.at)} loads of {each}"
        check.fault((*loc, "total"), message, "give more times, or leave the total out", code="P423")


def check_totes(check: DocumentChecker, feed: Sequence[FeedFile], *, exchanged: bool) -> None:
    """Totes into which two entries come, or that nobody exchanges."""
    feeding: dict[str, int] = {}
    for n, entry in enumerate(feed):
        with check.readable():
            if entry.into is None:
                continue
            loc: Location = ("feed", n, "into")
            if entry.into in feeding:
                message = f"feed[{feeding[entry.into]}] comes into the tote {entry.into!r} already"
                check.fault(loc, message, "one entry says what a full tote holds: a mixture", code="P424")
            elif not exchanged:
                message = f"nobody exchanges the tote {entry.into!r}, so no full one comes"
                check.fault(loc, message, "add 'exchange: {takes: 6 s}'", code="P425", severity="warning")
            feeding.setdefault(entry.into, n)


def check_belts(
    check: DocumentChecker,
    bodies: Mapping[str, FixtureFile],
    feed: Sequence[FeedFile],
    workspace: Bounds | None,
) -> None:
    """Belts to which nothing comes or too much, or that stop where no arm reaches."""
    feeding: dict[str, int] = {}
    for n, entry in enumerate(feed):
        with check.readable():
            if entry.belt is not None and entry.belt in feeding:
                message = f"feed[{feeding[entry.belt]}] comes on the belt {entry.belt!r} already"
                hint = "one entry says what comes on a belt: a mixture"
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
                hint = f"an entry of 'feed' with 'belt: {name}'"
                check.fault(loc, message, hint, code="P425", key=True, severity="warning")


def _may_feed(check: DocumentChecker, entry: FeedFile, name: str, bodies: Mapping[str, FixtureFile]) -> bool:
    """Also one in which the belt's name is wrong, missing or cannot be read."""
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
    """A belt without faults."""
    assert entry.speed is not None and entry.eye is not None
    return Belt(ObjectId(name), entry.speed, entry.eye)


def delivery(entry: FeedFile, bodies: Mapping[str, FixtureFile]) -> Delivery:
    """An entry of the feed without faults."""
    if entry.belt is not None:
        area = _top(entry.belt, bodies[entry.belt])
    elif entry.into is not None:
        tote = body(entry.into, bodies[entry.into])
        assert isinstance(tote, Bin)
        area = tote_area(tote)
    else:
        assert entry.area is not None
        area = (entry.area.min, entry.area.max)
    load = Spawn(
        counts=tuple(entry.of.items()),
        colours=entry.colours,
        area=area,
        gap=_gap(entry),
        lying=entry.lying,
        tumbled=bool(entry.tumbled),
        into=None if entry.into is None else ObjectId(entry.into),
        drop=None if entry.into is None else "heap",
    )
    when = _when(entry.when)
    total = entry.total
    if isinstance(when, AtTimes) and total is None:
        total = sum(entry.of.values()) * len(when.times)
    return Delivery(
        load=load,
        when=when,
        total=total,
        belt=ObjectId(entry.belt) if entry.belt is not None else None,
        spacing=DEFAULT_SPACING if entry.spacing is None else entry.spacing,
    )


def _top(name: str, entry: FixtureFile) -> tuple[tuple[float, float], tuple[float, float]]:
    """The rectangle in the world around a belt's top."""
    fixture = body(name, entry)
    assert isinstance(fixture, Fixture)
    low, high = extents(fixture.shape, fixture.pose.rotation())
    x, y, _ = fixture.pose.position
    return (x + float(low[0]), y + float(low[1])), (x + float(high[0]), y + float(high[1]))


def _when(when: WhenFile | None) -> When:
    if when is None:
        return WhenClear()
    if when.every is not None:
        return AtIntervals(when.every)
    assert when.at is not None
    return AtTimes(when.at)


def _gap(entry: FeedFile) -> float:
    return DEFAULT_GAP if entry.gap is None else entry.gap
