"""A session with keys alone: from an empty folder to the explanation of a failure."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

from ..browser import Chromium, Told, wait_until
from ..needs import CHROMIUM, needs
from .conftest import Served, opened
from .test_live import end_runs

pytestmark = needs(CHROMIUM)
MOST = 150
"""Number of presses of Tab after which a control counts as out of reach."""
FOCUSED = "(element) => element === document.activeElement"


class Keys:
    """Keyboard of a page. Controls are found as a screen reader names them: by role and name."""

    def __init__(self, browser: Any) -> None:
        self.browser = browser

    def press(self, *keys: str) -> None:
        for key in keys:
            self.browser.keyboard.press(key)

    def to(self, role: str, name: str | re.Pattern[str]) -> Any:
        """Press Tab until a control has the focus; return it."""
        control = self.browser.get_by_role(role, name=name, exact=True).first
        control.wait_for()
        for _ in range(MOST):
            if control.evaluate(FOCUSED):
                return control
            self.press("Tab")
        raise AssertionError(f"Tab does not reach the {role} {name!r}")

    def enter(self, role: str, name: str | re.Pattern[str]) -> None:
        self.to(role, name)
        self.press("Enter")

    def choose(self, name: str, option: str) -> None:
        """Choose an option of a list by typing its beginning."""
        control = self.to("combobox", name)
        self.browser.keyboard.type(option)
        assert control.evaluate("(list) => list.selectedOptions[0].text").startswith(option)


@pytest.fixture
def page(served: Served, chromium: Chromium) -> Iterator[tuple[Keys, Told]]:
    """The studio of an empty folder in a browser."""
    with opened(served, chromium) as (browser, told):
        yield Keys(browser), told
    end_runs(served.folder)


def test_a_session_with_keys_alone(served: Served, page: tuple[Keys, Told]) -> None:
    keys, told = page
    browser = keys.browser
    keys.enter("button", "Copy the examples here")
    keys.enter("link", "Missions")
    keys.enter("link", "sort_by_colour.yaml")
    browser.get_by_text("✓ No faults").wait_for()

    # A comment in the text, a value in the form; the tree is walked with arrows.
    keys.to("textbox", "Text of sort_by_colour.yaml")
    keys.press("Control+Home")
    browser.keyboard.type("# written with keys\n")
    keys.to("tree", re.compile("^Tree of"))
    keys.press("Home", "ArrowRight", "ArrowDown", "ArrowRight")
    browser.get_by_role("treeitem", name=re.compile("^Recover"), selected=True).wait_for()
    browser.locator(".node-form header code", has_text="do").first.wait_for()
    attempts = keys.to("combobox", "attempts")  # the keys of the blackboard are offered with it
    keys.press("Control+a")
    browser.keyboard.type("7")
    keys.press("Enter")
    browser.get_by_role("treeitem", name=re.compile("attempts: 7"), selected=True).wait_for()
    assert attempts.evaluate(FOCUSED)
    keys.to("tab", "Node")
    keys.press("ArrowRight", "ArrowRight")
    keys.enter("button", "Rehearse")
    browser.get_by_text(re.compile("All cases pass|Some cases fail")).wait_for()
    keys.to("textbox", "Text of sort_by_colour.yaml")
    keys.press("Control+s")
    browser.get_by_text("sort_by_colour.yaml saved").wait_for()
    text = (served.folder / "sort_by_colour.yaml").read_text(encoding="utf-8")
    assert text.startswith("# written with keys\n") and "attempts: 7" in text

    # A run with a planted slip, stopped and stepped.
    keys.enter("link", "Run")
    keys.choose("Mission", "one_pick.yaml")
    keys.choose("Backend", "kinematic")
    keys.choose("Pace", "a quarter of real time")  # it must not be over before a busy machine shows it
    keys.choose("Faults", "faults/slip.yaml")
    keys.enter("button", "Start")
    keys.enter("button", "Pause")
    browser.get_by_text("Stopped at").wait_for()
    time = browser.locator(".live-time")
    before = float(time.get_attribute("data-time"))
    keys.enter("button", "Step a tick")
    wait_until(browser, f"Number(document.querySelector('.live-time').dataset.time) > {before + 0.01}")
    assert float(time.get_attribute("data-time")) == pytest.approx(before + 0.05)
    keys.enter("button", "Go on")
    browser.get_by_text(re.compile("The run has ended")).wait_for()

    # It is found in the index by its mission, and its failure by the explanation.
    keys.enter("link", "Runs")
    keys.to("searchbox", "Words")
    browser.keyboard.type("one slip")
    browser.get_by_text("1 run").wait_for()
    keys.to("row", re.compile("one pick"))
    keys.press("Enter")
    failure = browser.get_by_role("region", name="Failures").get_by_role("button").first
    failure.wait_for()
    browser.get_by_role("button", name=re.compile("slipped")).first.wait_for()
    keys.enter("button", re.compile("slipped"))
    wait_until(browser, "new URLSearchParams(location.hash.split('?')[1]).get('t') > 0")
    assert told.problems == []
