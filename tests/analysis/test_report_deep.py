"""The page of a mission as deep as `sort_tirelessly`: names, keys and the failing leaf, without a mouse."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from picktree.analysis import Run
from picktree.analysis.report import write_report
from picktree.world import BlackboardWrite

from ..browser import Chromium, Told, on_top, wait_until
from ..logs.scripted_log import Seen, begins, ends, record, tree
from ..needs import CHROMIUM, needs

pytestmark = needs(CHROMIUM)

DEPTH = 17
CHAIN = ["Main", *(f"Main/{'/'.join(f'Sequence{n}' for n in range(1, k + 1))}" for k in range(1, DEPTH + 1))]
LEAVES = [f"{CHAIN[-1]}/{name}" for name in ("Grasp", "Place")]
SIZES = ((1440, 900), (1280, 800), (390, 844))


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two failures of a leaf below seventeen nodes, and keys with the paths of all of them."""
    folder = tmp_path_factory.mktemp("deep")
    up = [
        replace(ends(path, "FAILURE", "grasp.slipped", LEAVES[1]), message="it slipped")
        for path in (LEAVES[1], *reversed(CHAIN[1:]))
    ]
    down = [begins(path) for path in CHAIN[1:]]
    script = {
        0: [begins("Main"), *down, begins(LEAVES[0], "red_block_1"), *_writes()],
        20: [ends(LEAVES[0]), begins(LEAVES[1], "red_block_1")],
        30: up,
        31: [*down, begins(LEAVES[1], "red_block_1")],
        40: up,
    }
    nodes = tree(*(f"{path}:Sequence" for path in CHAIN), *LEAVES)
    log = record(folder / "log.mcap", nodes, 60, script, seen=[Seen("red_block_1", 0.4)])
    with Run(log) as run:
        write_report(run, folder / "report.html")
    return folder / "report.html"


def _writes() -> list[BlackboardWrite]:
    return [
        BlackboardWrite(f"{path}/{name}", ["red_block_1"] * 40 if name == "items" else 3, path)
        for path in CHAIN[::4]
        for name in ("items", "tries")
    ]


@pytest.fixture(scope="module", params=SIZES, ids=[f"{width}" for width, _ in SIZES])
def page(report: Path, chromium: Chromium, request: Any) -> Iterator[Any]:
    size: tuple[int, int] = request.param
    with chromium.page(report, size=size, touch=size[0] < 700) as (opened, told):
        yield opened
    assert told == Told()


def front(page: Any, panel: str) -> None:
    """Bring a panel into sight, by its tab on a phone."""
    page.evaluate(f"picktreeReport.shell.show('{panel}')")


def test_n_leads_to_the_failing_leaf_and_opens_its_story(page: Any) -> None:
    page.keyboard.press("n")
    assert wait_until(page, f"picktreeReport.player.node === '{LEAVES[1]}'")
    stories = "[...document.querySelectorAll('.story details')].map((one) => one.open)"
    assert page.evaluate(stories) == [True, False]
    page.keyboard.press("n")
    assert page.evaluate(stories) == [False, True]
    page.keyboard.press("p")
    assert page.evaluate(stories) == [True, False]


def test_a_story_that_its_reader_opened_stays_open(page: Any) -> None:
    page.evaluate("picktreeReport.player.selectFailure(0)")
    page.evaluate("document.querySelectorAll('.story details')[1].open = true")
    page.evaluate("picktreeReport.player.selectFailure(1)")
    page.evaluate("picktreeReport.player.selectFailure(0)")
    assert page.evaluate("[...document.querySelectorAll('.story details')].map((one) => one.open)") == [
        True,
        True,
    ]
    page.evaluate("document.querySelectorAll('.story details')[1].open = false")


def test_every_name_beside_the_lanes_has_room(page: Any) -> None:
    front(page, "lanes")
    widths = page.evaluate(
        """() => [...document.querySelectorAll(".lanes-name .said")].map((one) => {
            const line = one.closest(".lanes-name").getBoundingClientRect();
            const { left, right } = one.getBoundingClientRect();
            return [Math.min(right, line.right) - left, one.scrollWidth];
        })"""
    )
    assert len(widths) == len(CHAIN) + 2
    assert [pair for pair in widths if pair[0] < min(pair[1], 32) - 1] == []


@pytest.mark.parametrize("first", ["lanes", "failures"])
def test_the_row_of_the_failing_leaf_is_in_sight(page: Any, first: str) -> None:
    """Chosen before or after the lanes are shown, which on a phone are behind a tab."""
    front(page, first)
    page.evaluate("picktreeReport.player.selectFailure(null); picktreeReport.player.selectNode('Main')")
    page.evaluate("picktreeReport.player.selectFailure(1)")
    front(page, "lanes")
    assert wait_until(
        page,
        """(() => {
            const row = document.querySelector(".lanes-name.selected").getBoundingClientRect();
            const box = document.querySelector(".lanes-scroll").getBoundingClientRect();
            return row.top >= box.top - 1 && row.bottom <= Math.min(box.bottom, innerHeight) + 1;
        })()""",
        seconds=60.0,
    )
    row = page.locator(".lanes-name.selected")
    assert row.evaluate_all("rows => rows.map((row) => row.title)") == [LEAVES[1]]
    assert row.locator(".said").inner_text().startswith("Place")
    assert on_top(page, ".lanes-name.selected .dot")


def test_keys_and_values_of_the_blackboard_share_the_panel(page: Any) -> None:
    front(page, "board")
    page.evaluate("picktreeReport.player.seek(1)")
    rows = page.evaluate(
        """() => [...document.querySelectorAll(".blackboard tr:has(td)")].map((row) => {
            const [key, value] = [row.querySelector("th"), row.querySelector("td.value")];
            return [key.textContent, key.title, key.offsetWidth, value.offsetWidth];
        })"""
    )
    table, panel = page.evaluate(
        "[document.querySelector('.blackboard'), document.getElementById('body-board')]"
        ".map((one) => [one.offsetWidth, one.offsetHeight])"
    )
    assert [key for key, *_ in rows] == ["items", "tries"] * len(CHAIN[::4])
    assert [title for _, title, *_ in rows] == [write.key for write in _writes()]
    assert table[0] <= panel[0]
    assert all(key < value and value > 0.35 * table[0] for *_, key, value in rows)
    assert table[1] < 2500
    headings = page.locator(".blackboard .scope b").all_inner_texts()
    assert headings == [path.rsplit("/", 1)[-1] for path in CHAIN[::4]]


def test_the_tree_shows_the_failing_leaf_among_the_nodes_around_it(page: Any) -> None:
    front(page, "tree")
    page.evaluate("picktreeReport.player.selectFailure(null); picktreeReport.player.seek(0)")
    page.evaluate("picktreeReport.player.selectFailure(1)")
    assert wait_until(
        page,
        f"""(() => {{
            const sheet = document.querySelector(".tree-sheet").getBoundingClientRect();
            const [low, high] = [Math.min(sheet.right, innerWidth), Math.min(sheet.bottom, innerHeight)];
            const boxOf = (path) =>  // none until it is drawn
                document.querySelector(`[data-path="${{path}}"]`)?.getBoundingClientRect();
            const within = (box) => box
                && box.left >= sheet.left && box.right <= low && box.top >= sheet.top && box.bottom <= high;
            return {[LEAVES[1], LEAVES[0], CHAIN[-1]]}.every((path) => within(boxOf(path)));
        }})()""",
        seconds=60.0,
    )
    for path, name in ((LEAVES[1], "Place"), (LEAVES[0], "Grasp")):
        assert page.locator(f'[data-path="{path}"]').text_content().startswith(name)
        assert on_top(page, f'[data-path="{path}"]')
