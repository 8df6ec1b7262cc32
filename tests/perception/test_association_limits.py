"""How near is the same: each limit of the association from both sides, with detections made up for it."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import pytest

from picktree.robot.perception import ObservationSummary, update_belief
from picktree.robot.perception.view import Detection, PerceivedView, UnexplainedPatch
from picktree.world import FALLEN_SIGMA, BeliefObject, Box, ObjectId, PlanningScene, Pose

from .perception_pictures import BLOCK, BRICK, Thing, empty_scene, standing, view_of

OUT_OF_VIEW = (3.0, 0.0, 0.02)
ON_THE_TABLE = (0.5, 0.0, 0.02)
IN_THE_BIN = (0.4, 0.4, 0.025)


@cache
def empty_table() -> PerceivedView:
    return view_of([])


@cache
def a_red_block() -> PerceivedView:
    return view_of([standing(BLOCK, 0.45, -0.1, 0.2, "red")])


def believed(
    at: tuple[float, float, float] = OUT_OF_VIEW,
    *,
    sigma: float = 0.0,
    place: str = "table",
    name: str = "red_block_1",
    confidence: float = 0.9,
) -> BeliefObject:
    known = ("block", "box", BLOCK, "red", Pose(at), sigma, 0.01, confidence, 0.0)
    return BeliefObject(*known, id=ObjectId(name), place=place)


def detected(
    at: tuple[float, float, float],
    by: float,
    *,
    kind: str = "block",
    confidence: float = 0.9,
    place: str = "table",
    colour: str = "red",
) -> Detection:
    """A detection that is `by` m away from a point, along y."""
    x, y, z = at
    shape = BLOCK if kind == "block" else BRICK
    return Detection(
        kind, "box", shape, colour, Pose((x, y + by, z)), 0.001, 0.01, confidence, math.pi / 2, place
    )  # fmt: skip


def after(
    scene: PlanningScene,
    *detections: Detection,
    unexplained: tuple[UnexplainedPatch, ...] = (),
    now: float = 2.0,
) -> ObservationSummary:
    view = replace(empty_table(), detections=detections, unexplained=unexplained)
    return update_belief(scene, view, now)


def scene_of(*objects: BeliefObject) -> PlanningScene:
    scene = empty_scene()
    for one in objects:
        scene.put(one, "told")
        scene.new_id(one.id.rpartition("_")[0])
    return scene


def taken(item: BeliefObject, detection: Detection) -> bool:
    """Whether the one detection is taken for the one item."""
    scene = scene_of(item)
    summary = after(scene, detection)
    same = summary.seen == (item.id,)
    assert same or item.id in summary.hidden
    assert same is (scene.get(item.id).last_seen == 2.0)
    return same


@pytest.mark.parametrize(
    ("sigma", "place", "now", "reach"),
    [
        (0.0, "table", "table", 0.04),
        (0.005, "table", "table", 0.055),
        (0.01, "table", "table", 0.07),
        (0.03, "table", "table", 0.13),
        (0.05, "table", "table", 0.13),
        (0.0, "red_bin", "red_bin", 0.1),
        (0.0, "table", "red_bin", 0.04),
        (0.0, "blue_bin", "red_bin", 0.04),
    ],
)
def test_an_item_is_taken_for_itself_near_where_it_was(
    sigma: float, place: str, now: str, reach: float
) -> None:
    """4 cm, and three standard deviations of where it was believed to be, of at most 3 cm; in a bin 10 cm."""
    item = believed(sigma=sigma, place=place)
    assert taken(item, detected(OUT_OF_VIEW, reach - 1e-9, place=now))
    assert not taken(item, detected(OUT_OF_VIEW, reach + (1e-9 if sigma else 0.0), place=now))


def test_of_another_colour_it_is_another_item_wherever_it_is() -> None:
    assert not taken(believed(), detected(OUT_OF_VIEW, 0.001, colour="blue"))


def test_another_kind_is_worth_two_centimetres() -> None:
    item = believed()
    alike = detected(OUT_OF_VIEW, 0.03)
    for by, kind in ((-0.005, "brick"), (-0.015, "block")):
        scene = scene_of(item)
        after(scene, detected(OUT_OF_VIEW, by, kind="brick"), alike)
        assert scene.get(item.id).kind == kind
        assert len(scene.objects) == 2


def test_the_nearest_pairs_in_all_are_made() -> None:
    """Not the nearest one first: it would leave a far one to the other."""
    one, other = believed(), believed((3.0, 0.03, 0.02), name="red_block_2")
    scene = scene_of(one, other)
    summary = after(scene, detected(OUT_OF_VIEW, 0.02), detected(OUT_OF_VIEW, -0.03))
    assert summary.new == ()
    assert scene.get("red_block_1").pose.position[1] == pytest.approx(-0.03)
    assert scene.get("red_block_2").pose.position[1] == pytest.approx(0.02)


def test_what_left_its_place_is_looked_for_within_half_a_metre() -> None:
    for other, seen_as in (
        (detected(ON_THE_TABLE, 0.49), "red_block_1"),
        (detected(ON_THE_TABLE, 0.5), "red_block_2"),
        (detected(ON_THE_TABLE, 0.3, kind="brick"), "red_brick_1"),
        (detected(ON_THE_TABLE, 0.3, colour="blue"), "blue_block_1"),
    ):
        scene = scene_of(believed(ON_THE_TABLE))
        summary = after(scene, other)
        assert [o.id for o in scene.objects] == [seen_as]
        assert summary.removed == (() if seen_as == "red_block_1" else ("red_block_1",))


def test_what_is_seen_worse_than_before_is_believed_as_before() -> None:
    """With less than 0.8 of the former confidence, and only where the view bears the former out."""
    view = a_red_block()
    (seen,) = view.detections
    for confidence, kept in ((0.4, False), (math.nextafter(0.4, 0.0), True)):
        item = replace(believed(seen.pose.position, confidence=0.5), place="aside", sigma_angle=0.2)
        scene = scene_of(item)
        at = seen.pose.shifted((0.004, 0.0, 0.0))
        worse = replace(seen, kind="brick", pose=at, confidence=confidence, sigma_angle=0.3)
        update_belief(scene, replace(view, detections=(worse,)), 7.0)
        wanted = (
            item
            if kept
            else replace(
                item,
                kind="brick",
                pose=at,
                confidence=0.4,
                sigma_angle=0.3,
                sigma_position=seen.sigma_position,
            )
        )
        now = scene.get(item.id)
        assert (now.last_seen, now.place, now.kind) == (7.0, "aside", wanted.kind)
        assert (now.pose.position, now.confidence) == (wanted.pose.position, wanted.confidence)
        assert (now.sigma_angle, now.sigma_position) == (wanted.sigma_angle, wanted.sigma_position)
    # Place and pose go together: what is kept in a hole does not lie on the table.
    for confidence, place in ((0.4, "table"), (0.3, "board/square")):
        scene = scene_of(replace(believed(seen.pose.position, confidence=0.5), place="board/square"))
        update_belief(scene, replace(view, detections=(replace(seen, confidence=confidence),)), 7.0)
        assert scene.objects[0].place == place
    # The place is seen empty: the worse look is all that there is.
    scene = scene_of(believed(ON_THE_TABLE, confidence=0.9))
    after(scene, detected(ON_THE_TABLE, 0.02, confidence=0.2))
    assert scene.get("red_block_1").confidence == 0.2


def test_what_is_seen_at_the_hand_in_the_colour_of_what_it_holds_is_that() -> None:
    """What is held is neither matched nor seen missing."""
    held = replace(believed(ON_THE_TABLE), object_in_tcp=Pose(), place="hand")
    for by, colour, new in (
        (0.059, "red", ()),
        (0.06, "red", ("red_block_2",)),
        (0.0, "blue", ("blue_block_1",)),
    ):
        scene = scene_of(held)
        summary = after(scene, detected(ON_THE_TABLE, by, colour=colour))
        assert summary == ObservationSummary(new, new, (), (), 0)
        assert scene.held == held


def test_what_was_held_elsewhere_when_the_picture_was_taken_is_looked_for_there() -> None:
    there = (0.7, 0.2, 0.3)
    scene = scene_of(replace(believed(ON_THE_TABLE), object_in_tcp=Pose(), place="hand"))
    view = replace(empty_table(), detections=(detected(there, 0.02),))
    assert update_belief(scene, view, 2.0, held_at=Pose(there)).new == ()
    scene = scene_of(replace(believed(ON_THE_TABLE), object_in_tcp=Pose(), place="hand"))
    assert len(update_belief(scene, view, 2.0).new) == 1
    assert scene.held is not None and scene.held.pose.position == ON_THE_TABLE


def test_of_another_colour_a_doubtful_look_is_something_new() -> None:
    scene = scene_of(believed())
    assert after(scene, detected(OUT_OF_VIEW, 0.05, colour="blue", confidence=0.3)).new == ("blue_block_1",)


def test_what_is_given_up_stays_so_where_it_lay() -> None:
    for sigma, by, place in (
        (0.0, 0.039, "aside"),
        (0.01, 0.069, "aside"),
        (0.05, 0.129, "aside"),
        (0.0, 0.04, "table"),
        (0.0, 0.041, "table"),
        (0.01, 0.071, "table"),
        (0.05, 0.131, "table"),
    ):
        scene = scene_of(believed(ON_THE_TABLE, sigma=sigma, place="aside"))
        after(scene, detected(ON_THE_TABLE, by))
        assert scene.get("red_block_1").place == place, (sigma, by)
    scene = scene_of(believed(place="aside"))
    after(scene, detected(OUT_OF_VIEW, 0.01, place="red_bin"))
    assert scene.get("red_block_1").place == "red_bin"


@pytest.mark.parametrize(
    ("sigma", "place", "now", "gone"),
    [
        (FALLEN_SIGMA, "aside", 60.1, True),
        (FALLEN_SIGMA, "aside", 59.9, False),
        (FALLEN_SIGMA, "red_bin", 60.1, False),
        (0.012, "aside", 60.1, False),
        (0.5, "aside", 60.1, False),
    ],
)
def test_what_is_given_up_where_nobody_saw_it_fall_is_believed_for_a_minute(
    sigma: float, place: str, now: float, gone: bool
) -> None:
    """Else what falls there later would be taken for it, and given up untried."""
    scene = scene_of(believed(sigma=sigma, place=place))
    assert after(scene, now=now).removed == (("red_block_1",) if gone else ())
    assert (scene.find(ObjectId("red_block_1")) is None) is gone
    found = scene_of(believed(sigma=sigma, place=place))
    assert after(found, detected(OUT_OF_VIEW, 0.01), now=now).seen == ("red_block_1",)


def unrecognised(*things: Thing) -> PerceivedView:
    """A view whose one patch shows grey things, as if they were red. All else is masked, so that nothing is
    seen missing."""
    view = view_of(things)
    (patch,) = view.unexplained
    return replace(view, blocked=view.blocked | True, unexplained=(replace(patch, colour="red"),))


@pytest.mark.parametrize(
    ("held", "sigma", "reach"),
    [(False, 0.0, 0.04), (False, 0.01, 0.07), (False, 0.05, 0.13), (True, 0.0, 0.06)],
)
def test_a_patch_near_something_unrecognised_of_its_colour_is_no_obstacle(
    held: bool, sigma: float, reach: float
) -> None:
    """Its points are as near to the item's body as a detection would have to be to the item."""
    view = unrecognised(standing(BLOCK, 0.5, 0.0, 0.0, "grey"))
    for by, colour, obstacles in ((reach, "red", 0), (reach + 0.01, "red", 1), (0.0, "blue", 1)):
        item = replace(believed((0.5, by, 0.02), sigma=sigma), colour=colour)
        scene = scene_of(replace(item, object_in_tcp=Pose()) if held else item)
        assert update_belief(scene, view, 2.0).unexplained == obstacles, (by, colour)


def test_a_tall_thing_is_an_obstacle_though_an_item_of_its_colour_is_hidden() -> None:
    """A post is neither a block in the bin nor one beside it or below it, however tall the post is."""
    view = unrecognised(standing(Box((0.07, 0.07, 0.3)), 0.5, 0.15, 0.3, "grey"))
    for at, place in ((IN_THE_BIN, "red_bin"), ((0.5, 0.15, 0.02), "table"), ((0.5, 0.09, 0.02), "table")):
        scene = scene_of(believed(at, place=place))
        assert update_belief(scene, view, 2.0).unexplained == 1, at
        assert [o.role for o in scene.objects] == ["item", "obstacle"], at


def test_a_patch_of_two_unrecognised_items_is_no_obstacle() -> None:
    view = unrecognised(standing(Box((0.04, 0.16, 0.04)), 0.5, 0.0, 0.0, "grey"))
    items = [believed((0.5, y, 0.02), name=f"red_block_{n}") for n, y in ((1, -0.06), (2, 0.06))]
    assert update_belief(scene_of(*items), view, 2.0).unexplained == 0
    for one in items:
        assert update_belief(scene_of(one), view, 2.0).unexplained == 1


def test_a_doubtful_look_near_something_hidden_makes_no_new_item() -> None:
    """On the table 0.6 is enough; in a bin nothing is unless it is far from all that is hidden there."""
    for confidence, place, by, new in (
        (0.6, "table", 0.05, True),
        (0.9, "table", 0.05, True),
        (math.nextafter(0.6, 0.0), "table", 0.05, False),
        (0.6, "red_bin", 0.2, True),
        (math.nextafter(0.6, 0.0), "red_bin", 0.2, False),
        (0.9, "red_bin", 0.1, True),
        (0.9, "red_bin", math.nextafter(0.1, 0.0), False),
        (0.5, "table", 0.08, True),
        (0.5, "table", math.nextafter(0.08, 0.0), False),
    ):
        scene = scene_of(believed((0.0, 0.0, 0.02)))
        doubtful = detected((0.0, 0.0, 0.02), by, kind="brick", confidence=confidence, place=place)
        summary = update_belief(scene, replace(hidden_table(), detections=(doubtful,)), 2.0)
        assert (len(summary.new) == 1) is new, (confidence, place, by)
        assert summary.hidden == ("red_block_1",)


@cache
def hidden_table() -> PerceivedView:
    """Nothing is seen missing: all of it is masked."""
    view = empty_table()
    return replace(view, blocked=view.blocked | True)


def test_what_the_view_changed_is_told() -> None:
    """Known ones in the order of the belief, then new ones; what is hidden; and how many obstacles."""
    (patch,) = view_of([standing(Box((0.1, 0.08, 0.1)), 0.5, -0.15, 0.0, "grey")]).unexplained
    scene = scene_of(
        believed((3.0, 0.0, 0.02)),
        believed((3.0, 1.0, 0.02), name="red_block_2"),
        believed(ON_THE_TABLE, name="red_block_3"),
        replace(believed((3.0, 2.0, 0.02), name="red_block_4"), colour="green"),
    )
    summary = after(
        scene,
        detected((3.0, 1.0, 0.02), 0.01),
        detected((3.0, 3.0, 0.02), 0.0, colour="blue"),
        detected((3.0, 0.0, 0.02), 0.01),
        unexplained=(patch,),
    )
    assert summary == ObservationSummary(
        ("red_block_1", "red_block_2", "blue_block_1"),
        ("blue_block_1",),
        ("red_block_3",),
        ("red_block_4",),
        1,
    )
    reasons = [(str((c.after or c.before).id), c.reason) for c in scene.take_changes()][-6:]  # type: ignore[union-attr]  # pyright: ignore[reportOptionalMemberAccess]
    assert ("red_block_3", "its place was seen empty") in reasons
    assert ("blue_block_1", "seen for the first time") in reasons
    assert ("red_block_1", "seen") in reasons
    new = scene.get("blue_block_1")
    assert (new.last_seen, new.confidence, new.sigma_position, new.sigma_angle) == (2.0, 0.9, 0.001, 0.01)


@pytest.mark.parametrize(
    ("turn", "before", "believes"),
    [(90, 100, 100), (90, 50, 10), (180, 100, 10), (180, 101, 190), (120, 290, 250), (0, 190, 10)],
)
def test_of_headings_that_look_the_same_the_nearest_to_the_former_is_believed(
    turn: float, before: float, believes: float
) -> None:
    """In degrees; it is seen at 10°."""
    scene = scene_of(replace(believed(), pose=heading(OUT_OF_VIEW, before)))
    pose = heading((3.0, 0.02, 0.02), 10.0)
    after(scene, replace(detected(OUT_OF_VIEW, 0.0), pose=pose, turn=math.radians(turn)))
    now = scene.get("red_block_1").pose
    assert now.position == pose.position
    assert now.rotation() == pytest.approx(heading(OUT_OF_VIEW, believes).rotation(), abs=1e-9)


def heading(at: tuple[float, float, float], degrees: float) -> Pose:
    return Pose.from_rpy(at, (0.0, 0.0, math.radians(degrees)))
