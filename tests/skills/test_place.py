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
from picktree.robot.manipulation.weighing import GripMonitor
from picktree.robot.perception import BinView
from picktree.robot.planning import LegFailure, MotionPlan, Request
from picktree.simulation.kinematic import KinematicHardware
from picktree.trees import Doing, Steps
from picktree.world import Box, Cause, Failure, ObjectId, Pose, Trajectory, bottom, planning, top
from picktree.world.event_types import ItemDoneEvent

from .cell import Cell, holding, mission

HAND_ABOVE_TCP = 0.0375
"""Height of the lower side of the hand over the TCP, m."""


@pytest.mark.parametrize("where", ["into: red_bin", "at: [0.5, 0.2, 0]"])
def test_what_sticks_to_the_opened_fingers_was_not_placed(
    where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell, block = holding()
    hardware = cell.kinematic
    monkeypatch.setattr(hardware.bodies, "let_go", lambda: None)
    assert (
        cell.do(f"Place: {{object: {block}, {where}}}")
        == f"place.missed: {block} still hangs on the open fingers (load 0.98 N, then 0.98 N)"
    )
    assert cell.world.gripper.width > 0.06
    cell.wait()
    held = cell.world.scene.held
    assert held is not None
    assert (held.id, held.place) == (block, "hand")
    assert cell.happened("item_done") == []
    (body,) = hardware.truth()
    assert held.pose.distance(body.pose) < 0.003


def test_after_four_stops_by_the_load_only_the_fingers_are_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    """The mass of the hand is wrong: the load seems gone whenever it is watched on the move."""
    cell, block = holding()
    stops = list[float]()

    def gone(self: GripMonitor) -> bool:
        if cell.world.control.tcp.position[2] < self._above:
            return False
        stops.append(self._above)
        return True

    monkeypatch.setattr(GripMonitor, "_load_is_gone", gone)
    assert cell.do(f"Place: {{object: {block}, into: red_bin}}") == ""
    assert len(stops) == 4


@pytest.mark.parametrize(("left", "placed"), [(0.45, True), (0.55, False)])
def test_half_of_the_load_must_be_gone(left: float, placed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The item breaks when the fingers open and a part stays at them: the lighter part counts as rubbish."""
    cell, block = holding()
    bodies = cell.kinematic.bodies
    (body,) = bodies.items

    def break_() -> None:
        bodies.put(replace(bodies[body.id], entry=replace(body.entry, mass=left * body.entry.mass)))

    monkeypatch.setattr(bodies, "let_go", break_)
    hangs = f"place.missed: {block} still hangs on the open fingers (load 0.98 N, then 0.54 N)"
    assert cell.do(f"Place: {{object: {block}, into: red_bin}}") == ("" if placed else hangs)
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
        cell, block = holding()
        hardware = cell.kinematic
        heights = low(cell, hardware, monkeypatch)
        assert cell.do(f"Place: {{object: {block}, {where}}}") == ""
        (height,) = heights
        assert least < height < most


@pytest.mark.parametrize(("leg", "told"), [(0, "planning.no_path: no way"), (1, "")])
def test_where_the_way_down_is_not_free_it_is_let_go_from_above(
    leg: int, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The way straight down is left out; where nothing leads over the bin, that is the failure."""
    cell, block = holding()
    heights = low(cell, cell.kinematic, monkeypatch)
    through, asked = cell.world.plan.through, list[int]()

    def not_free(legs: Sequence[Request], **how: Any) -> Doing[MotionPlan]:
        asked.append(len(legs))
        raise LegFailure(planning.NO_PATH, "no way", leg, {})
        yield from through(legs, **how)

    monkeypatch.setattr(cell.world.plan, "through", not_free)
    assert cell.do(f"Place: {{object: {block}, into: red_bin}}") == told
    # Higher up it is tried, too.
    assert (len(heights), len(asked) > 1) == ((0, True) if told else (1, False))


@pytest.mark.parametrize(
    ("where", "gap"),
    [*(("into: red_bin", gap) for gap in (0.004, 0.022, None)), ("at: [0.5, 0.2, 0]", 0.004)],
)
def test_the_hand_is_not_lowered_into_what_has_come_below_it(
    where: str, gap: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Something is seen below the hand when it is over its bin already. The wrist would not feel it."""
    cell, block = holding()
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
    cell.do(f"Place: {{object: {block}, {where}}}")
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
    cell, block = holding()
    guards, along = list[float](), cell.world.move.along

    def noting(trajectory: Trajectory, **how: Any) -> Steps:
        guards.append(how["guard"])
        yield from along(trajectory, **how)

    monkeypatch.setattr(cell.world.move, "along", noting)
    monkeypatch.setattr("picktree.robot.manipulation.object_placement.payload_force", lambda _: 7.0)
    assert cell.do(f"Place: {{object: {block}, into: red_bin}}") == ""
    assert guards == [cell.world.handling.guard + 7.0]


def test_a_bin_whose_heap_is_too_high_is_full() -> None:
    cell, block = holding()
    heights = np.full((3, 3), 0.125)
    heights[1, 1] = 0.12
    cell.world.vision.bins[ObjectId("red_bin")] = BinView(heights)
    cell.do(f"Place: {{object: {block}, into: red_bin}}")
    failure = cell.failure
    assert cell.told == "place.full: red_bin is full: its heap is 120 mm high at its lowest"
    assert failure.evidence == {"object": block, "bin": "red_bin"}
    assert cell.world.scene.held is not None


@pytest.mark.parametrize(("drop", "legs"), [(0.0, []), (0.01, [2]), (None, [2])])
def test_where_nothing_is_to_be_gone_down_it_is_let_go_from_above(
    drop: float | None, legs: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where something is, one way of letting go over each spot is enough: placement gets a single turn."""
    cell, block = holding()
    downs, through = list[int](), cell.world.plan.through

    def level(*given: Any) -> Sequence[PlaceCandidate]:
        found = place_candidates(*given)
        return found[:1] if drop is None else [replace(landing, drop=drop) for landing in found]

    def going(asked: Sequence[Request], **how: Any) -> Any:
        downs.append(len(asked))
        return through(asked, **how)

    monkeypatch.setattr("picktree.robot.manipulation.object_placement.place_candidates", level)
    monkeypatch.setattr(cell.world.plan, "through", going)
    assert cell.do(f"Place: {{object: {block}, into: red_bin}}") == ""
    assert downs == legs


@pytest.mark.parametrize(
    ("cause", "told"),
    [(planning.NO_IK, ""), (planning.START_IN_COLLISION, "planning.start_in_collision: not there")],
)
def test_another_level_is_tried_where_one_is_not_reached(
    cause: Cause, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell, block = holding()
    refused, through = list[Failure](), cell.world.plan.through

    def once(*given: Any, **how: Any) -> Any:
        if not refused:
            refused.append(Failure(cause, "not there"))
            raise refused[0]
        return through(*given, **how)

    monkeypatch.setattr(cell.world.plan, "through", once)
    assert cell.do(f"Place: {{object: {block}, into: red_bin}}") == told


def test_what_was_placed_is_told_and_believed_to_lie_there() -> None:
    for where, words in (("into: red_bin", "into red_bin"), ("at: [0.5, 0.2, 0]", "at [0.5, 0.2, 0.0]")):
        cell, block = holding()
        hardware = cell.kinematic
        form = cell.world.scene.get(block).form
        assert cell.do(f"Place: {{object: {block}, {where}}}") == ""
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
    cell, block = holding()
    before = cell.world.control.state.position
    for ports, cause, message in (
        ("into: no_bin", "world.unknown_object", "there is no bin 'no_bin'"),
        ("at: '{spot}'", "world.unknown_object", "`at` needs three numbers x, y, z, not [0.5, 0.2]"),
    ):
        cell.start(mission(f"Place: {{object: {block}, {ports}}}"))
        cell.tree.blackboard.write("Main/spot", [0.5, 0.2], "test")
        cell.finish()
        failure = cell.failure
        assert (str(failure.cause), failure.message) == (cause, message)
    assert np.abs(cell.world.control.state.position - before).max() < 1e-3


def test_a_place_beside_something_tall_is_one_where_the_fingers_open_freely() -> None:
    """A post of 16 cm stands in the bin; of the hand's rotations beside it some would open against it."""
    cell, block = holding()
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
    cell, block = holding()
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
    assert cell.do(f"Place: {{object: {block}, into: red_bin}}") == ""
    known = world.scene.get(ObjectId(block))
    assert bottom(known.shape, known.pose) == pytest.approx(into.wall + 0.085, abs=1e-3)
    tips = world.control.tcp.position[2] - world.robot.description.gripper.tip
    assert tips > top(known.shape, known.pose)
