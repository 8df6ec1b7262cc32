"""A cursor over a run, on logs that were made up for it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import pytest

from picktree.analysis import Cursor, Run
from picktree.files import PicktreeError, find_node, find_nodes
from picktree.world import BlackboardWrite, JournalEvent, OtherEvent, Plan, Transition

from ..logs.scripted_log import Seen, begins, ends, record, tree

NODES = tree("Main:ForEach", "Main/Part:Sequence", "Main/Part/Grasp", "Main/Part/Place", object="{item}")
PART, GRASP, PLACE = "Main/Part", "Main/Part/Grasp", "Main/Part/Place"
GOLDEN = Path(__file__).parents[1] / "logs" / "golden" / "format-2.mcap"
SCRIPT: Mapping[int, Sequence[Transition | BlackboardWrite | JournalEvent | Plan]] = {
    0: [begins("Main")],
    2: [BlackboardWrite("Main/item", "red_block_1", "Main"), begins(PART), begins(GRASP, "red_block_1")],
    5: [
        ends(GRASP, "FAILURE", "grasp.missed", width=0.0),
        ends(PART, "FAILURE", "grasp.missed", GRASP),
        OtherEvent("passed over", "Main", name="handled"),
    ],
    6: [BlackboardWrite("Main/item", "red_block_2", "Main"), begins(PART), begins(GRASP, "red_block_2")],
    9: [ends(GRASP), begins(PLACE, "red_block_2")],
    12: [ends(PLACE, "FAILURE", "place.missed"), ends(PART, "FAILURE", "place.missed", PLACE), ends("Main")],
}


@pytest.fixture
def cursor(tmp_path: Path) -> Iterator[Cursor]:
    seen = [Seen("red_block_1", 0.4), Seen("red_block_2", 0.6, tick=4)]
    path = record(tmp_path / "log.mcap", NODES, 15, SCRIPT, seen=seen)
    with Run(path) as run:
        yield Cursor(run)


def test_it_steps_by_ticks_and_stops_at_the_ends(cursor: Cursor) -> None:
    cursor.step(3)
    cursor.step(-1)
    assert (cursor.number, cursor.time, len(cursor)) == (2, pytest.approx(0.1), 15)
    cursor.step(100)
    assert cursor.number == 14
    with pytest.raises(PicktreeError, match=r"^this is the last tick$"):
        cursor.step()
    cursor.step(-100)
    with pytest.raises(PicktreeError, match=r"^this is the first tick$"):
        cursor.step(-1)


def test_it_goes_to_times_and_ticks(cursor: Cursor) -> None:
    cursor.to_time(0.26)
    assert cursor.number == 5
    cursor.to_time(99.0)
    assert cursor.number == 14
    cursor.to_tick(7)
    assert cursor.tick.number == 7
    with pytest.raises(PicktreeError, match=r"^there is no tick 15: the log has ticks 0 to 14$"):
        cursor.to_tick(15)
    assert cursor.number == 7


def test_it_goes_to_changes(cursor: Cursor) -> None:
    went: list[int] = []
    for _ in range(5):
        cursor.next_change()
        went.append(cursor.number)
    assert went == [2, 5, 6, 9, 12]
    with pytest.raises(PicktreeError, match=r"^there is no change after 0\.60 s$"):
        cursor.next_change()
    cursor.next_change(back=True)
    assert cursor.number == 9


def test_it_goes_to_failures_of_nodes_themselves(cursor: Cursor) -> None:
    assert cursor.failure is None
    first = cursor.next_failure()
    assert (cursor.number, first.path, first.item, first.evidence) == (
        5,
        GRASP,
        "red_block_1",
        {"width": 0.0},
    )
    assert cursor.next_failure().path == PLACE
    assert cursor.failure is not None and cursor.failure.cause == "place.missed"
    with pytest.raises(PicktreeError, match=r"^there is no failure after 0\.60 s$"):
        cursor.next_failure()
    assert cursor.next_failure(back=True).number == first.number
    assert len(cursor.failures) == 2


def test_it_goes_to_the_beginnings_and_ends_of_nodes(cursor: Cursor) -> None:
    assert cursor.next_of("Grasp").item == "red_block_1"
    assert (cursor.next_of("Grasp").item, cursor.number) == ("red_block_2", 6)
    assert (cursor.next_of("Grasp", "end").outcome, cursor.number) == ("SUCCESS", 9)
    assert (cursor.next_of("Main/*/Grasp", "end", back=True).outcome, cursor.number) == ("FAILURE", 5)
    assert (cursor.next_of("Part", back=True).path, cursor.number) == (PART, 2)
    with pytest.raises(PicktreeError, match=r"^there is no begin of Grasp before 0\.10 s$"):
        cursor.next_of("Grasp", back=True)
    with pytest.raises(PicktreeError, match=r"^no node fits 'Grsap' \(did you mean 'Grasp'\?\)$"):
        cursor.next_of("Grsap")
    assert cursor.number == 2


def test_it_goes_to_items(cursor: Cursor) -> None:
    assert (cursor.next_item("red_block_2").path, cursor.number) == (PART, 6)
    with pytest.raises(PicktreeError, match=r"^no node was about 'blue_can_1'$"):
        cursor.next_item("blue_can_1")


def test_it_stops_where_it_was_told(cursor: Cursor) -> None:
    stops = {(PLACE, "begin"), (GRASP, "end")}
    cursor.next_stop(stops)  # pyright: ignore[reportArgumentType] - a set of pairs of literals
    assert cursor.number == 5
    cursor.next_stop(stops)  # pyright: ignore[reportArgumentType]
    assert cursor.number == 9


def test_what_changed_is_told_by_kind_and_in_order(cursor: Cursor) -> None:
    cursor.to_tick(6)
    changes = cursor.changes(2)
    assert [(move.tick, move.transition.path, move.transition.status) for move in changes.moves] == [
        (5, GRASP, "FAILURE"), (5, PART, "FAILURE"), (6, PART, "RUNNING"), (6, GRASP, "RUNNING")
    ]  # fmt: skip
    assert [(one.tick, one.write.value) for one in changes.writes] == [(6, "red_block_2")]
    assert [at.record.object for at in changes.belief] == ["red_block_2"]
    assert [at.record.kind for at in changes.events] == ["handled"]
    alone = cursor.changes(9)  # it lies ahead
    assert (alone.since, alone.to, len(alone.moves)) == (5, 6, 2)
    cursor.to_tick(0)
    assert [at.record.object for at in cursor.changes().belief] == ["red_block_1"]


def test_what_is_there(cursor: Cursor) -> None:
    assert cursor.blackboard == {}
    cursor.to_tick(6)
    assert cursor.blackboard == {"Main/item": "red_block_2"}
    assert cursor.belief is not None and [body.id for body in cursor.belief.bodies] == [
        "red_block_1", "red_block_2"
    ]  # fmt: skip
    assert [visit.path for visit in cursor.visits] == ["Main", PART, GRASP]
    last = cursor.last_visit(GRASP)
    assert last is not None and last.item == "red_block_2"
    assert cursor.last_visit(PLACE) is None
    assert (cursor.joints, cursor.wrench, cursor.control) == (None, None, None)


def test_a_log_of_format_2_is_stepped_through() -> None:
    with Run(GOLDEN) as run:
        cursor = Cursor(run)
        assert cursor.run.log.format == 2
        failed = cursor.next_failure()
        assert (failed.path, failed.cause, cursor.time) == ("/Main/Grasp", "grasp.missed", pytest.approx(1.5))


def test_nodes_are_called_by_path_end_type_or_pattern() -> None:
    nodes = NODES.nodes
    assert [node.path for node in find_nodes("Main/Part", nodes)] == [PART]
    assert [node.path for node in find_nodes("Part/Grasp", nodes)] == [GRASP]
    assert [node.path for node in find_nodes("Sequence", nodes)] == [PART]
    assert [node.path for node in find_nodes("Part/*", nodes)] == [GRASP, PLACE]
    with pytest.raises(PicktreeError, match=r"^2 nodes fit 'Part/\*': Main/Part/Grasp, Main/Part/Place$"):
        find_node("Part/*", nodes)
