"""The node `Jog`: what it comes to, what it fails with, and what is wrong at load already."""

from __future__ import annotations

import pytest

from picktree.files import PicktreeError
from picktree.simulation import Backend

from .cell import Cell, items, mission


def cell(body: str, backend: Backend = "kinematic") -> Cell:
    one = Cell(mission(body), items(block=1), backend)
    one.finish()
    return one


@pytest.mark.parametrize("backend", ["kinematic", "physics"])
def test_a_distance_and_back(backend: Backend) -> None:
    one = cell(
        """\
Sequence:
  - Jog: {velocity: [0, 100 mm/s, 0], distance: 80 mm, travelled: "{way}"}
  - Jog: {velocity: [0, -0.1, 0], duration: 0.8 s, stopped_by: "{end}"}
""",
        backend,
    )
    assert one.told == ""
    assert one.world.control.tcp.position[1] == pytest.approx(0.0, abs=6e-3)
    board = one.tree.blackboard.save()
    assert float(str(board["Main/way"])) == pytest.approx(0.08, abs=1e-3)
    assert board["Main/end"] == "done"


def test_what_stops_it_is_a_failure_or_what_was_wanted() -> None:
    pads = "panda_leftfinger at table, panda_rightfinger at table"
    text = f"planning.blocked: stopped before a collision ({pads}) after 477 mm of a jog"
    assert cell("Jog: {velocity: [0, 0, -0.2]}").told == text
    one = cell('Jog: {velocity: [0, 0, -0.2], when_stopped: succeed, stopped_by: "{end}"}')
    assert (one.told, one.tree.blackboard.save()["Main/end"]) == ("", "collision")


@pytest.mark.parametrize(
    ("body", "text"),
    [
        ("Jog: {distance: 10 mm}", "'velocity' or 'turn' must be given"),
        ("Jog: {velocity: [0, 1]}", "three numbers x, y, z are wanted, not 2"),
        ("Jog: {velocity: [0, 0, -0.7]}", "a jog does at most 0.5 m/s, not 0.7"),
        ("Jog: {turn: [0, 3, 0]}", "a jog does at most 2 rad/s, not 3"),
        ("Jog: {velocity: [0, 0, -0.1], frame: base}", "frame"),
    ],
)
def test_keys_that_do_not_fit_are_found_at_load(body: str, text: str) -> None:
    with pytest.raises(PicktreeError) as caught:
        mission(body)
    assert text in str(caught.value)


@pytest.mark.parametrize("backend", ["kinematic", "physics"])
def test_halted_at_any_tick_the_arm_stands_soon(backend: Backend) -> None:
    body = "Jog: {velocity: [0.1, 0.2, -0.1], turn: [0, 0, 0.5], duration: 1 s}"
    for ticks in (1, 9, 22):
        one = Cell(mission(body), items(block=1), backend)
        for _ in range(ticks):
            one.tick()
        one.halt()
        assert one.rest() <= 0.5
        assert one.world.control.monitor.stopped is None


def test_as_fast_as_allowed_is_allowed_in_space_and_about_it() -> None:
    for ports in ("velocity: [0.3, 0, 0.4]", "turn: [1.2, 0, 1.6]"):
        mission(f"Jog: {{{ports}, duration: 1 s}}")


@pytest.mark.parametrize(
    ("numbers", "told"),
    [
        ([0.0, 0.1], "a jog needs three numbers x, y, z, not [0.0, 0.1]"),
        ([0.0, 0.0, 0.1], ""),
    ],
)
def test_what_is_read_at_run_time_must_be_three_numbers(numbers: list[float], told: str) -> None:
    one = Cell(mission("Jog: {velocity: '{v}', duration: 100 ms}"), items(block=1))
    one.tree.blackboard.write("Main/v", numbers, "test")
    one.finish()
    assert (one.told == "") is (told == "")
    assert told in one.told
