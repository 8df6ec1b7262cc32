"""The views answer what they say they answer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from picktree.apps.batch import Store, summarise
from picktree.apps.batch.tables import EpisodeRow, JobPickRow, JobRows, JobTimingRow, PlantedRow
from picktree.logs import rate

from .test_store import ITEMS, MISSED, SLIP, SUCCESS, store


def picks(*held: tuple[str, bool]) -> tuple[JobPickRow, ...]:
    return tuple(JobPickRow(float(n), name, good, "Main/Grasp") for n, (name, good) in enumerate(held))


CURED = EpisodeRow(
    4.0, "grasp.slipped", "Main/Grasp", "can_1", "cured", "LookAgain", "LookAgain", "Main", 1, 2.5
)
IN_VAIN = replace(
    CURED, ended="given_up", handler="SetAside", tried="LookAgain, SetAside", tries=2, seconds=6.0
)
ALONE = EpisodeRow(5.0, "planning.no_path", "Main/GoTo", "", "unhandled", "", "", "", 0, 0.5)
SLIPS = PlantedRow(3.9, "slip", "it slips", "item_0", "grasp.slipped", 0.1, "cured")
UNSEEN = replace(SLIPS, cause="", after=None, ended="")


@pytest.fixture
def results(tmp_path: Path) -> Iterator[Store]:
    """Two recipes with two seeds: A fails on seed 1, B is slow on seed 0; B's seed 1 waits."""
    with store(tmp_path / "b", {}, values=("A", "B"), seeds=2) as made:
        slow = replace(SUCCESS, sim_seconds=30.0)
        for number, row, took, failures, episodes, planted in (
            (0, SUCCESS, picks(("can_1", True), ("can_2", True)), (), (), (UNSEEN,)),
            (
                1,
                MISSED,
                picks(("can_1", False), ("can_2", False), ("can_1", True)),
                (SLIP, SLIP),
                (CURED, replace(CURED, tries=3), IN_VAIN),
                (SLIPS,),
            ),
            (2, slow, picks(("can_1", False), ("can_1", True)), (SLIP,), (CURED, ALONE), ()),
        ):
            timings = (JobTimingRow("grasp", 6.0), JobTimingRow("think", 2.0))
            rows = JobRows(
                row,
                items=ITEMS,
                picks=took,
                failures=failures,
                episodes=episodes,
                planted=planted,
                timings=timings,
            )
            assert made.record(f"{number:016x}", rows)
        yield made


@pytest.mark.parametrize(
    ("sql", "rows"),
    [
        ("SELECT variant, jobs, successes FROM success", (("Grasp.force=A", 2, 1), ("Grasp.force=B", 1, 1))),
        ("SELECT seed, rate FROM units_an_hour ORDER BY rate", ((0, 240.0), (1, 360.0), (0, 720.0))),
        (
            "SELECT variant, phase, seconds, seconds_a_pick, share FROM cycle_time",
            (
                ("Grasp.force=A", "grasp", 12.0, 3.0, 0.75),
                ("Grasp.force=A", "think", 4.0, 1.0, 0.25),
                ("Grasp.force=B", "grasp", 6.0, 3.0, 0.75),
                ("Grasp.force=B", "think", 2.0, 1.0, 0.25),
            ),
        ),
        ("SELECT * FROM first_try", (("Grasp.force=A", 4, 2, 0.5, 5), ("Grasp.force=B", 1, 0, 0.0, 2))),
        (
            "SELECT cause, failures, cured, jobs, seconds_lost FROM causes",
            (("grasp.slipped", 3, 3, 2, 13.5),),
        ),
        (
            "SELECT variant, failures, jobs FROM causes_by_recipe",
            (("Grasp.force=A", 2, 1), ("Grasp.force=B", 1, 1)),
        ),
        (
            "SELECT job, cause, handler, seen, cured, given_up, unhandled, open, tries, tries_cured, seconds "
            "FROM cures ORDER BY job, cause, handler",
            (
                (f"{1:016x}", "grasp.slipped", "LookAgain", 2, 2, 0, 0, 0, 4, 4, 5.0),
                (f"{1:016x}", "grasp.slipped", "SetAside", 1, 0, 1, 0, 0, 2, 0, 6.0),
                (f"{2:016x}", "grasp.slipped", "LookAgain", 1, 1, 0, 0, 0, 1, 1, 2.5),
                (f"{2:016x}", "planning.no_path", "", 1, 0, 0, 1, 0, 0, 0, 0.5),
            ),
        ),
        (
            "SELECT variant, cause, handler, seen, cured FROM cures_by_recipe",
            (
                ("Grasp.force=A", "grasp.slipped", "LookAgain", 2, 2),
                ("Grasp.force=A", "grasp.slipped", "SetAside", 1, 0),
                ("Grasp.force=B", "grasp.slipped", "LookAgain", 1, 1),
                ("Grasp.force=B", "planning.no_path", "", 1, 0),
            ),
        ),
        (
            "SELECT cause, seen, cured, unhandled, share, tries_a_cure, seconds, jobs FROM cures_by_cause",
            (
                ("grasp.slipped", 4, 3, 0, 0.75, 5 / 3, 13.5, 2),
                ("planning.no_path", 1, 0, 1, 0.0, None, 0.5, 1),
            ),
        ),
        (
            "SELECT variant, fault, cause, ended, faults, after FROM planted_seen",
            (
                ("Grasp.force=A", "slip", "", "", 1, None),
                ("Grasp.force=A", "slip", "grasp.slipped", "cured", 1, 0.1),
            ),
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


def test_the_interval_of_a_cure_is_wilsons(results: Store) -> None:
    found: list[tuple[float, ...]] = []
    for row in results.query("SELECT cured, seen, low, high FROM cures_by_cause").rows:
        cured, seen, low, high = (float(str(value)) for value in row)
        interval = rate(int(cured), int(seen)).interval
        found.append((low - interval.low, high - interval.high))
    assert len(found) == 2
    assert found == [pytest.approx((0.0, 0.0), abs=1e-12)] * 2


def test_the_summary_says_what_was_tried_and_with_which_success(results: Store) -> None:
    summary = summarise(results)
    text = summary.to_text()
    assert (
        "cause             episodes  cured of those to be cured       tries   s lost  by\n"
        "grasp.slipped            4  3 of 4 (75.0 %, 30.1 … 95.4 %)     1.7     13.5  "
        "LookAgain 3 of 3, SetAside 0 of 1\n"
        "planning.no_path         1  0 of 1 (0.0 %, 0.0 … 79.3 %)                0.5  nobody 1\n"
        "\n"
        "planted 2 slip, first seen as: 1 nothing, 1 grasp.slipped (cured)\n"
    ) in text
    cures = summary.to_json()["by_recipe"]["Grasp.force=A"]["cures"]
    assert [(each["cause"], each["rate"]["successes"], each["seen"]) for each in cures] == [
        ("grasp.slipped", 2, 3)
    ]
    assert [(each["cure"], each["cured"], each["seen"]) for each in cures[0]["by"]] == [
        ("LookAgain", 2, 2),
        ("SetAside", 0, 1),
    ]


def test_places_on_both_sides_of_zero_have_cells_of_one_size(tmp_path: Path) -> None:
    item = ITEMS[0]
    places = (-0.06, -0.05, -0.01, 0.0, 0.049, 0.3, 0.35)
    items = tuple(replace(item, item=f"item_{n}", x=0.4, y=y) for n, y in enumerate(places))
    with store(tmp_path / "b", {}) as made:
        made.record(f"{0:016x}", JobRows(SUCCESS, items=items))
        found = made.query("SELECT round(y, 6), items FROM sorted_by_place").rows
    assert found == ((-0.1, 1), (-0.05, 2), (0.0, 2), (0.3, 1), (0.35, 1))
