"""The page of a batch in a browser: what it shows, on a desk and on a phone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from picktree.apps.batch import RESULTS_FILE, BatchPlan, Job, Store, write_report
from picktree.apps.batch.plan import write_plan
from picktree.apps.batch.tables import (
    EpisodeRow,
    FigureRow,
    JobFailureRow,
    JobPickRow,
    JobRows,
    JobTimingRow,
    PlantedRow,
)
from picktree.logs import FigureCounts

from ..browser import Chromium, Told
from ..needs import CHROMIUM, needs
from .test_store import ITEMS, MISSED, SLIP, SUCCESS

pytestmark = needs(CHROMIUM)

LABELS = ("Grasp.force=1.5 N", "Grasp.force=30 N")
EPISODES = (
    EpisodeRow(
        4.0, "grasp.slipped", "Main/Grasp", "can_1", "cured", "LookAgain", "LookAgain", "Main", 1, 2.5625
    ),
    EpisodeRow(5.0, "world.lost", "Main/Observe", "can_2", "unhandled", "", "", "", 0, 10.0),
)
DONE = FigureCounts(units=2, entered=2, first_pass=2)
PLANTED = PlantedRow(3.5, "slip", "it slips", "item_0", "grasp.slipped", 0.5, "cured")
LOST = JobFailureRow(5.0, "Main/Observe", "world.lost", "it is gone", "can_2", "passed_over", "", None)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Page of 2 recipes with 12 seeds: the first misses its goal on every third seed, one job waits."""
    folder = tmp_path_factory.mktemp("page") / "night shift"
    folder.mkdir()
    plan = BatchPlan(
        "grip", (Path("/m/sort.yaml"),), tuple(range(12)), settings={"Grasp.force": ("1.5 N", "30 N")}
    )
    write_plan(plan, folder)
    pairs = [(variant, seed) for variant in plan.variants() for seed in plan.seeds]
    jobs = [Job(f"{n:016x}", n, v, seed, "recipe") for n, (v, seed) in enumerate(pairs)]
    (folder / "jobs/kept").mkdir(parents=True)
    (folder / "jobs/kept/report.html").write_text("<!doctype html><title>the run</title>")
    sorted_items = tuple(replace(item, bin="red_bin", verdict="sorted") for item in ITEMS)
    with Store.create(folder / RESULTS_FILE, jobs) as store:
        for n, job in enumerate(jobs[:-1]):
            bad = n < 12 and n % 3 == 0
            row = replace(SUCCESS, sim_seconds=10.0 + n % 5)
            if bad:
                cause = "perception.mistaken" if n else "item.slippery"
                row = replace(MISSED, root_cause=cause, folder="jobs/kept" if n == 0 else "")
            elif n == 20:
                row = replace(row, root_cause="item.slippery")
            store.record(
                job.id,
                JobRows(
                    row,
                    items=ITEMS if bad else sorted_items,
                    picks=(JobPickRow(1.0, "can_1", not bad, "Main/Grasp"),),
                    failures=(SLIP, SLIP, LOST) if bad else (),
                    episodes=EPISODES if bad else (),
                    planted=(PLANTED,) if bad else (),
                    timings=(JobTimingRow("grasp", 6.0), JobTimingRow("place", 3.0)),
                    figures=(
                        FigureRow.of(
                            FigureCounts(units=2 - bad, entered=2, first_pass=2 - bad, given_up=bad)
                        ),
                    ),
                    versions={"numpy": "2.0"},
                ),
            )
    page = folder.parent / "page.html"
    write_report(folder, page)
    return page


def texts(page: Any, selector: str) -> list[str]:
    return [text.strip() for text in page.locator(selector).all_text_contents() if text.strip()]


@pytest.fixture(scope="module")
def desk(report: Path, chromium: Chromium) -> Iterator[tuple[Any, Told]]:
    """One page for most tests: loading it costs more than they do."""
    with chromium.page(report) as opened:
        yield opened


@pytest.fixture
def page(desk: tuple[Any, Told]) -> Iterator[Any]:
    """Page of all recipes; its errors and requests fail the test."""
    page, told = desk
    page.get_by_role("radio", name="all recipes").check()
    yield page
    assert (told.problems, told.requests) == ([], [])


def test_it_says_what_came_of_the_batch_without_a_word_or_a_request(page: Any) -> None:
    assert page.title() == "Batch grip"
    assert page.locator("#subtitle").inner_text() == (
        "23 of 24 jobs run, goal reached 19 of 23 (82.6 %, 62.9 … 93.0 %)"
    )
    first = page.locator("#recipes tbody tr").first.locator("td").all_inner_texts()
    assert first == [
        "Grasp.force=1.5 N", "12", "66.7 % (39.1 … 86.2 %)", "83.3 % (64.1 … 93.3 %)",
        "66.7 % (39.1 … 86.2 %)", "541 (467 … 609)", "33.2 s (13.0 s … 2.0 min)",
        "83.3 % (64.1 … 93.3 %)", "0",
    ]  # fmt: skip
    for figure in ("success", "rates", "phases", "causes", "forms", "colours", "places"):
        assert page.locator(f"#{figure} svg").count() >= 1, figure
    # Pareto: causes in order, and the line's shares.
    pareto = texts(page, "#causes svg text")
    assert [t for t in pareto if "." in t] == ["grasp.slipped", "world.lost"]
    assert [t for t in pareto if t.endswith(" %")] == ["67 %", "100 %"]
    cures = page.locator("#cures table").first.locator("tbody tr")
    assert [cures.nth(n).locator("td").all_inner_texts() for n in range(cures.count())] == [
        ["world.lost", "4", "0.0 % (0.0 … 49.0 %)", "–", "40.0", "nobody, 4 times"],
        ["grasp.slipped", "4", "100.0 % (51.0 … 100.0 %)", "1.0", f"{10.25:.1f}", "LookAgain 4 of 4"],
    ]
    planted = page.locator("#cures table.planted tbody td").all_inner_texts()
    assert planted == ["slip", "4", "4 grasp.slipped, cured"]
    assert texts(page, "#phases figure span")[:2] == ["observe", "think"]


def test_root_causes_stand_with_the_goals_that_they_cost_and_a_typical_job(page: Any) -> None:
    rows = page.locator("#roots tbody tr")
    assert [rows.nth(n).locator("td").all_inner_texts() for n in range(rows.count())] == [
        ["perception.mistaken", "3", "3", "seed 3, Grasp.force=1.5 N\n4.00 s: slipped"],
        ["item.slippery", "2", "1", "seed 0, Grasp.force=1.5 N\n4.00 s: slipped"],
    ]
    assert (
        page.locator("#worst li")
        .nth(1)
        .inner_text()
        .startswith("incomplete seed 3, Grasp.force=1.5 N, 1 item not sorted perception.mistaken")
    )
    page.get_by_role("radio", name=LABELS[1]).check()
    assert rows.locator("td").all_inner_texts() == ["item.slippery", "1", "0", "seed 8, Grasp.force=30 N"]


def test_what_is_below_the_choice_is_of_the_chosen_recipe(page: Any) -> None:
    missed = "#places g[aria-label=text] text"
    assert texts(page, "#choice label") == ["all recipes", *LABELS]
    assert texts(page, missed) == ["4"]  # beside it every item was sorted
    page.get_by_role("radio", name=LABELS[1]).check()
    assert texts(page, "#causes") == texts(page, "#cures") == ["Nothing failed."]
    assert texts(page, missed) == []
    page.get_by_role("radio", name=LABELS[0]).check()
    assert page.locator("#causes svg").count() >= 1
    assert texts(page, missed) == ["4"]


def test_a_job_tells_of_itself_and_the_worst_lead_on(report: Path, chromium: Chromium) -> None:
    with chromium.page(report) as (page, _):
        assert texts(page, "#jobs .legend span") == ["19 success", "4 incomplete", "1 waiting"]
        tiles = page.locator("#jobs button.tile")
        assert tiles.count() == 24
        tiles.nth(0).click()
        said = page.locator("#jobs [role=status]")
        assert said.inner_text() == (
            "seed 0, Grasp.force=1.5 N: incomplete, 1 of 2 items sorted, 10 simulated s; "
            "4.00 s: slipped report"
        )
        tiles.nth(23).click()
        assert said.inner_text() == "seed 11, Grasp.force=30 N: waiting"
        worst = page.locator("#worst li")
        assert worst.count() == 4
        assert worst.nth(0).inner_text().splitlines()[:3] == [
            "incomplete seed 0, Grasp.force=1.5 N, 1 item not sorted item.slippery", "4.00 s: slipped",
            "report of the run",
        ]  # fmt: skip
        command = worst.nth(1).locator("code").last.inner_text()
        assert command == f"picktree resim '{report.parent / 'night shift'}@{3:016x}'"
        worst.nth(0).get_by_role("link").click()
        page.wait_for_load_state()
        assert page.title() == "the run"


def test_pointing_at_a_figure_tells_the_numbers(page: Any) -> None:
    page.locator("#success circle").first.hover(force=True)
    page.wait_for_timeout(200)
    assert "8 of 12, 39.1 … 86.2 %" in " ".join(texts(page, "#success g[aria-label=tip] text"))
    page.locator("#places g[aria-label=rect] rect").first.hover(force=True)
    page.wait_for_timeout(200)
    told = " ".join(texts(page, "#places g[aria-label=tip] text"))
    assert "23 of 23 sorted" in told and "0.40 … 0.45 m" in told


@pytest.mark.parametrize("dark", [False, True])
def test_it_fits_a_phone(report: Path, chromium: Chromium, dark: bool) -> None:
    with chromium.page(report, (390, 844), dark=dark, touch=True) as (page, told):
        assert page.evaluate("document.documentElement.scrollWidth") == 390
        wide = page.evaluate(
            """[...document.querySelectorAll("section *, svg")].filter((e) =>
               e.getBoundingClientRect().right > 391).map((e) => e.outerHTML.slice(0, 80))"""
        )
        assert wide == []
        assert page.locator("#recipes td").nth(2).evaluate(
            "e => getComputedStyle(e, '::before').content"
        ) == ('"goal reached"')
        paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert paper == ("rgb(17, 21, 27)" if dark else "rgb(246, 247, 249)")
        assert told.problems == []
