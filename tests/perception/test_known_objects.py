"""Known objects in a picture: confirmed near their believed poses, recognised anew where they do not fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import pytest

from picktree.robot.perception import item_fitting
from picktree.robot.perception.item_fitting import ItemFitter
from picktree.robot.perception.segmentation import Blob, label_of
from picktree.robot.perception.view import Detection, PerceivedView
from picktree.world import BeliefObject, Box, ObjectId, Pose

from .perception_pictures import BALL, BLOCK, BRICK, CAN, PLATE, Robot, Thing, standing, view_of

THINGS = [
    standing(shape, 0.36 + 0.07 * n, 0.15 * (-1) ** n, 0.4 * n, "blue", n == 3)
    for n, shape in enumerate((BLOCK, BRICK, PLATE, CAN, BALL))
]
"""One item of each shape, the can lying."""


def believed(things: list[Thing], **changes: object) -> list[BeliefObject]:
    """Beliefs after another picture of the things, with some values changed."""
    seen = view_of(things, seed=3).detections
    return [replace(_belief(n, d), **changes) for n, d in enumerate(seen)]  # type: ignore[arg-type]


def _belief(n: int, d: Detection) -> BeliefObject:
    known = (d.kind, d.form, d.shape, d.colour, d.pose, d.sigma_position, d.sigma_angle, d.confidence, 0.0)
    return BeliefObject(*known, id=ObjectId(f"{d.kind}_{n}"), place=d.place)


class Look(Protocol):
    def __call__(
        self, things: list[Thing], *, known: Sequence[BeliefObject] = (), robot: Robot | None = None
    ) -> tuple[PerceivedView, int]: ...


@pytest.fixture
def look(monkeypatch: pytest.MonkeyPatch) -> Look:
    """A look at things: the view, and how often a blue blob was compared with the whole catalogue for it."""
    counted, explain = [0], ItemFitter.explain

    def counting(self: ItemFitter, blob: Blob, *arguments: object) -> object:
        counted[0] += blob.patch.label == label_of("blue")
        return explain(self, blob, *arguments)  # type: ignore[arg-type]

    def looking(
        things: list[Thing], *, known: Sequence[BeliefObject] = (), robot: Robot | None = None
    ) -> tuple[PerceivedView, int]:
        counted[0] = 0
        return view_of(things, known=known, robot=robot), counted[0]

    monkeypatch.setattr(ItemFitter, "explain", counting)
    return looking


def by_place(detections: tuple[Detection, ...]) -> list[Detection]:
    return sorted(detections, key=lambda d: d.pose.position)


def test_known_objects_are_confirmed_as_precisely_as_they_are_recognised(look: Look) -> None:
    known = believed(THINGS)
    afresh = by_place(view_of(THINGS).detections)
    view, compared = look(THINGS, known=known)
    confirmed = by_place(view.detections)
    assert compared == 0
    assert [d.kind for d in confirmed] == ["block", "brick", "plate", "can", "ball"]
    for one, other in zip(confirmed, afresh, strict=True):
        assert one.kind == other.kind
        assert one.pose.distance(other.pose) < 2e-4
        assert one.sigma_position == pytest.approx(other.sigma_position, rel=0.1)
        assert one.confidence <= max(b.confidence for b in known if b.kind == one.kind)


@pytest.mark.parametrize(
    ("shift", "changes", "as_new"),
    [
        ((0.004, -0.003, 0.0), {}, False),
        ((0.03, 0.0, 0.0), {}, True),
        ((0.0, 0.0, 0.0), {"colour": "red"}, True),
        ((0.0, 0.0, 0.0), {"place": "red_bin"}, True),
    ],
    ids=["a little aside", "far off", "of another colour", "elsewhere"],
)
def test_what_is_not_clearly_the_known_object_is_recognised(
    look: Look, shift: tuple[float, float, float], changes: dict[str, object], as_new: bool
) -> None:
    """The displacement of what is clearly the known object is measured."""
    known = believed([THINGS[0]], **changes)
    there = replace(THINGS[0], pose=THINGS[0].pose.shifted(shift))
    view, compared = look([there], known=known)
    (seen,), (afresh,) = view.detections, view_of([there]).detections
    assert compared == (1 if as_new else 0)
    assert (seen.kind, seen.colour) == ("block", "blue")
    assert seen == afresh if as_new else seen.pose.distance(afresh.pose) < 2e-4


@pytest.mark.parametrize(("share", "recognised"), [(0.3, False), (0.7, True)])
def test_a_known_object_is_confirmed_while_most_of_it_is_in_sight(
    look: Look, share: float, recognised: bool
) -> None:
    known = believed([THINGS[0]])
    x, y, z = THINGS[0].pose.position
    lid = Thing(Box((0.04, 0.06, 0.01)), Pose((x + 0.04 * (1.0 - share), y, z + 0.04)), "red")
    view, compared = look([THINGS[0], lid], known=known)
    assert (compared > 0) is recognised
    if not recognised:
        (seen,) = (d for d in view.detections if d.colour == "blue")
        assert seen.kind == "block"
        assert seen.pose.distance(known[0].pose) < 2e-3


def test_another_item_at_the_place_of_a_known_one_is_recognised_for_what_it_is() -> None:
    known = believed([THINGS[0]])
    x, y, _ = THINGS[0].pose.position
    for shape, kind in ((CAN, "can"), (BALL, "ball"), (BRICK, "brick"), (PLATE, "plate")):
        other = standing(shape, x, y, 0.2, "blue")
        (seen,) = view_of([other], known=known).detections
        assert seen.kind == kind
        assert seen == view_of([other]).detections[0]


LEANING = replace(THINGS[1], pose=THINGS[1].pose @ Pose.from_rpy((0, 0, 0.006), (0.0, 0.3, 0.0)))
TILTED = Thing(CAN, Pose.from_rpy((0.45, 0.0, 0.035), (0.0, 0.7, 0.0)), "blue")


@pytest.mark.parametrize(
    ("leaning", "changes"),
    [(LEANING, {"place": "aside", "confidence": 0.9}), (LEANING, {}), (TILTED, {"place": "aside"})],
    ids=["aside", "uncertain", "a can aside"],
)
def test_of_an_uncertain_item_only_the_place_is_asked(
    look: Look, leaning: Thing, changes: dict[str, object]
) -> None:
    """It leans, so that no stable pose fits it well, and each picture would start a whole search for it."""
    known = believed([leaning], **changes)
    view, compared = look([leaning], known=known)
    (seen,) = view.detections
    assert compared == 0
    assert (seen.kind, seen.place) == (known[0].kind, "table")
    assert seen.pose.distance(known[0].pose) < 2e-3
    assert seen.confidence <= known[0].confidence


def test_what_comes_to_touch_an_item_that_was_set_aside_is_seen() -> None:
    plate, ball = standing(PLATE, 0.45, 0.0, 0.8, "blue"), standing(BALL, 0.45, 0.045, 0.0, "blue")
    known = believed([plate], place="aside")
    assert sorted(d.kind for d in view_of([plate, ball], known=known).detections) == ["ball", "plate"]


TOUCHING = [
    standing(CAN, 0.45, 0.0, 0.0, "blue", True),
    standing(BRICK, 0.45, 0.052, 0.3, "blue"),
    standing(BALL, 0.55, -0.2, 0.0, "blue"),
]
"""Two items of one colour whose pixels are one patch, and one elsewhere."""


def assert_seen(look: Look, things: list[Thing], known: list[BeliefObject], comparisons: int) -> None:
    """Assert that these can, brick and ball are recognised where they are, with so many comparisons."""
    view, compared = look(things, known=known)
    seen = by_place(view.detections)
    assert [d.kind for d in seen] == ["can", "brick", "ball"]
    for one, thing in zip(seen, things, strict=True):
        assert math.dist(one.pose.position, thing.pose.position) < 2e-3
    assert compared == comparisons


@pytest.mark.parametrize(
    "changes", [{"place": "aside", "confidence": 0.2}, {"confidence": 0.9}], ids=["aside", "certain"]
)
def test_items_that_touch_are_confirmed_together(look: Look, changes: dict[str, object]) -> None:
    """Each picture would search through cuts of their patch for what is believed already."""
    known = believed(TOUCHING, **changes)
    assert sorted(b.kind for b in known) == ["ball", "brick", "can"]
    assert look(TOUCHING)[1] > 3  # one patch, which was cut
    assert_seen(look, TOUCHING, known, 0)


@pytest.mark.parametrize("changes", [{"place": "aside"}, {"confidence": 0.9}], ids=["aside", "certain"])
@pytest.mark.parametrize("new", ["can", "brick"])
def test_what_touches_a_known_item_is_recognised_by_itself(
    look: Look, changes: dict[str, object], new: str
) -> None:
    """The known item is taken out of their patch: what is left of that is one item, and nothing is cut."""
    known = [one for one in believed(TOUCHING, **changes) if one.kind != new]
    assert_seen(look, TOUCHING, known, 1)


def test_an_item_that_has_moved_is_recognised_anew_beside_one_that_has_not(look: Look) -> None:
    can, brick, ball = TOUCHING
    moved = [can, replace(brick, pose=brick.pose.shifted((0.02, 0.0, 0.0))), ball]
    assert_seen(look, moved, believed(TOUCHING, place="aside"), 1)


def test_items_stay_known_beside_another_than_was_there(look: Look) -> None:
    """What is new among them is looked for by itself, not among the pixels of those that fit."""
    brick, can = standing(BRICK, 0.45, 0.0, 0.0, "blue"), standing(CAN, 0.45, 0.036, 0.0, "blue", True)
    block, plate = standing(BLOCK, 0.45, 0.077, 0.0, "blue"), standing(PLATE, 0.45, 0.083, 0.785, "blue")
    known = [belief for thing in (brick, can, block) for belief in believed([thing], confidence=0.9)]
    view, compared = look([brick, can, plate], known=known)
    assert {d.kind for d in view.detections} == {"brick", "can", "plate"}
    assert compared < 10


def test_where_items_were_set_aside_no_more_than_these_are_searched_for(look: Look) -> None:
    """As long as they lie there askew, each picture would try to cut them into ever more parts."""
    bricks = [standing(BRICK, 0.45, 0.0, 0.3, "blue"), standing(BRICK, 0.45, 0.04, 0.9, "blue")]
    heap = [
        replace(brick, pose=brick.pose @ Pose.from_rpy((0.0, 0.0, 0.008), (0.4, tilt, 0.0)))
        for brick, tilt in zip(bricks, (0.4, -0.4), strict=True)
    ]
    known = believed(TOUCHING[:2], place="aside")
    assert look(heap, known=known)[1] < look(heap)[1] / 3


def askew(bricks: list[Thing], x: float = 0.0) -> list[Thing]:
    """Two touching bricks, tilted so far that nothing fits them, `x` m further from the robot."""
    return [
        replace(brick, pose=brick.pose @ Pose.from_rpy((x, 0.0, 0.004), (tilt, 0.0, 0.0)))
        for brick, tilt in zip(bricks, (0.35, -0.35), strict=True)
    ]


BRICKS = [standing(BRICK, 0.45, 0.0, 0.0, "blue"), standing(BRICK, 0.45, 0.041, 0.0, "blue")]


def test_what_shows_only_items_that_were_set_aside_is_not_split(look: Look) -> None:
    known = believed(BRICKS, place="aside")
    assert [one.kind for one in known] == ["brick", "brick"]
    seen, compared = look(askew(BRICKS), known=known)
    assert (compared, len(seen.unexplained)) == (1, 1)


def test_what_the_picture_s_border_cuts_through_is_not_split(look: Look) -> None:
    """A fixed camera would show it in each picture."""
    assert look(askew(BRICKS, 0.49))[1] > 10
    seen, compared = look(askew(BRICKS, 0.52))
    assert (compared, len(seen.unexplained)) == (1, 1)


def test_what_the_robot_hides_in_part_is_not_split(look: Look) -> None:
    """The arm passes before touching items again and again."""
    hand = Robot(Box((0.1, 0.1, 0.02)), Pose((0.45, -0.07, 0.2)))
    bricks = [*askew(BRICKS), Thing(hand.box, hand.pose, "white")]
    assert look(bricks)[1] > 10
    seen, compared = look(bricks, robot=hand)
    assert compared == 1
    assert seen.detections == () and seen.unexplained == ()


def test_a_larger_item_at_the_place_of_a_known_one_is_not_cut_up() -> None:
    known = believed([standing(BLOCK, 0.45, 0.0, 0.0, "blue")], place="aside")
    for shape in (BRICK, PLATE, Box((0.09, 0.09, 0.04)), Box((0.12, 0.08, 0.04))):
        thing = standing(shape, 0.48, 0.03, 0.0, "blue")
        assert view_of([thing], known=known).detections == view_of([thing]).detections


def test_a_cut_is_given_up_when_its_parts_cannot_fit_well_enough(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    thing = standing(Box((0.06, 0.06, 0.055)), 0.45, 0.0, 0.3, "blue")
    seen, few = look([thing])
    monkeypatch.setattr(item_fitting, "MAX_REFINEMENT", math.inf)
    all_cuts, many = look([thing])
    assert all_cuts.detections == seen.detections
    assert few < many
