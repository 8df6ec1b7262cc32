"""Waiting for items and having bins exchanged, against a feed that does as it is told."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from picktree.robot.manipulation.bin_belief import bin_fill_level
from picktree.robot.perception import BinView
from picktree.world import BeliefObject, ObjectId, Pose
from picktree.world.scene import Belt

from .cell import Cell, items, mission
from .scripted_feed import ScriptedFeed

LOOK = 'Observe: {camera: overhead, objects: "{items}"}'
RED = ObjectId("red_bin")


def cell_with(body: str, **feed: Any) -> tuple[Cell, ScriptedFeed]:
    """A cell with one block on its table, and a feed."""
    cell = Cell(mission(body), items(block=1))
    scripted = ScriptedFeed(cell.world.clock, **feed)
    cell.world = replace(cell.world, feed=scripted)
    cell.start(mission(body))
    return cell, scripted


def outcome(cell: Cell) -> tuple[str, str, float]:
    """Status, failure and simulated time of the end."""
    cell.finish()
    return cell.tree.status.value, cell.told, round(cell.world.clock.now, 2)


def with_a_block(**feed: Any) -> tuple[Cell, ScriptedFeed, BeliefObject]:
    """A cell whose block was seen, and is returned."""
    cell, scripted = cell_with(LOOK, **feed)
    cell.finish()
    (block,) = cell.world.scene.objects
    return cell, scripted, block


def test_it_says_that_it_is_ready_and_waits_for_what_comes() -> None:
    cell, feed = cell_with("AwaitItems", loads=2)
    assert outcome(cell) == ("SUCCESS", "", 1.0)
    assert feed.heard == ["ready"]
    assert cell.world.facts()["feed_exhausted"] is False


def test_of_an_exhausted_feed_nothing_is_awaited() -> None:
    cell, feed = cell_with("AwaitItems", loads=0)
    assert outcome(cell) == ("SUCCESS", "", 0.0)
    assert feed.heard == []
    assert cell.world.facts()["feed_exhausted"] is True


def test_what_came_during_work_is_not_awaited_but_what_was_looked_at_is() -> None:
    cell, feed = cell_with("AwaitItems", loads=1)
    feed.deliveries = 1
    assert outcome(cell) == ("SUCCESS", "", 0.0)
    assert feed.heard == []
    cell.start(mission(f"Sequence: [{{{LOOK}}}, AwaitItems]"))
    feed.deliveries, looked = 2, cell.world.clock.now
    assert outcome(cell)[:2] == ("SUCCESS", "")
    assert feed.heard == ["ready"]
    assert cell.world.clock.now > looked + 1.0


WAITED = {"waited": pytest.approx(3.0, abs=0.01), "busy": False}
OBSTRUCTED = {"waited": pytest.approx(1.05, abs=0.06)}
RED_BIN = {"bin": "red_bin", "fill": 0.0}


@pytest.mark.parametrize(
    ("body", "feed", "told", "evidence"),
    [
        (
            "AwaitItems: {longest: 3 s}",
            {"loads": 1, "delay": None},
            "feed.late: nothing came within 3 s",
            {**WAITED, "obstructed": False, "deliveries": 0},
        ),
        (
            "ExchangeBin: {bin: red_bin, longest: 3 s}",
            {"delay": None},
            "feed.no_exchange: no empty bin replaced red_bin within 3 s",
            {**WAITED, **RED_BIN},
        ),
        (
            "AwaitItems: {clearance: 1 s}",
            {"loads": 1, "obstructed_until": 60.0},
            "feed.obstructed: the feed has waited 1 s for the arm to leave, and sets nothing down",
            {**OBSTRUCTED, "deliveries": 0},
        ),
        (
            "ExchangeBin: {bin: red_bin, clearance: 1 s}",
            {"obstructed_until": 60.0},
            "feed.obstructed: red_bin has not been exchanged for 1 s: the arm is over it",
            {**OBSTRUCTED, **RED_BIN},
        ),
        (
            'Sequence: [{SetBlackboard: {value: pink_bin, output_key: "{b}"}}, {ExchangeBin: {bin: "{b}"}}]',
            {},
            "world.unknown_object: there is no bin 'pink_bin'",
            None,
        ),
    ],
)
def test_what_did_not_come_or_was_in_the_way_is_told_with_how_long(
    body: str, feed: dict[str, Any], told: str, evidence: dict[str, object] | None
) -> None:
    cell, _ = cell_with(body, **feed)
    assert outcome(cell)[:2] == ("FAILURE", told)
    assert evidence is None or cell.failure.evidence == evidence


def test_an_arm_that_leaves_in_time_was_not_in_the_way() -> None:
    cell, feed = cell_with("AwaitItems: {clearance: 2 s}", loads=1, obstructed_until=1.5)
    assert outcome(cell) == ("SUCCESS", "", 1.5)
    assert feed.heard == ["ready"]


def placed(body: str, **feed: Any) -> tuple[Cell, ScriptedFeed, str]:
    """A cell whose block was placed into red_bin, with a mission that is still to begin."""
    cell, scripted, block = with_a_block(**feed)
    place = f"{{Place: {{object: {block.id}, into: red_bin}}}}"
    assert cell.do(f"Sequence: [{{Grasp: {{object: {block.id}}}}}, {place}]") == ""
    cell.start(mission(body))
    cell.events.clear()
    return cell, scripted, block.id


def test_what_lay_in_an_exchanged_bin_is_gone_with_all_that_was_known_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cell, feed, block = placed("ExchangeBin: {bin: red_bin}")
    world, reasons = cell.world, list[str]()
    removed = world.scene.remove

    def removing(name: ObjectId, reason: str) -> object:
        reasons.append(f"{name} {reason}")
        return removed(name, reason)

    monkeypatch.setattr(world.scene, "remove", removing)
    assert world.facts()["items_done"] == 1
    world.vision.bins[RED] = BinView(np.full((3, 3), 0.04))
    world.attempts.failed("Main/Grasp", block, "top 0")
    world.attempts.failed("Main/Grasp", "another", "top 0")
    began = world.clock.now
    assert outcome(cell)[:2] == ("SUCCESS", "")
    assert world.clock.now - began == pytest.approx(1.0)
    assert feed.heard == ["exchange red_bin"]
    assert world.scene.objects == ()
    assert reasons == [f"{block} taken away with its bin"]
    assert RED not in world.vision.bins
    assert world.attempts.state() == {"Main/Grasp|another": ["top 0"]}
    assert bin_fill_level(world, world.scene.bins[RED]) == 0.0
    assert cell.happened("bin_emptied") == [
        "bin_emptied: red_bin is exchanged for an empty one; 1 item is gone with it"
    ]
    assert world.facts()["items_done"] == 1


def test_only_a_bin_that_is_so_full_is_exchanged() -> None:
    cell, feed = cell_with(LOOK, loads=0)
    cell.world.vision.bins[RED] = BinView(np.full((3, 3), 0.045))
    full = bin_fill_level(cell.world, cell.world.scene.bins[RED])
    assert cell.do(f"ExchangeBin: {{bin: red_bin, fill: {full + 1e-9!r}}}") == ""
    assert feed.heard == []
    assert cell.do(f"ExchangeBin: {{bin: red_bin, fill: {full!r}}}") == ""
    assert feed.heard == ["exchange red_bin"]


def test_who_places_knows_of_the_empty_bin_that_stands_there_by_now() -> None:
    cell, feed, block = with_a_block()
    assert cell.do(f"Grasp: {{object: {block.id}, onward: false}}") == ""
    cell.world.vision.bins[RED] = BinView(np.full((3, 3), 0.125))  # a full one, when it was seen
    feed.exchanges[RED] = 1
    assert cell.do(f"Place: {{object: {block.id}, into: red_bin}}") == ""
    assert len(cell.happened("bin_emptied")) == 1


def test_what_is_in_the_hand_stays_there() -> None:
    cell, _, block = with_a_block()
    exchange = "{ExchangeBin: {bin: red_bin}}"
    assert cell.do(f"Sequence: [{{Grasp: {{object: {block.id}}}}}, {exchange}]") == ""
    held = cell.world.scene.held
    assert held is not None
    assert held.id == block.id


def test_how_long_it_waits_counts_from_its_start() -> None:
    for body, told in (
        ("ExchangeBin: {bin: red_bin, longest: 4 s}", "feed.no_exchange"),
        ("AwaitItems: {longest: 4 s}", "feed.late"),
    ):
        cell, _ = cell_with(f"Sequence: [{{Delay: {{delay_msec: 5000, do: AlwaysSuccess}}}}, {{{body}}}]",
                            loads=1, delay=None)  # fmt: skip
        status, said, ended = outcome(cell)
        assert (status, said.partition(":")[0]) == ("FAILURE", told)
        assert ended == pytest.approx(9.0, abs=0.2)
        assert cell.failure.evidence["waited"] == pytest.approx(4.0)


def test_the_arm_may_be_in_the_way_now_and_then() -> None:
    """It counts how long it was so without a pause."""
    for body in ("ExchangeBin: {bin: red_bin, clearance: 1 s}", "AwaitItems: {clearance: 1 s}"):
        cell, feed = cell_with(body, loads=1, delay=0.05, obstructed_until=0.9)
        cell.tick()
        read, began = feed.read, cell.world.clock.now

        def with_a_pause(read: Any = read, began: float = began, cell: Cell = cell) -> Any:
            pause = 0.9 <= cell.world.clock.now - began < 1.0
            busy = cell.world.clock.now - began < 1.8
            now = busy and not pause
            return replace(read(), exhausted=False, deliveries=0, exchanges={}, obstructed=now)

        feed.read = with_a_pause  # type: ignore[method-assign]
        for _ in range(36):
            cell.tick()
            assert cell.running, body


def test_an_exchange_that_nobody_waited_for_to_the_end_is_heard_of_later() -> None:
    cell, feed, _ = placed("ExchangeBin: {bin: red_bin, clearance: 0.5 s}", obstructed_until=90.0)
    told = "feed.obstructed: red_bin has not been exchanged for 0.5 s: the arm is over it"
    assert outcome(cell)[:2] == ("FAILURE", told)
    feed.obstructed_until = 0.0
    for _ in range(20):
        cell.wait()
    cell.start(mission("ExchangeBin: {bin: red_bin}"))
    began = cell.world.clock.now
    assert outcome(cell)[:2] == ("SUCCESS", "")
    assert cell.world.clock.now == began
    assert feed.heard == ["exchange red_bin"]
    assert cell.world.scene.objects == ()


def test_an_item_is_set_aside_at_the_second_time_and_stays_where_it_is_seen() -> None:
    cell, _, before = with_a_block()
    aside = f"SetAside: {{object: {before.id}, after: 2}}"
    assert cell.do(aside) == ""
    assert cell.world.facts()["items_to_do"] == 1
    assert cell.do(aside) == ""
    assert cell.do(LOOK) == ""
    assert cell.happened("set_aside") == [f"set_aside: {before.id} is left where it lies"]
    (after,) = cell.world.scene.objects
    assert (after.id, after.place) == (before.id, "aside")
    assert after.pose.distance(before.pose) < 0.005
    assert cell.world.facts()["items_to_do"] == 0
    assert cell.tree.blackboard.save()["Main/items"] == []
    assert cell.world.attempts.state() == {}


def test_what_lies_on_a_belt_is_forgotten_when_it_may_run() -> None:
    cell, _, before = with_a_block(loads=1)
    belt = Belt(ObjectId("table"), speed=0.1, eye=0.3)
    cell.world = replace(cell.world, description=replace(cell.world.description, belts=(belt,)))
    cell.world.attempts.failed("Main", before.id, "a grasp")
    assert cell.do("AwaitItems") == ""
    assert cell.world.scene.objects == ()
    assert cell.world.attempts.state() == {}


def test_what_is_in_the_hand_cannot_be_set_aside_and_what_is_gone_need_not() -> None:
    cell, _, block = with_a_block()
    cell.world.scene.attach(block.id, Pose())
    held = f"place.missed: {block.id} is in the hand: let go of it first"
    assert cell.do(f"SetAside: {{object: {block.id}}}") == held
    assert cell.do("SetAside: {object: red_can_9}") == ""
