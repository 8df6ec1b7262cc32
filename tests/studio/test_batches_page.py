"""Batches in the browser: a plan as text and form; eight jobs are started, watched, stopped, resumed."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ..browser import Chromium, Told
from ..needs import CHROMIUM, needs, packages
from .conftest import Served, opened
from .test_page import go, serious

pytestmark = needs(CHROMIUM)
EXAMPLES = Path(__file__).parents[2] / "examples"
PLAN = """picktree: 1
kind: plan
# The missions that are tried.
missions: []
seeds: 0:4
backend: kinematic
keep: all
"""
SLIP = "picktree: 1\nkind: faults\nfaults:\n  - {fault: slip, when: {node: Grasp, start: 1}}\n"


@pytest.fixture
def page(served: Served, chromium: Chromium) -> Iterator[tuple[Any, Told]]:
    """The studio in a browser, on a folder with a mission and faults."""
    shutil.copy(EXAMPLES / "one_pick.yaml", served.folder)
    (served.folder / "slip.yaml").write_text(SLIP, encoding="utf-8")
    (served.folder / "night.yaml").write_text(PLAN, encoding="utf-8")
    with opened(served, chromium) as found:
        yield found


@needs(packages("studio"))
def test_a_batch_of_eight_is_planned_started_stopped_and_resumed(
    served: Served, page: tuple[Any, Told]
) -> None:
    browser, told = page
    go(browser, "#/batches")
    browser.get_by_text("No batch in this folder yet").wait_for()
    browser.get_by_role("link", name="night.yaml").click()

    # The form writes the text, and what is wrong is told.
    browser.locator(".plan-faults").get_by_text("missions").first.wait_for()
    browser.get_by_label("Add to Missions").select_option("one_pick.yaml")
    browser.get_by_label("Faults", exact=True).and_(browser.locator("input")).fill("none, slip.yaml")
    browser.keyboard.press("Enter")
    browser.get_by_text("Matrix: 2 × 4 seeds = 8 jobs").wait_for()
    assert serious(browser) == []
    browser.get_by_role("button", name="Start 8 jobs").click()
    assert browser.locator(".batch-page h1").inner_text().startswith("night")
    written = PLAN.replace("[]", "[one_pick.yaml]\nfaults: [none, slip.yaml]")
    assert (served.folder / "night.yaml").read_text(encoding="utf-8") == written

    bar = browser.get_by_role("progressbar")
    browser.get_by_role("button", name=re.compile("success [12]")).wait_for()
    browser.get_by_role("button", name="Stop").click()
    browser.locator(".outcome.stopped").wait_for()
    assert 1 <= int(bar.get_attribute("aria-valuenow") or 0) < 8
    # Another page finds it again, and goes on with it.
    browser.reload()
    browser.get_by_role("button", name="Go on").click()
    browser.locator(".batch-head .outcome.done").wait_for()
    assert bar.get_attribute("aria-valuenow") == "8"

    # From a bar to the runs behind it.
    cause = browser.locator(".pareto button").first
    cause.wait_for()
    assert "grasp." in cause.inner_text()
    assert serious(browser) == []
    cause.click()
    browser.locator(".behind").get_by_text("seed 0").wait_for()
    assert browser.locator(".behind li").count() == 4
    assert serious(browser) == []
    link = browser.get_by_role("link", name="Open the run").first.get_attribute("href")
    assert link.startswith("#/run/runs/batch-night-")
    assert told.requests == []
    assert told.problems == []
