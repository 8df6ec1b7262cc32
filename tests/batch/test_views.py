"""The views answer what they say they answer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from picktree.batch.rows import JobRows, PickRow, TimingRow
from picktree.batch.store import Store

from .test_store import ITEMS, MISSED, SLIP, SUCCESS, store


def picks(*held: tuple[str, bool]) -> tuple[PickRow, ...]:
    return tuple(PickRow(float(n), name, good, "Main/Grasp") for n, (name, good) in enumerate(held))


@pytest.fixture
def results(tmp_path: Path) -> Iterator[Store]:
    """Two recipes with two seeds: A fails on seed 1, B is slow on seed 0; B's seed 1 waits."""
    with store(tmp_path / "b", {}, values=("A", "B"), seeds=2) as made:
        slow = replace(SUCCESS, sim_seconds=30.0)
        for number, row, took, failures in (
            (0, SUCCESS, picks(("can_1", True), ("can_2", True)), ()),
            (1, MISSED, picks(("can_1", False), ("can_2", False), ("can_1", True)), (SLIP, SLIP)),
            (2, slow, picks(("can_1", False), ("can_1", True)), (SLIP,)),
        ):
            timings = (TimingRow("grasp", 6.0), TimingRow("think", 2.0))
            rows = JobRows(row, items=ITEMS, picks=took, failures=failures, timings=timings)
            assert made.record(f"{number:016x}", rows)
        yield made


@pytest.mark.parametrize(
    ("sql", "rows"),
    [
        ("SELECT variant, jobs, successes FROM success", (("Grasp.force=A", 2, 1), ("Grasp.force=B", 1, 1))),
        ("SELECT seed, rate FROM picks_an_hour ORDER BY rate", ((0, 240.0), (0, 720.0), (1, 720.0))),
        (
            "SELECT variant, phase, seconds, seconds_a_pick, share FROM cycle_time",
            (
                ("Grasp.force=A", "grasp", 12.0, 3.0, 0.75),
                ("Grasp.force=A", "think", 4.0, 1.0, 0.25),
                ("Grasp.force=B", "grasp", 6.0, 3.0, 0.75),
                ("Grasp.force=B", "think", 2.0, 1.0, 0.25),
            ),
        ),
        (
            "SELECT * FROM first_try",
            (("Grasp.force=A", 4, 2, 0.5, 5), ("Grasp.force=B", 1, 0, 0.0, 2)),
        ),
        ("SELECT cause, failures, cured, jobs, seconds_lost FROM causes", (("grasp.slipped", 3, 3, 2, 7.5),)),
        (
            "SELECT variant, failures, jobs FROM causes_by_recipe",
            (("Grasp.force=A", 2, 1), ("Grasp.force=B", 1, 1)),
        ),
        ("SELECT * FROM failures_by_seed", ((1, 1, 0, 2, 1), (0, 2, 2, 1, 0))),
        ("SELECT * FROM sorted_by_form", (("cylinder", 6, 3),)),
        ("SELECT * FROM sorted_by_colour", (("red", 6, 3),)),
        (
            "SELECT round(x, 6), round(y, 6), items, sorted FROM sorted_by_place",
            ((0.4, 0.1, 3, 3), (0.5, 0.1, 3, 0)),
        ),
        ("SELECT seed, variant, seconds_a_pick FROM slowest LIMIT 1", ((0, "Grasp.force=B", 15.0),)),
        ("SELECT job, seed, missed, look_at FROM worst", ((f"{1:016x}", 1, 1, "4.00 s: slipped"),)),
    ],
    ids=lambda value: value.partition("FROM ")[2].split()[0] if isinstance(value, str) else "",
)
def test_a_view_answers(results: Store, sql: str, rows: tuple[tuple[object, ...], ...]) -> None:
    assert results.query(sql).rows == rows


def test_places_on_both_sides_of_zero_have_cells_of_one_size(tmp_path: Path) -> None:
    item = ITEMS[0]
    places = (-0.06, -0.05, -0.01, 0.0, 0.049, 0.3, 0.35)
    items = tuple(replace(item, item=f"item_{n}", x=0.4, y=y) for n, y in enumerate(places))
    with store(tmp_path / "b", {}) as made:
        made.record(f"{0:016x}", JobRows(SUCCESS, items=items))
        found = made.query("SELECT round(y, 6), items FROM sorted_by_place").rows
    assert found == ((-0.1, 1), (-0.05, 2), (0.0, 2), (0.3, 1), (0.35, 1))
