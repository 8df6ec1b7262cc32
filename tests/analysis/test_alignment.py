"""Two runs side by side, from logs that were made up for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.analysis.compare import Alignment, align
from picktree.analysis.compare.alignment import ItemPair
from picktree.world import BlackboardWrite, Transition

from ..logs.scripted_log import Seen, begins, ends, record, tree

NODES = tree("Main:Sequence", "Main/Grasp", "Main/Place")
GRASP, PLACE = "Main/Grasp", "Main/Place"
SORTED: Mapping[int, Sequence[Transition]] = {
    0: [begins("Main"), begins(GRASP, "red_block_1")],
    4: [ends(GRASP), begins(PLACE, "red_block_1")],
    8: [ends(PLACE), ends("Main")],
}


def aligned(a: Path, b: Path, since: float = 0.0) -> Alignment:
    with Run(a) as one, Run(b) as other:
        return align(one, other, since=since)


def changed(**changes: Sequence[Transition]) -> dict[int, Sequence[Transition]]:
    """`SORTED` with other ticks: `t4=[…]`."""
    return {**SORTED, **{int(tick[1:]): said for tick, said in changes.items()}}


def test_the_same_run_aligns_with_itself(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", NODES, 9, SORTED, seen=[Seen("red_block_1", 0.4)])
    found = aligned(path, path)
    assert [(pair.a, pair.differs) for pair in found.pairs] == [(pair.b, ()) for pair in found.pairs]
    assert [pair.a.key for pair in found.pairs] == [
        ("", "Main", 1), ("red_block_1", GRASP, 1), ("red_block_1", PLACE, 1)
    ]  # fmt: skip
    assert (found.only_a, found.only_b, found.parting) == ((), (), None)


@pytest.mark.parametrize(
    ("script", "how", "also", "time", "sides"),
    [
        (changed(t4=[ends(GRASP, "FAILURE", "grasp.missed"), begins(PLACE, "red_block_1")]),
         "outcome", ("cause",), 0.2, (GRASP, GRASP)),
        (changed(t4=[], t5=SORTED[4]), "length", (), 0.2, (GRASP, GRASP)),
        (changed(t4=[ends(GRASP), begins(PLACE, "red_block_1", into="red_bin")]),
         "inputs", (), 0.2, (PLACE, PLACE)),
        (changed(t4=[ends(GRASP), begins(GRASP, "red_block_1")]), "order", (), 0.2, (PLACE, GRASP)),
        (changed(t4=[ends(GRASP)], t5=[begins(PLACE, "red_block_1")]), "order", (), 0.2, (PLACE, PLACE)),
        (changed(t8=[ends(PLACE), ends("Main", "FAILURE")]), "outcome", (), 0.4, ("Main", "Main")),
    ],
)  # fmt: skip
def test_where_runs_part(
    tmp_path: Path,
    script: Mapping[int, Sequence[Transition]],
    how: str,
    also: tuple[str, ...],
    time: float,
    sides: tuple[str, str],
) -> None:
    a = record(tmp_path / "a.mcap", NODES, 9, SORTED)
    parting = aligned(a, record(tmp_path / "b.mcap", NODES, 9, script)).parting
    assert parting is not None and parting.a is not None and parting.b is not None
    assert (parting.how, parting.also, parting.time) == (how, also, pytest.approx(time))
    assert (parting.a.path, parting.b.path) == sides
    mirrored = aligned(tmp_path / "b.mcap", a).parting
    assert mirrored is not None and mirrored.a is not None and mirrored.b is not None
    assert (mirrored.how, mirrored.time) == (how, pytest.approx(time))
    assert (mirrored.b.path, mirrored.a.path) == sides


def test_what_began_next_is_told_of_both_sides(tmp_path: Path) -> None:
    a = record(tmp_path / "a.mcap", NODES, 9, SORTED)
    failed = changed(t4=[ends(GRASP, "FAILURE", "grasp.missed"), ends("Main", "FAILURE")], t8=[])
    parting = aligned(a, record(tmp_path / "b.mcap", NODES, 9, failed)).parting
    assert parting is not None and parting.next_a is not None
    assert (parting.how, parting.next_a.path, parting.next_b) == ("outcome", PLACE, None)


def test_a_log_that_is_cut_ends_and_does_not_differ_before(tmp_path: Path) -> None:
    a = record(tmp_path / "a.mcap", NODES, 9, SORTED)
    b = record(tmp_path / "b.mcap", NODES, 6, SORTED)
    parting = aligned(a, b).parting
    assert parting is not None and parting.a is not None and parting.b is not None
    assert (parting.how, parting.time) == ("end", pytest.approx(0.25))
    assert (parting.a.path, parting.b.path) == (PLACE, PLACE)


def test_items_are_paired_by_their_place_not_by_their_numbers(tmp_path: Path) -> None:
    other = {
        0: [begins("Main"), begins(GRASP, "red_block_2", among=["red_block_2", "red_block_1"])],
        4: [ends(GRASP), begins(PLACE, "red_block_2")],
        8: [ends(PLACE), ends("Main")],
    }
    ours = changed(t0=[begins("Main"), begins(GRASP, "red_block_1", among=["red_block_1", "red_block_2"])])
    a = record(tmp_path / "a.mcap", NODES, 9, ours, seen=[Seen("red_block_1", 0.4), Seen("red_block_2", 0.6)])
    b = record(
        tmp_path / "b.mcap", NODES, 9, other, seen=[Seen("red_block_1", 0.601), Seen("red_block_2", 0.401)]
    )
    found = aligned(a, b)
    assert found.items.pairs == (
        ItemPair("red_block_1", "red_block_2", "place"), ItemPair("red_block_2", "red_block_1", "place")
    )  # fmt: skip
    assert found.parting is None


def test_what_is_left_is_paired_by_the_order_of_discovery(tmp_path: Path) -> None:
    a = record(
        tmp_path / "a.mcap", NODES, 9, SORTED,
        seen=[Seen("red_block_1", 0.4), Seen("red_block_2", 0.6, 3), Seen("blue_block_1", 0.5, 0, "blue")],
    )  # fmt: skip
    b = record(
        tmp_path / "b.mcap", NODES, 9, SORTED,
        seen=[Seen("red_block_1", 0.9), Seen("red_block_2", 0.4), Seen("red_block_3", 0.2)],
    )  # fmt: skip
    found = aligned(a, b).items
    assert found.pairs == (
        ItemPair("red_block_1", "red_block_2", "place"), ItemPair("red_block_2", "red_block_1", "order")
    )  # fmt: skip
    assert (found.only_a, found.only_b) == (("blue_block_1",), ("red_block_3",))


def test_with_another_seed_a_place_means_nothing(tmp_path: Path) -> None:
    a = record(
        tmp_path / "a.mcap", NODES, 9, SORTED, seen=[Seen("red_block_1", 0.4), Seen("red_block_2", 0.6)]
    )
    b = record(tmp_path / "b.mcap", NODES, 9, SORTED, seen=[Seen("red_block_1", 0.6)], seed=1)
    assert aligned(a, b).items.pairs == (ItemPair("red_block_1", "red_block_1", "order"),)


def test_what_only_b_has_is_not_taken_for_what_a_calls_so(tmp_path: Path) -> None:
    a = record(tmp_path / "a.mcap", NODES, 9, SORTED, seen=[Seen("red_block_1", 0.4)])
    b = record(
        tmp_path / "b.mcap", NODES, 9, SORTED, seen=[Seen("red_block_1", 0.7), Seen("red_block_2", 0.4)]
    )
    found = aligned(a, b)
    assert found.items.pairs == (ItemPair("red_block_1", "red_block_2", "place"),)
    assert [visit.path for visit in found.only_a] == [visit.path for visit in found.only_b] == [GRASP, PLACE]


WRAPPED = tree(
    "Main:Sequence", "Main/Recover", "Main/Recover/Grasp", "Main/Recover/Retreat", "Main/Place", force="30"
)


def test_nodes_that_were_wrapped_are_the_same_nodes(tmp_path: Path) -> None:
    """A new node around others does not part the runs by itself; what it does then, does."""
    inner, retreat = "Main/Recover/Grasp", "Main/Recover/Retreat"
    a = record(tmp_path / "a.mcap", NODES, 9, changed(
        t4=[ends(GRASP, "FAILURE", "grasp.missed"), ends("Main", "FAILURE", "grasp.missed")], t8=[]
    ))  # fmt: skip
    b = record(tmp_path / "b.mcap", WRAPPED, 9, {
        0: [begins("Main"), begins("Main/Recover"), begins(inner, "red_block_1")],
        4: [ends(inner, "FAILURE", "grasp.missed"), begins(retreat)],
        6: [ends(retreat), ends("Main/Recover"), begins(PLACE, "red_block_1")],
        8: [ends(PLACE), ends("Main")],
    })  # fmt: skip
    found = aligned(a, b)
    assert [(pair.a.path, pair.b.path) for pair in found.nodes.moved] == [(GRASP, inner)]
    assert [(node.path) for node in found.nodes.only_b] == ["Main/Recover", retreat]
    assert [(c.path, c.port, c.a, c.b) for c in found.nodes.rewired] == [(PLACE, "force", "", "30")]
    parting = found.parting
    assert parting is not None and parting.a is not None and parting.next_b is not None
    assert (parting.how, parting.time, parting.a.path) == ("outcome", pytest.approx(0.2), "Main")
    assert (parting.next_a, parting.next_b.path) == (None, retreat)


LOOP = tree("Main:ForEach", "Main/Part:Sequence", "Main/Part/Grasp", "Main/Part/Place")
PART, GRASP_PART, PLACE_PART = "Main/Part", "Main/Part/Grasp", "Main/Part/Place"


def taken(tick: int, item: str) -> dict[int, Sequence[Transition | BlackboardWrite]]:
    return {
        tick: [BlackboardWrite("Main/item", item, "Main"), begins(PART), begins(GRASP_PART, item)],
        tick + 2: [ends(GRASP_PART), begins(PLACE_PART, item)],
        tick + 4: [ends(PLACE_PART), ends(PART)],
    }


def test_a_run_from_a_checkpoint_aligns_with_the_one_that_it_continues(tmp_path: Path) -> None:
    """The same item is taken twice; the checkpoint lies between, and attempts count from there."""
    script: dict[int, Sequence[Transition | BlackboardWrite]] = {
        **taken(0, "red_block_1"),
        **taken(5, "red_block_1"),
    }
    script[0] = [begins("Main", items=["red_block_1"]), *script[0]]
    script[10] = [ends("Main")]
    seen = [Seen("red_block_1", 0.4)]
    a = record(tmp_path / "a.mcap", LOOP, 11, script, seen=seen)
    going_on = {tick: said for tick, said in script.items() if tick > 4}  # it begins with how things stood
    b = record(tmp_path / "b.mcap", LOOP, 11, going_on, seen=seen, first=4, running=["Main"])
    found = aligned(a, b)
    assert found.since == pytest.approx(0.225)
    assert (found.only_a, found.only_b, found.parting) == ((), (), None)
    assert [(p.a.path, p.a.attempt, p.b.attempt, p.differs) for p in found.pairs] == [
        ("Main", 0, 0, ()), (PART, 1, 1, ()), (GRASP_PART, 1, 1, ()), (PLACE_PART, 1, 1, ()),
    ]  # fmt: skip
    assert aligned(a, b, since=0.21).since == found.since


def test_a_part_of_two_whole_runs(tmp_path: Path) -> None:
    """What is under way at the beginning of the part is paired, and what differs before does not matter."""
    a = record(tmp_path / "a.mcap", NODES, 9, SORTED)
    b = record(
        tmp_path / "b.mcap", NODES, 9, changed(t4=[ends(GRASP, "FAILURE"), begins(PLACE, "red_block_1")])
    )
    assert aligned(a, b).parting is not None
    found = aligned(a, b, since=0.22)
    assert [(pair.a.path, pair.a.attempt, pair.a.start) for pair in found.pairs] == [
        ("Main", 0, 0.22), (PLACE, 0, 0.22)
    ]  # fmt: skip
    assert found.parting is None


def test_a_log_in_which_nothing_begins_has_nothing_to_pair(tmp_path: Path) -> None:
    a = record(tmp_path / "a.mcap", NODES, 9, {})
    found = aligned(a, record(tmp_path / "b.mcap", NODES, 7, SORTED))
    assert (found.pairs, found.only_a) == ((), ())
