"""From the grasp over the bin in one motion: `Grasp` leaves the arm moving, `Place` goes on with it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from picktree.robot.control import ArmMotion
from picktree.robot.manipulation.pick_candidates import TRANSFER_STAGE
from picktree.robot.manipulation.pick_place_motions import transfer_requests
from picktree.robot.perception import BinView
from picktree.robot.planning import OffsetGoal, Request
from picktree.trees import Steps
from picktree.world import Candidates, Entry, ObjectId

from .cell import Cell, looked, mission


def sorting(item: str, into: str) -> str:
    return f"Sequence: [{{Grasp: {{object: {item}}}}}, {{Place: {{object: {item}, into: {into}}}}}]"


def to_the_place(cell: Cell) -> None:
    """Tick until `Place` runs."""
    while cell.leaf != "Place":
        cell.tick()
        assert cell.running


def destination(cell: Cell, item: str) -> str:
    into = cell.world.scene.destination(item)
    assert into is not None
    return str(into)


def sent_off() -> tuple[Cell, str]:
    """A cell that begins to carry its block to where it belongs."""
    cell, (block,) = looked(block=1)
    cell.start(mission(sorting(block, destination(cell, block))))
    return cell, block


def placed(cell: Cell) -> str:
    (body,) = cell.hardware.truth()
    x, y, _ = body.pose.position
    return next((str(b.id) for b in cell.world.scene.bins.values()
                 if np.hypot(x - b.pose.position[0], y - b.pose.position[1]) < 0.1), "")  # fmt: skip


def test_the_arm_does_not_stop_between_grasp_and_place() -> None:
    cell, (block,) = looked(block=1)
    into = destination(cell, block)
    cell.start(mission(sorting(block, into)))
    to_the_place(cell)
    assert cell.happened("pick") == [f"pick: {block}: held"]
    speeds: list[float] = []
    while cell.world.control.controller == "Track":
        speeds.append(cell.speed)
        cell.tick()
    assert len(speeds) > 8
    assert min(speeds[:-4]) > 0.1
    cell.finish()
    assert (cell.tree.status.value, placed(cell)) == ("SUCCESS", into)


def test_a_grasp_alone_ends_with_the_arm_at_rest_and_the_object_held() -> None:
    cell, (block,) = looked(block=1)
    cell.do(f"Grasp: {{object: {block}}}")
    assert cell.tree.status.value == "SUCCESS"
    cell.rest()
    held = cell.world.scene.held
    assert held is not None
    (body,) = cell.hardware.truth()
    assert (held.id, body.pose.position[2] > 0.08) == (block, True)


def test_whoever_else_comes_next_begins_at_rest() -> None:
    for other in ("{GoTo: {pose: home}}", "OpenGripper"):
        cell, (block,) = looked(block=1)
        assert cell.do(f"Sequence: [{{Grasp: {{object: {block}}}}}, {other}]") == ""


def test_without_onward_the_object_is_lifted_only() -> None:
    cell, (block,) = looked(block=1)
    x, y, z = cell.world.scene.get(block).pose.position
    cell.do(f"Grasp: {{object: {block}, onward: false}}")
    assert cell.world.control.at_rest
    (body,) = cell.hardware.truth()
    assert np.linalg.norm(np.subtract(body.pose.position, (x, y, z + 0.08))) < 0.005


def test_another_bin_than_the_one_it_belongs_into() -> None:
    cell, (block,) = looked(block=1)
    into = next(b for b in cell.world.scene.bins if b != destination(cell, block))
    cell.do(sorting(block, into))
    assert (cell.tree.status.value, placed(cell)) == ("SUCCESS", into)


def test_what_is_known_since_is_heeded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Something was put where it is to be let go: `Place` finishes no motion that leads there."""
    finished: list[object] = []
    finish = ArmMotion.finish

    def finishing(self: ArmMotion, **how: Any) -> Steps:
        finished.append(self.ongoing)
        yield from finish(self, **how)

    monkeypatch.setattr(ArmMotion, "finish", finishing)
    for news in (False, True):
        cell, (block,) = looked(block=1)
        into = destination(cell, block)
        cell.do(f"Grasp: {{object: {block}}}")
        held = cell.world.scene.get(block)
        cell.world.scene.put(replace(held, confidence=0.5), "seen again")
        if news:
            cell.world.vision.bins[into] = BinView(np.full((3, 3), 0.092))
        cell.do(f"Place: {{object: {block}, into: {into}}}")
        assert (cell.tree.status.value, placed(cell)) == ("SUCCESS", into)
    assert len(finished) == 1


def test_what_is_lost_on_the_way_is_told_as_that() -> None:
    cell, block = sent_off()
    to_the_place(cell)
    hardware = cell.kinematic
    hardware.remove("item_00")
    cell.finish()
    assert str(cell.failure.cause) == "grasp.slipped"
    assert cell.failure.message.startswith(f"{block} was lost on the way (opening ")
    assert cell.world.scene.held is None


def test_what_slips_out_while_it_is_lifted_was_never_held_and_is_grasped_once_more() -> None:
    cell, block = sent_off()
    while cell.world.scene.held is None:
        cell.tick()
    for _ in range(4):
        cell.tick()
    hardware = cell.kinematic
    hardware.remove("item_00")
    cell.finish()
    (again,) = cell.happened("regrasp")
    assert again.startswith(f"regrasp: {block} is grasped once more (it was lost where it was gripped): ")
    assert "it was between the fingers and slipped out" in again
    assert str(cell.failure.cause) == "grasp.missed"
    assert cell.happened("pick") == [f"pick: {block}: not held"] * 2


def test_the_approach_is_broken_off_when_there_is_no_way_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """The transfer is planned while the arm approaches: the fingers do not close in vain."""
    cell, (block,) = looked(block=1)
    asked: list[Request] = []

    def blocked_at_first(*what: Any) -> tuple[Request, ...]:
        legs = transfer_requests(*what)
        asked.append(legs[0])
        return (Request(OffsetGoal((0.0, 0.0, -0.5)), legs[0].start), *legs[1:]) if len(asked) == 1 else legs

    monkeypatch.setattr("picktree.robot.manipulation.pick_place_motions.transfer_requests", blocked_at_first)
    ranked: list[Candidates] = []
    note = cell.world.journal.note

    def noting(entry: Entry) -> None:
        if isinstance(entry, Candidates):
            ranked.append(entry)
        note(entry)

    monkeypatch.setattr(cell.world.journal, "note", noting)
    cell.do(sorting(block, destination(cell, block)))
    assert cell.tree.status.value == "SUCCESS"
    assert len(asked) == 2
    (refused,) = (tried for tried in ranked[-1].tried if tried.stage == TRANSFER_STAGE)
    assert refused.verdict.startswith(
        "no way to the place: motion 1 of 3 (straight by (0.000, 0.000, -0.500)): "
    )
    assert cell.happened("pick") == [f"pick: {block}: held"]


@pytest.mark.parametrize(("off", "onwards"), [(0.003, True), (0.02, False)])
def test_a_transfer_is_made_only_from_where_the_arm_stands(
    off: float, onwards: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that was planned from elsewhere is left, and the object lifted straight up instead."""
    cell, (block,) = looked(block=1)

    def from_elsewhere(*what: Any) -> tuple[Request, ...]:
        first, *others = transfer_requests(*what)
        assert first.start is not None
        return (replace(first, start=first.start + off * np.eye(7)[5]), *others)

    monkeypatch.setattr("picktree.robot.manipulation.pick_place_motions.transfer_requests", from_elsewhere)
    x, y, _ = cell.world.scene.get(block).pose.position
    assert cell.do(f"Grasp: {{object: {block}}}") == ""
    cell.rest()
    (body,) = cell.hardware.truth()
    carried = math.dist(body.pose.position[:2], (x, y))
    assert (carried > 0.05) is onwards
    assert cell.world.control.monitor.stops == 0


@pytest.mark.parametrize(("risen", "lifted"), [(0.002, True), (0.06, False)])
def test_a_transfer_that_is_blocked_low_is_lifted_clear_first(risen: float, lifted: bool) -> None:
    """Stopped among its neighbours the object is lifted straight up; above them it stays where it is."""
    cell, (block,) = looked(block=1)
    cell.start(mission(f"Grasp: {{object: {block}}}"))
    while cell.world.scene.held is None:
        cell.tick()
    low = cell.world.control.tcp.position[2]
    while cell.world.control.tcp.position[2] < low + risen:
        cell.tick()
    bin_ = cell.world.scene.bins[ObjectId(destination(cell, block))]
    x, y, z = bin_.pose.position
    cell.believe("pile", (0.25, 0.2, 0.5), (x, y, z + 0.25))
    cell.finish()
    assert cell.tree.failure is None
    cell.rest()
    assert (cell.world.control.tcp.position[2] - low > 0.085) is lifted
