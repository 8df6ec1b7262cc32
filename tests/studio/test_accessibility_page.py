"""Accessibility of every page, panel and dialog, light and dark, by axe-core: no serious finding."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from typing import Any

import pytest

from picktree.files.file_system import ROOT
from picktree.world.scene.scene_loading import SHIPPED

from ..browser import Chromium
from ..needs import CHROMIUM, needs, packages
from .conftest import Served, opened
from .test_live import MISSION, end_runs
from .test_page import go, serious

pytestmark = [needs(CHROMIUM), needs(packages("studio"))]
NAME = "sort_by_colour.yaml"
PLAN = "picktree: 1\nkind: plan\nmissions: [sort_by_colour.yaml]\nseeds: 0:4\nbackend: kinematic\n"


@pytest.fixture
def browser(served: Served, chromium: Chromium) -> Iterator[Any]:
    """The studio of a folder with missions, cases, a scene and a plan, in a browser."""
    folder = served.folder
    mission = (ROOT / "examples" / NAME).read_text(encoding="utf-8")
    (folder / NAME).write_text(mission.replace("scene: three_bins ", "scene: cell.yaml "), encoding="utf-8")
    (folder / "cases").mkdir()
    shutil.copyfile(ROOT / "examples" / "cases" / NAME, folder / "cases" / NAME)
    scene = re.sub(r"  nut: .*\n|, nut: 1", "", (SHIPPED / "three_bins.yaml").read_text(encoding="utf-8"))
    (folder / "cell.yaml").write_text(scene, encoding="utf-8")
    (folder / "asking.yaml").write_text(MISSION, encoding="utf-8")
    (folder / "night.yaml").write_text(PLAN, encoding="utf-8")
    with opened(served, chromium) as (page, _):
        yield page
    end_runs(folder)


def findings(page: Any) -> list[str]:
    """Return the serious findings on what is shown, in light and dark."""
    found: list[str] = []
    for theme in ("light", "dark"):
        page.evaluate("(theme) => { document.documentElement.dataset.theme = theme; }", theme)
        found += [f"{theme}: {each}" for each in serious(page)]
    return found


def close_dialog(page: Any) -> None:
    page.keyboard.press("Escape")
    page.locator("dialog").wait_for(state="detached")


def test_the_start_the_index_and_plans(served: Served, browser: Any) -> None:
    assert findings(browser) == [], "start"
    browser.get_by_role("button", name="Trust this folder …").click()
    assert findings(browser) == [], "dialog of trust"
    close_dialog(browser)
    go(browser, "#/runs")
    browser.get_by_text("No run in this folder yet").wait_for()
    assert findings(browser) == [], "index without a run"
    go(browser, "#/plan/night.yaml")
    browser.get_by_text("Matrix: 1 × 4 seeds").wait_for()
    assert findings(browser) == [], "plan"
    go(browser, "#/nowhere")
    browser.get_by_text("There is no such page here").wait_for()
    assert findings(browser) == [], "no such page"


def test_a_mission_with_its_panels_and_its_menu(served: Served, browser: Any) -> None:
    go(browser, "#/write")
    browser.get_by_role("link", name=NAME).wait_for()
    assert findings(browser) == [], "missions"
    go(browser, f"#/write/{NAME}")
    browser.get_by_text("✓ No faults").wait_for()
    browser.locator(".cm-line", has_text="- Grasp:").click()
    browser.get_by_label("force, N").wait_for()
    assert findings(browser) == [], "form of a node"
    browser.locator(".tree-card.selected").click(button="right")
    browser.get_by_role("menu").wait_for()
    assert findings(browser) == [], "menu of a node"
    browser.keyboard.press("Escape")
    browser.get_by_role("tab", name="Add").click()
    browser.get_by_role("combobox", name="Search a node").wait_for()
    assert findings(browser) == [], "palette"
    browser.get_by_role("combobox", name="Search a node").fill("grip")
    assert findings(browser) == [], "palette with a search"
    browser.get_by_role("tab", name="Scene").click()
    browser.get_by_role("button", name="Save cell.yaml").wait_for()
    browser.get_by_label("Fixture or bin").select_option("red_bin")
    browser.get_by_role("button", name=re.compile("What .* sees")).first.click()
    browser.locator(".views img").first.wait_for()
    assert findings(browser) == [], "scene"
    browser.get_by_role("tab", name="Rehearse").click()
    browser.get_by_role("button", name="Rehearse", exact=True).click()
    browser.get_by_text("All cases pass").wait_for()
    assert findings(browser) == [], "rehearsal"
    # A fault, and the offers of the completion.
    word = browser.locator(".cm-line", has_text="- Grasp:").get_by_text("Grasp", exact=True)
    for _ in range(3):  # a line that scrolls below the mouse has another word there
        word.dblclick()
        if browser.evaluate("getSelection().toString()") == "Grasp":
            break
    browser.keyboard.type("Gras")
    browser.locator(".tree-faults").wait_for()
    browser.keyboard.press("Control+Space")
    browser.locator(".cm-tooltip-autocomplete").wait_for()
    assert findings(browser) == [], "completion"
    browser.keyboard.press("Escape")
    assert findings(browser) == [], "fault"


def test_a_run_that_goes_on_with_its_question_and_its_dialogs(served: Served, browser: Any) -> None:
    go(browser, "#/live?mission=asking.yaml")
    browser.get_by_label("rounds").wait_for()
    assert findings(browser) == [], "form of a run"
    order = {"mission": "asking.yaml", "backend": "kinematic", "parameters": {"rounds": "2"}, "pace": 0.0}
    with served.client() as client:
        identity = client.call("live.start", order=order)
        go(browser, f"#/live/{identity}")
        browser.get_by_role("heading", name="Help is wanted").wait_for()
        assert findings(browser) == [], "question"
        browser.locator(".tree-card", has_text="Wait").click()
        browser.get_by_role("button", name="Ports and values").click()
        assert findings(browser) == [], "node of a run"
        browser.get_by_role("button", name="Change Main/rounds").click()
        assert findings(browser) == [], "change of an entry"
        for side in ("Speed and force", "Camera"):
            browser.get_by_role("button", name=side).click()
            assert findings(browser) == [], side
        for button in ("Take over a mission …", "Halt …"):
            browser.get_by_role("button", name=button).click()
            assert findings(browser) == [], button
            close_dialog(browser)
        client.call("live.command", id=identity, line="answer yes")
    browser.get_by_text("The run has ended: success.").wait_for()
    assert findings(browser) == [], "run that has ended"

    go(browser, f"#/run/{identity}")
    browser.locator(".explanation").wait_for()
    assert findings(browser) == [], "run"
    for button in ("What if …", "Compare …"):
        browser.get_by_role("button", name=button).click()
        browser.locator("dialog").wait_for()
        assert findings(browser) == [], button
        close_dialog(browser)
    browser.get_by_role("button", name=re.compile("Jobs")).click()
    browser.get_by_role("button", name="Output").first.click()
    assert findings(browser) == [], "jobs"
    close_dialog(browser)
    go(browser, "#/runs")
    browser.get_by_role("link", name="asking").wait_for()
    assert findings(browser) == [], "index"
