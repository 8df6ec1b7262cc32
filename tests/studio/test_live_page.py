"""Run in a browser: start, pause, step, set a value, go on, answer, end; on a phone; accessibility."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from picktree.analysis import Run

from ..browser import Chromium, Told, wait_until
from ..needs import CHROMIUM, needs, packages
from .conftest import Served, opened
from .test_live import MISSION, end_runs
from .test_page import serious

pytestmark = needs(CHROMIUM)
MARKUP = '<img src=x onerror="globalThis.ran=1">'


@pytest.fixture
def page(served: Served, chromium: Chromium) -> Iterator[tuple[Any, Told]]:
    """The studio in a browser, with the mission in its folder."""
    marked = MISSION.replace("is it there?", f"is it there? {MARKUP.replace(chr(34), chr(39))}")
    (served.folder / "asking.yaml").write_text(marked)
    (served.folder / "faulty.yaml").write_text(MISSION.replace("Observe", "Obzerve"))
    with opened(served, chromium) as found:
        yield found
    end_runs(served.folder)


@needs(packages("studio"))
def test_a_run_is_started_paused_stepped_changed_answered_and_found(
    served: Served, page: tuple[Any, Told], chromium: Chromium
) -> None:
    browser, told = page
    browser.get_by_role("link", name="Run", exact=True).click()
    browser.get_by_label("Mission").select_option("asking.yaml")
    browser.get_by_label("Backend").select_option("kinematic")
    assert browser.get_by_label("rounds").get_attribute("placeholder") == "40"
    assert serious(browser) == []
    browser.get_by_role("button", name="Start", exact=True).click()
    browser.get_by_role("button", name="Pause").click()
    browser.get_by_text("Stopped at").wait_for()

    time = browser.locator(".live-time")
    before = float(time.get_attribute("data-time"))
    browser.get_by_role("button", name="Step a tick").click()
    wait_until(browser, f"Number(document.querySelector('.live-time').dataset.time) > {before + 0.01}")
    assert float(time.get_attribute("data-time")) == pytest.approx(before + 0.05)

    browser.get_by_role("button", name="Change Main/rounds").click()
    value = browser.get_by_label("New value of Main/rounds")
    value.fill("two")
    value.press("Enter")
    browser.get_by_text("'two' is not a whole number").wait_for()
    value.fill("30")
    value.press("Enter")
    browser.get_by_text("Main/rounds is set to 30 by the operator; it was 40").first.wait_for()

    browser.locator(".tree-card", has_text="Repeat").click()
    browser.get_by_role("button", name="Break before").click()
    browser.locator(".tree-breakpoint").wait_for()
    browser.wait_for_selector(".live-view canvas")
    assert serious(browser) == []
    browser.get_by_role("button", name="Go on").click()
    browser.get_by_text(re.compile("before Main/Sequence/Repeat$")).wait_for()

    identity = browser.evaluate("decodeURIComponent(location.hash.slice('#/live/'.length))")
    with chromium.blank(f"http://127.0.0.1:{served.port}/", size=(390, 844)) as (phone, _):
        phone.goto(served.link)
        phone.get_by_role("link", name="Run", exact=True).click()
        phone.get_by_role("link", name=identity).click()
        phone.get_by_text(re.compile("before Main/Sequence/Repeat$")).wait_for()
        for tab in phone.locator(".live-tabs button").all():
            tab.click()
            assert fits(phone), tab.inner_text()
        phone.get_by_role("button", name="Go on").click()
        phone.get_by_role("button", name="Pause").click()
        phone.get_by_text("Stopped at").wait_for()
        assert fits(phone)
        phone.get_by_role("button", name="Go on").click()
        phone.get_by_role("heading", name="Help is wanted").wait_for()
        assert fits(phone)
        assert serious(phone) == []
        phone.get_by_role("button", name="yes").click()
        browser.get_by_text("The run has ended: success.").wait_for()
    assert browser.evaluate("globalThis.ran") is None
    assert browser.get_by_role("link", name="Open the run").get_attribute("href") == f"#/run/{identity}"
    result = json.loads((served.folder / identity / "result.json").read_text())
    assert result["status"] == "success"
    with Run(served.folder / identity) as run:
        kinds = [at.record.kind for at in run.events]
    assert ("blackboard_set" in kinds, "operator_answer" in kinds) == (True, True)
    assert told.problems == []


def fits(phone: Any) -> bool:
    """Whether the page needs no horizontal scrolling."""
    return bool(phone.evaluate("document.documentElement.scrollWidth <= innerWidth"))


def test_faults_of_a_mission_are_shown_before_its_start(page: tuple[Any, Told]) -> None:
    browser, told = page
    browser.evaluate("location.hash = '#/live?mission=faulty.yaml'")
    browser.get_by_text("This mission has faults").wait_for()
    assert "faulty.yaml:10:" in browser.locator("[role=alert] pre").inner_text()
    assert told.problems == []


def test_a_run_that_is_over_leads_to_its_page(page: tuple[Any, Told], tmp_path: Path) -> None:
    browser, _ = page
    browser.evaluate("location.hash = '#/live/runs/gone'")
    browser.get_by_text("This run is not in progress").wait_for()
    assert browser.get_by_role("link", name="Open it").get_attribute("href") == "#/run/runs/gone"
