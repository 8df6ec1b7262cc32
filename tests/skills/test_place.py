"""Place: what it does when the object does not come off the hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from picktree.robot import PlaceCandidate, World
from picktree.robot.manipulation import object_placement
from picktree.robot.manipulation.pick_place_motions import lower
from picktree.robot.manipulation.release_poses import bin_target, levels, opens_freely, place_candidates
from picktree.robot.perception import BinView
from picktree.robot.planning import LegFailure, MotionPlan, Request
from picktree.simulation.kinematic import KinematicHardware
from picktree.trees import Doing, Steps
from picktree.world import Box, Cause, Failure, ObjectId, Pose, Trajectory, bottom, planning, top
from picktree.world.event_types import ItemDoneEvent

from .cell import Cell, items, mission

HAND_ABOVE_TCP = 0.0375
"""Height of the lower side of the hand over the TCP, m."""
LOOK = 'Observe: {camera: overhead, objects: "{items}"}'


def holding() -> tuple[Cell, KinematicHardware, str]:
    """A cell whose hand holds its block above the table."""
    cell = Cell(mission(LOOK), items(block=1))
    cell.finish()
    (block,) = (str(o.id) for o in cell.world.scene.objects)
    cell.start(mission(f"Grasp: {{object: {block}, onward: false}}"))
    cell.finish()
    assert cell.tree.failure is None
    assert isinstance(cell.hardware, KinematicHardware)
    return cell, cell.hardware, block


@pytest.mark.parametrize("where", ["into: red_bin", "at: [0.5, 0.2, 0]"])
def test_what_sticks_to_the_opened_fingers_was_not_placed(
    where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell, hardware, block = holding()
    monkeypatch.setattr(hardware.bodies, "let_go", lambda: None)
    cell.start(mission(f"Place: {{object: {block}, {where}}}"))
    cell.finish()
    failure = cell.tree.failure
    assert failure is not None
    assert (str(failure.cause), failure.message) == (
        "place.missed",
        f"{block} still hangs on the open fingers (load 0.98 N, then 0.98 N)",
    )
    assert cell.world.gripper.width > 0.06
    cell.wait()
    held = cell.world.scene.held
    assert held is not None
    assert (held.id, held.place) == (block, "hand")
    assert cell.happened("item_done") == []
    (body,) = hardware.truth()
    assert held.pose.distance(body.pose) < 0.003


@pytest.mark.parametrize(("left", "placed"), [(0.45, True), (0.55, False)])
def test_half_of_the_load_must_be_gone(left: float, placed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The item breaks when the fingers open and a part stays at them: the lighter part counts as rubbish."""
    cell, hardware, block = holding()
    (body,) = hardware.bodies.items

    def break_() -> None:
        now = hardware.bodies[body.id]
        hardware.bodies.put(replace(now, entry=replace(body.entry, mass=left * body.entry.mass)))

    monkeypatch.setattr(hardware.bodies, "let_go", break_)
    cell.start(mission(f"Place: {{object: {block}, into: red_bin}}"))
    cell.finish()
    said = "" if cell.tree.failure is None else cell.tree.failure.message
    assert said == ("" if placed else f"{block} still hangs on the open fingers (load 0.98 N, then 0.54 N)")
    assert (cell.world.scene.held is None) is placed


def low(cell: Cell, hardware: KinematicHardware, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Heights of the block's underside when the fingers let it go, m."""
    heights, let_go = list[float](), hardware.bodies.let_go

    def letting_go() -> None:
        (body,) = hardware.bodies.items
        heights.append(bottom(body.entry.shape, body.pose))
        let_go()

    monkeypatch.setattr(hardware.bodies, "let_go", letting_go)
    return heights


def test_at_a_point_it_is_put_down_and_into_a_bin_it_is_lowered(monkeypatch: pytest.MonkeyPatch) -> None:
    for where, least, most in (("at: [0.5, 0.2, 0]", -0.001, 0.002), ("into: red_bin", 0.03, 0.1)):
        cell, hardware, block = holding()
        heights = low(cell, hardware, monkeypatch)
        cell.start(mission(f"Place: {{object: {block}, {where}}}"))
        cell.finish()
        assert cell.tree.failure is None
        (height,) = heights
        assert least < height < most


@pytest.mark.parametrize("leg", [0, 1])
def test_where_the_way_down_is_not_free_it_is_let_go_from_above(
    leg: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The way straight down is left out; where nothing leads over the bin, that is the failure."""
    cell, hardware, block = holding()
    heights = low(cell, hardware, monkeypatch)
    through, asked = cell.world.plan.through, list[int]()

    def not_free(legs: Sequence[Request], **how: Any) -> Doing[MotionPlan]:
        asked.append(len(legs))
        told = LegFailure(planning.NO_PATH, "no way", leg, {})
        raise told
        yield from through(legs, **how)

    monkeypatch.setattr(cell.world.plan, "through", not_free)
    cell.start(mission(f"Place: {{object: {block}, into: red_bin}}"))
    cell.finish()
    failure = cell.tree.failure
    if leg == 1:
        assert failure is None
        assert (len(heights), len(asked)) == (1, 1)
    else:
        assert failure is not None
        assert (str(failure.cause), failure.message) == ("planning.no_path", "no way")
        assert len(asked) > 1  # higher up it was tried, too


@pytest.mark.parametrize(
    ("where", "gap"),
    [*(("into: red_bin", gap) for gap in (0.004, 0.022, None)), ("at: [0.5, 0.2, 0]", 0.004)],
)
def test_the_hand_is_not_lowered_into_what_has_come_below_it(
    where: str, gap: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Something is seen below the hand when it is over its bin already. The wrist would not feel it."""
    cell, _, block = holding()
    world, started = cell.world, list[float]()
    heights, through = list[float](), world.plan.through

    def not_free(legs: Sequence[Request], **how: Any) -> Doing[MotionPlan]:
        told = LegFailure(planning.NO_PATH, "no way", 1, {})
        raise told
        yield from through(legs, **how)

    def lower_beside(world: World, *how: Any) -> Doing[None]:
        tcp = world.control.tcp
        started.append(tcp.position[2])
        if gap is not None:
            x, y, _ = np.array(tcp.position) + 0.08 * tcp.rotation()[:, 1]
            top = tcp.position[2] + HAND_ABOVE_TCP - gap
            shape, pose = Box((0.03, 0.03, 0.03)), Pose((float(x), float(y), top - 0.015))
            held = world.scene.get(block)
            put = replace(held, id=ObjectId("obstacle_1"), role="obstacle", object_in_tcp=None)
            world.scene.put(replace(put, kind="unknown", shape=shape, pose=pose, place="table"), "test")
        yield from lower(world, *how)
        heights.append(world.control.tcp.position[2])

    monkeypatch.setattr(world.plan, "through", not_free)
    monkeypatch.setattr(object_placement, "lower", lower_beside)
    cell.start(mission(f"Place: {{object: {block}, {where}}}"))
    cell.finish()
    if "at:" in where:  # at a point nothing is let fall
        failure, held = cell.tree.failure, world.scene.held
        assert failure is not None and held is not None and held.id == block
        assert (str(failure.cause), heights) == ("planning.no_path", [])
        return
    lowered = started[0] - heights[0]
    if gap is None:
        assert lowered > 0.02
    else:
        assert -0.001 < lowered <= gap
        assert (lowered > 0.01) == (gap > 0.02)


def test_what_is_carried_adds_to_the_force_that_stops_the_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    cell, _, block = holding()
    guards, along = list[float](), cell.world.move.along

    def noting(trajectory: Trajectory, **how: Any) -> Steps:
        guards.append(how["guard"])
        yield from along(trajectory, **how)

    monkeypatch.setattr(cell.world.move, "along", noting)
    monkeypatch.setattr("picktree.robot.manipulation.object_placement.payload_force", lambda _: 7.0)
    cell.start(mission(f"Place: {{object: {block}, into: red_bin}}"))
    cell.finish()
    assert cell.tree.failure is None
    assert guards == [cell.world.handling.guard + 7.0]


def test_a_bin_whose_heap_is_too_high_is_full() -> None:
    cell, _, block = holding()
    heights = np.full((3, 3), 0.125)
    heights[1, 1] = 0.12
    cell.world.vision.bins[ObjectId("red_bin")] = BinView(heights)
    cell.start(mission(f"Place: {{object: {block}, into: red_bin}}"))
    cell.finish()
    failure = cell.tree.failure
    assert failure is not None
    assert (str(failure.cause), failure.message) == (
        "place.full",
        "red_bin is full: its heap is 120 mm high at its lowest",
    )
    assert failure.evidence == {"object": block, "bin": "red_bin"}
    assert cell.world.scene.held is not None


def test_one_way_of_letting_go_over_a_bin_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """Placement gets a single turn of the hand over each spot."""
    cell, _, block = holding()
    downs, through = list[float](), cell.world.plan.through

    def first(*given: Any) -> Sequence[PlaceCandidate]:
        return place_candidates(*given)[:1]

    def going(legs: Sequence[Request], **how: Any) -> Doing[MotionPlan]:
        downs.append(len(legs))
        return through(legs, **how)

    monkeypatch.setattr("picktree.robot.manipulation.object_placement.place_candidates", first)
    monkeypatch.setattr(cell.world.plan, "through", going)
    cell.start(mission(f"Place: {{object: {block}, into: red_bin}}"))
    cell.finish()
    assert cell.tree.failure is None
    assert downs == [2]


def test_where_nothing_is_to_be_gone_down_it_is_let_go_from_above(monkeypatch: pytest.MonkeyPatch) -> None:
    for drop, legs in ((0.0, []), (0.01, [2])):
        cell, _, block = holding()
        downs, through = list[int](), cell.world.plan.through

        def level(*given: Any, drop: float = drop) -> Sequence[PlaceCandidate]:
            return [replace(landing, drop=drop) for landing in place_candidates(*given)]

        def going(
            asked: Sequence[Request], *, downs: list[int] = downs, through: Any = through, **how: Any
        ) -> Any:
            downs.append(len(asked))
            return through(asked, **how)

        monkeypatch.setattr("picktree.robot.manipulation.object_placement.place_candidates", level)
        monkeypatch.setattr(cell.world.plan, "through", going)
        cell.start(mission(f"Place: {{object: {block}, into: red_bin}}"))
        cell.finish()
        assert cell.tree.failure is None
        assert downs == legs


@pytest.mark.parametrize("cause", [planning.NO_IK, planning.START_IN_COLLISION])
def test_another_level_is_tried_where_one_is_not_reached(
    cause: Cause, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell, _, block = holding()
    refused, through = list[Failure](), cell.world.plan.through

    def once(*given: Any, **how: Any) -> Any:
        if not refused:
            refused.append(Failure(cause, "not there"))
            raise refused[0]
        return through(*given, **how)

    monkeypatch.setattr(cell.world.plan, "through", once)
    cell.start(mission(f"Place: {{object: {block}, into: red_bin}}"))
    cell.finish()
    failure = cell.tree.failure
    assert ("" if failure is None else failure.message) == ("" if cause is planning.NO_IK else "not there")


def test_what_was_placed_is_told_and_believed_to_lie_there() -> None:
    for where, words in (("into: red_bin", "into red_bin"), ("at: [0.5, 0.2, 0]", "at [0.5, 0.2, 0.0]")):
        cell, hardware, block = holding()
        form = cell.world.scene.get(block).form
        cell.start(mission(f"Place: {{object: {block}, {where}}}"))
        cell.finish()
        assert cell.tree.failure is None
        (done,) = (e for e in cell.events if isinstance(e, ItemDoneEvent))
        assert done.message == f"{block} placed {words}"
        into = "red_bin" if "into" in where else ""
        assert (done.object, done.form, done.into) == (block, form, into)
        assert (done.spot == "point") is (into == "")
        known = cell.world.scene.get(block)
        assert known.place == (into or "table")
        (body,) = hardware.truth()
        assert known.pose.distance(body.pose) < 0.012
        assert cell.world.control.wrist.payload is None


def test_what_cannot_be_placed_is_told_before_the_arm_moves() -> None:
    cell, _, block = holding()
    before = cell.world.control.state.position
    for ports, cause, message in (
        ("into: no_bin", "world.unknown_object", "there is no bin 'no_bin'"),
        ("at: '{spot}'", "world.unknown_object", "`at` needs three numbers x, y, z, not [0.5, 0.2]"),
    ):
        cell.start(mission(f"Place: {{object: {block}, {ports}}}"))
        cell.tree.blackboard.write("Main/spot", [0.5, 0.2], "test")
        cell.finish()
        failure = cell.tree.failure
        assert failure is not None
        assert (str(failure.cause), failure.message) == (cause, message)
    assert np.abs(cell.world.control.state.position - before).max() < 1e-3


def test_a_place_beside_something_tall_is_one_where_the_fingers_open_freely() -> None:
    """A post of 16 cm stands in the bin; of the hand's rotations beside it some would open against it."""
    cell, _, block = holding()
    world = cell.world
    held = world.scene.get(ObjectId(block))
    assert held.object_in_tcp is not None
    into = world.scene.bins["red_bin"]
    x, y, _ = into.pose.position
    post = replace(
        held,
        id=ObjectId("post"),
        shape=Box((0.04, 0.04, 0.16)),
        pose=Pose((x, y, into.wall + 0.08)),
        object_in_tcp=None,
        place=str(into.id),
    )
    world.scene.put(post, "placed before")
    target = bin_target(world, held, into.id)
    level = next(one for one in levels(target) if one.spot.name in ("cell 1,0", "cell 1,2"))
    over = place_candidates(world, target, level, held.shape, held.object_in_tcp)
    free = [opens_freely(world, at, held, held.object_in_tcp, 0.04) for at in over]
    assert any(free) and not all(free)
    world.scene.remove("post", "taken away")
    assert all(opens_freely(world, at, held, held.object_in_tcp, 0.04) for at in over)


def test_the_hand_rises_from_around_an_object_that_rests_between_the_fingers() -> None:
    """What is in the bin is so high that the block comes to rest with its top above the finger tips."""
    cell, _, block = holding()
    world = cell.world
    into = world.scene.bins["red_bin"]
    pile = replace(
        world.scene.get(ObjectId(block)),
        id=ObjectId("pile"),
        shape=Box((0.20, 0.15, 0.085)),
        pose=into.pose.shifted((0.0, 0.0, into.wall + 0.0425)),
        object_in_tcp=None,
        place=str(into.id),
    )
    world.scene.put(pile, "placed before")
    cell.start(mission(f"Place: {{object: {block}, into: red_bin}}"))
    cell.finish()
    assert cell.tree.failure is None
    known = world.scene.get(ObjectId(block))
    assert bottom(known.shape, known.pose) == pytest.approx(into.wall + 0.085, abs=1e-3)
    tips = world.control.tcp.position[2] - world.robot.description.gripper.tip
    assert tips > top(known.shape, known.pose)
