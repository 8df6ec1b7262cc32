"""A newcomer's way through the studio in a browser: from an empty folder to a comparison of two runs."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ..browser import Chromium, Told, wait_until
from ..needs import CHROMIUM, needs
from .conftest import PATIENCE, Served
from .server_process import studio_process
from .test_live import end_runs

pytestmark = needs(CHROMIUM)
NAME = "sort_tirelessly.yaml"


@pytest.fixture
def page(tmp_path: Path, state_home: Path, chromium: Chromium) -> Iterator[tuple[Any, Told, Served]]:
    """The studio of an empty folder, by its command, in a browser."""
    folder = tmp_path / "cell"
    folder.mkdir()
    with studio_process(folder) as studio, chromium.blank(studio.address) as (browser, told):
        browser.set_default_timeout(PATIENCE * 1000)
        browser.goto(studio.served.link)
        yield browser, told, studio.served
        end_runs(folder)


def test_from_an_example_to_a_comparison(page: tuple[Any, Told, Served]) -> None:
    browser, told, served = page
    take_an_example(browser)
    break_and_mend(browser)
    identity = run_it(browser, served.folder)
    find_the_failure(browser, identity)
    what_if_and_compare(browser, identity)
    assert told.requests == []
    assert told.problems == []


def take_an_example(browser: Any) -> None:
    browser.get_by_role("button", name="Copy the examples here").click()
    browser.get_by_role("link", name="Missions", exact=True).click()
    browser.get_by_role("link", name=NAME).click()
    browser.get_by_text("✓ No faults").wait_for()


def break_and_mend(browser: Any) -> None:
    cured = browser.locator('[data-tree-node="SortAll/Sequence/LookTwice"]')
    line = browser.locator(".cm-line", has_text="- LookTwice:")
    line.click()  # the picture goes where the cursor is
    cured.wait_for()
    line.get_by_text("LookTwice", exact=True).dblclick()
    browser.keyboard.type("LookTwiec")
    browser.keyboard.press("Escape")
    # At its place in both views.
    broken = browser.locator('[data-tree-node="SortAll/Sequence/LookTwiec"]')
    broken.locator(".tree-faults").wait_for()
    assert browser.locator(".tree-faults").count() == 1
    assert browser.locator(".cm-lintRange-error").all_inner_texts() == ["LookTwiec"]
    browser.get_by_role("button", name="Write LookTwice").click()
    browser.get_by_text("✓ No faults").wait_for()
    cured.wait_for()
    wait_until(browser, "document.querySelectorAll('.tree-faults, .cm-lintRange-error').length === 0")


def run_it(browser: Any, folder: Path) -> str:
    """Start the mission with a planted slip, change a value, answer it; return the identity of its run."""
    browser.get_by_role("button", name="Run …").click()
    assert browser.get_by_label("Mission", exact=True).input_value() == NAME
    assert browser.get_by_label("Backend").input_value() == "physics"
    browser.get_by_label("Backend").select_option("kinematic")
    browser.get_by_label("Faults").select_option("faults/slip.yaml")
    browser.get_by_label("cures").fill("0")  # a cure must be asked for
    browser.get_by_role("button", name="Start", exact=True).click()
    browser.get_by_role("button", name="Pause", exact=True).click()
    browser.get_by_text("Stopped at").wait_for()

    browser.get_by_role("button", name="Change Main/rounds").click()
    value = browser.get_by_label("New value of Main/rounds")
    value.fill("2")
    value.press("Enter")
    browser.get_by_text("Main/rounds is set to 2 by the operator; it was 6").first.wait_for()

    browser.get_by_role("button", name="Go on", exact=True).click()
    browser.get_by_role("heading", name="Help is wanted").wait_for()
    browser.get_by_role("alertdialog").get_by_role("button", name="go on").click()
    browser.get_by_text("The run has ended: success.").wait_for()
    identity: str = browser.evaluate("decodeURIComponent(location.hash.slice('#/live/'.length))")
    result = json.loads((folder / identity / "result.json").read_text(encoding="utf-8"))
    assert result["status"] == "success"
    return identity


def find_the_failure(browser: Any, identity: str) -> None:
    browser.get_by_role("link", name="Runs", exact=True).click()
    browser.get_by_label("Condition").fill("'grasp.slipped' in causes")
    browser.keyboard.press("Enter")
    browser.get_by_text("1 run").wait_for()
    browser.get_by_role("link", name="sort tirelessly").click()
    wait_until(browser, f"decodeURIComponent(location.hash).startsWith('#/run/{identity}')")
    assert "item.slipped" in browser.get_by_role("region", name="Root causes").inner_text()
    report = browser.frame_locator("iframe")
    report.locator("html[data-ready=yes]").wait_for(state="attached")
    failure = browser.locator(".failures button.failure", has_text="grasp.slipped").first
    failure.click()
    moment = re.search(r"([\d.]+) s", failure.locator("time").inner_text())
    assert moment is not None
    wait_until(
        browser, f"Math.abs(new URLSearchParams(location.hash.split('?')[1]).get('t') - {moment[1]}) < 0.01"
    )
    assert report.locator("#clock").inner_text() == f"{moment[1]} s"


def what_if_and_compare(browser: Any, identity: str) -> None:
    browser.get_by_role("button", name="What if …").click()
    browser.get_by_label("Mission from").select_option("sort_by_colour.yaml")
    browser.get_by_text("sort_by_colour.yaml is as it is.").wait_for()
    browser.get_by_role("button", name="Go on from there").click()
    dialog = browser.locator("dialog")
    dialog.locator(".job[data-outcome=done]").wait_for()
    dialog.get_by_text("recorded  what if").wait_for()
    dialog.locator(".job").get_by_role("link", name="Open").click()
    browser.get_by_role("heading", name="sort by colour").wait_for()
    wait_until(browser, f"!decodeURIComponent(location.hash).includes('{identity}')")

    browser.get_by_role("button", name="Compare …").click()
    browser.get_by_label("The other run").fill("tirelessly")
    dialog.get_by_role("button", name=re.compile("sort tirelessly")).click()
    dialog.locator(".job[data-outcome=no]").wait_for()
    dialog.get_by_text("they part at").wait_for()
    browser.keyboard.press("Escape")
    dialog.wait_for(state="detached")
