"""Where the belief puts what was let go, rode on, or went with its bin: each limit from both sides."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from picktree.robot.manipulation.bin_belief import apply_bin_exchanges, forget_belt_items
from picktree.robot.manipulation.held_object import open_gripper, release_object, support_height_at
from picktree.world import BeliefObject, Box, Cylinder, Journal, JournalEvent, ObjectId, PlanningScene, Pose
from picktree.world.scene import Bin, Fixture
from picktree.world.world_facts import AttemptMemory

if TYPE_CHECKING:
    from picktree.robot import World

TABLE = Fixture(ObjectId("table"), Box((1.0, 0.8, 0.04)), Pose((0.5, 0.0, -0.02)))
SHELF = Fixture(ObjectId("shelf"), Box((0.2, 0.3, 0.1)), Pose((0.8, 0.2, 0.05)))
PIT = Fixture(ObjectId("pit"), Box((0.2, 0.2, 0.02)), Pose((2.0, 0.0, -0.3)))
POST = Fixture(ObjectId("post"), Cylinder(0.1, 0.5), Pose((0.5, 0.0, 0.25)))
BIN = Bin(ObjectId("red_bin"), (0.2, 0.3, 0.1), 0.005, Pose((0.3, -0.2, 0.01)))
BELT = Fixture(ObjectId("belt"), Box((0.6, 0.2, 0.05)), Pose((0.0, 0.7, 0.1)))


def item(
    name: str, at: tuple[float, float, float], *, place: str = "table", held: bool = False
) -> BeliefObject:
    known = ("block", "box", Box((0.04, 0.04, 0.06)), "red", Pose(at), 0.001, 0.01, 0.9, 1.0)
    return BeliefObject(*known, id=ObjectId(name), object_in_tcp=Pose() if held else None, place=place)


def scene(*objects: BeliefObject) -> PlanningScene:
    belief = PlanningScene([SHELF, TABLE, PIT, POST], [BIN])
    for each in objects:
        belief.put(each, "test")
    belief.take_changes()
    return belief


@pytest.mark.parametrize(
    ("x", "y", "height"),
    [
        (0.001, 0.0, 0.0), (-0.001, 0.0, None), (0.999, 0.0, 0.0), (1.001, 0.0, None),
        (0.5, 0.399, 0.0), (0.5, 0.401, None), (0.5, -0.399, 0.0), (0.5, -0.401, None),
        (0.701, 0.2, 0.1), (0.699, 0.2, 0.0), (0.8, 0.349, 0.1), (0.8, 0.351, 0.0),
        (0.5, 0.0, 0.0),  # a post is not stood on
        (2.0, 0.0, 0.0),  # never below the floor
    ],
)  # fmt: skip
def test_the_highest_fixture_there_is_the_support(x: float, y: float, height: float | None) -> None:
    found = support_height_at(scene(), x, y)
    assert found == (None if height is None else pytest.approx(height))


@pytest.mark.parametrize(
    ("x", "y", "z", "place"),
    [
        (0.5, 0.0, 0.03, "table"), (0.8, 0.2, 0.13, "table"), (3.0, 3.0, 0.03, "table"),
        (0.399, -0.2, 0.045, "red_bin"), (0.401, -0.2, 0.03, "table"), (0.201, -0.2, 0.045, "red_bin"),
        (0.199, -0.2, 0.03, "table"), (0.3, -0.051, 0.045, "red_bin"), (0.3, -0.049, 0.03, "table"),
        (0.3, -0.349, 0.045, "red_bin"), (0.3, -0.351, 0.03, "table"),
    ],
)  # fmt: skip
def test_what_is_let_go_falls_straight_down(x: float, y: float, z: float, place: str) -> None:
    belief = scene(item("other", (0.1, 0.1, 0.03)), item("block", (x, y, 0.4), place="hand", held=True))
    release_object(belief, "slipped")
    now = belief.get("block")
    assert now.pose.position == pytest.approx((x, y, z))
    assert (now.place, now.attached, now.confidence, now.sigma_position) == (place, False, 0.3, 0.02)
    assert [change.reason for change in belief.take_changes()] == ["slipped"]
    release_object(belief, "slipped")
    assert belief.take_changes() == ()


def opening(belief: PlanningScene) -> tuple[World, list[float | None]]:
    widths: list[float | None] = []

    def move(width: float | None) -> Generator[None, None, None]:
        widths.append(width)
        yield

    return cast("World", SimpleNamespace(scene=belief, gripper=SimpleNamespace(open=move))), widths


@pytest.mark.parametrize("halted", [False, True])
def test_what_the_fingers_held_is_gone_once_they_open(halted: bool) -> None:
    belief = scene(item("block", (0.5, 0.0, 0.4), place="hand", held=True))
    world, widths = opening(belief)
    doing = open_gripper(world, "let go", 0.05)
    next(doing)
    assert belief.held is not None
    if halted:
        doing.close()
    else:
        assert next(doing, "done") == "done"
    assert belief.held is None
    assert widths == [0.05]
    world, widths = opening(belief)
    list(open_gripper(world, "let go"))
    assert widths == [None]


@pytest.mark.parametrize(
    ("at", "rides"),
    [
        ((0.299, 0.7, 0.15), True), ((0.301, 0.7, 0.15), False), ((-0.299, 0.7, 0.15), True),
        ((-0.301, 0.7, 0.15), False), ((0.0, 0.799, 0.15), True), ((0.0, 0.801, 0.15), False),
        ((0.0, 0.601, 0.15), True), ((0.0, 0.599, 0.15), False), ((0.0, 0.7, 0.101), True),
        ((0.0, 0.7, 0.1), False), ((0.3, 0.7, 0.15), True),
    ],
)  # fmt: skip
def test_what_lies_on_a_belt_rides_on(at: tuple[float, float, float], rides: bool) -> None:
    here = item("block", at)
    held = replace(here, id=ObjectId("held"), object_in_tcp=Pose())
    belief = scene(here, held, replace(here, id=ObjectId("thing"), role="obstacle"))
    attempts = AttemptMemory()
    for name in ("block", "held"):
        attempts.failed("Main/Grasp", name, "a")
    description = SimpleNamespace(belts=(SimpleNamespace(id="belt"),), fixture=lambda _: BELT)
    world = SimpleNamespace(scene=belief, attempts=attempts, description=description)
    assert forget_belt_items(cast("World", world)) == (("block",) if rides else ())
    assert [str(o.id) for o in belief.objects] == ["held", "thing"] if rides else ["block", "held", "thing"]
    assert attempts.count("Main/Grasp", "block") == (0 if rides else 1)
    assert attempts.count("Main/Grasp", "held") == 1


@pytest.mark.parametrize(("inside", "words"), [(0, "0 items are"), (1, "1 item is"), (2, "2 items are")])
def test_with_a_bin_goes_what_was_believed_in_it(inside: int, words: str) -> None:
    objects = [item(f"block_{n}", (0.3, -0.2, 0.05), place="red_bin") for n in range(inside)]
    belief = scene(
        *objects, item("held", (0.3, -0.2, 0.4), place="red_bin", held=True), item("left", (0.5, 0.0, 0.03))
    )
    attempts = AttemptMemory()
    for o in belief.objects:
        attempts.failed("Main/Grasp", o.id, "a")
    journal, heaps = Journal(), {ObjectId("red_bin"): "a heap", ObjectId("blue_bin"): "another"}
    noticed = SimpleNamespace(
        exchanged=lambda signals: (ObjectId("red_bin"),) if signals == "signals" else ()
    )
    world = SimpleNamespace(
        scene=belief, attempts=attempts, journal=journal, noticed=noticed,
        feed=SimpleNamespace(read=lambda: "signals"), vision=SimpleNamespace(bins=heaps, heaps={}),
    )  # fmt: skip
    assert apply_bin_exchanges(cast("World", world), "Main/Exchange") == ("red_bin",)
    assert [str(o.id) for o in belief.objects] == ["held", "left"]
    assert [attempts.count("Main/Grasp", o.id) for o in objects] == [0] * inside
    assert attempts.count("Main/Grasp", "held") == attempts.count("Main/Grasp", "left") == 1
    assert heaps == {"blue_bin": "another"}
    (event,) = journal.take()
    assert isinstance(event, JournalEvent)
    assert event.message == f"red_bin is exchanged for an empty one; {words} gone with it"
    assert (event.kind, event.node) == ("bin_emptied", "Main/Exchange")
    assert event.data == {"bin": "red_bin", "objects": [str(o.id) for o in objects]}


def test_the_heap_of_a_tote_goes_with_it() -> None:
    tote = replace(BIN, id=ObjectId("tote"), is_tote=True)
    heap = replace(item("tote_heap", (0.3, -0.2, 0.03), place="tote"), role="heap")
    belief = PlanningScene([TABLE], [tote])
    for each in (heap, item("thing_1", (0.3, -0.2, 0.05), place="tote")):
        belief.put(each, "test")
    journal = Journal()
    vision = SimpleNamespace(bins={}, heaps={"tote": "its map", "other": "another"})
    world = SimpleNamespace(
        scene=belief, attempts=AttemptMemory(), journal=journal, vision=vision,
        noticed=SimpleNamespace(exchanged=lambda _: (ObjectId("tote"),)),
        feed=SimpleNamespace(read=lambda: "signals"),
    )  # fmt: skip
    assert apply_bin_exchanges(cast("World", world), "Main/Exchange") == ("tote",)
    assert list(belief.objects) == []
    assert vision.heaps == {"other": "another"}, "the map of the old tote tells nothing of the new one"
    (event,) = journal.take()
    assert isinstance(event, JournalEvent)
    assert event.message == "tote is exchanged for another; 1 item is gone with it"
    assert event.data == {"bin": "tote", "objects": ["thing_1"]}
