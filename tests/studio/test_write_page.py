"""A mission in the browser: broken, mended, changed by the picture and by the form, rehearsed and saved."""

from __future__ import annotations

import shutil
from typing import Any

from picktree.files.file_system import ROOT

from ..browser import Chromium, Told, wait_until
from ..needs import CHROMIUM, needs
from .conftest import Served
from .test_page import go, page, serious

__all__ = ["page"]
pytestmark = needs(CHROMIUM)
NAME = "sort_by_colour.yaml"


def card(browser: Any, node: str) -> Any:
    return browser.locator(f'[data-tree-node="{node}"]')


def written(browser: Any) -> str:
    """Return the lines of the text that the editor shows."""
    return "\n".join(browser.locator(".cm-line").all_inner_texts())


def test_a_mission_is_broken_mended_changed_and_saved(served: Served, page: tuple[Any, Told]) -> None:
    browser, told = page
    shutil.copyfile(ROOT / "examples" / NAME, served.folder / NAME)
    (served.folder / "cases").mkdir()
    shutil.copyfile(ROOT / "examples" / "cases" / NAME, served.folder / "cases" / NAME)
    before = (served.folder / NAME).read_text(encoding="utf-8")
    go(browser, f"#/write/{NAME}")
    browser.get_by_text("✓ No faults").wait_for()
    grasp = "SortOne/Recover/Sequence/Grasp"
    line = browser.locator(".cm-line", has_text="- Grasp:")
    line.click()  # the picture follows the cursor
    card(browser, grasp).and_(browser.locator(".selected")).wait_for()

    # Broken: the fault is at its place in the text and in the picture.
    line.get_by_text("Grasp", exact=True).dblclick()
    browser.keyboard.type("Graps")
    browser.keyboard.press("Escape")
    card(browser, "SortOne/Recover/Sequence/Graps").locator(".tree-faults").wait_for()
    assert browser.locator(".cm-lintRange-error").inner_text() == "Graps"
    assert browser.locator(".tree-faults").count() == 1

    # Mended by its quick fix.
    browser.get_by_role("button", name="Write Grasp").click()
    browser.get_by_text("✓ No faults").wait_for()
    card(browser, grasp).wait_for()

    # Folded away, and unfolded by the cursor in its text.
    card(browser, grasp).and_(browser.locator(".selected")).wait_for()
    browser.get_by_role("tree").focus()
    for key in ("ArrowLeft", "-"):
        browser.keyboard.press(key)
    card(browser, grasp).wait_for(state="detached")
    browser.wait_for_timeout(800)  # the text comes to what was chosen
    line.get_by_text(
        "Grasp", exact=True
    ).click()  # the line itself is wider than the view, which would be scrolled
    card(browser, grasp).and_(browser.locator(".selected")).wait_for()

    # A node from the palette, behind the selected one, by keyboard; undone by the history of the text.
    card(browser, grasp).click()
    browser.get_by_role("tab", name="Add").click()
    browser.get_by_role("combobox", name="Search a node").fill("OpenGr")
    browser.keyboard.press("Enter")
    added = card(browser, "SortOne/Recover/Sequence/OpenGripper")
    added.wait_for()
    assert "          - OpenGripper\n" in written(browser)
    browser.get_by_role("button", name="Undo").click()
    added.wait_for(state="detached")

    # A port in the form.
    card(browser, grasp).click()
    browser.get_by_role("tab", name="Node").click()
    browser.get_by_label("force, N").fill("20 N")
    browser.keyboard.press("Enter")
    card(browser, grasp).get_by_text("force: 20 N").wait_for()
    assert not serious(browser), "\n".join(serious(browser))

    # Saved: one line is another one.
    browser.get_by_role("button", name="Save").click()
    wait_until(browser, "document.querySelector('.write-bar button').disabled")
    expected = before.replace('- Grasp: {object: "{item}"}', '- Grasp: {object: "{item}", force: 20 N}')
    assert expected != before
    assert (served.folder / NAME).read_text(encoding="utf-8") == expected

    # Rehearsed: the picture shows what the cases reach.
    browser.get_by_role("tab", name="Rehearse").click()
    browser.get_by_role("button", name="Rehearse", exact=True).click()
    browser.get_by_text("All cases pass").wait_for()
    assert "covered 100 %" in (card(browser, grasp).get_attribute("aria-label") or "")
    assert told.problems == []


def test_what_was_typed_is_there_again(served: Served, page: tuple[Any, Told], chromium: Chromium) -> None:
    browser, _ = page
    shutil.copyfile(ROOT / "examples" / NAME, served.folder / NAME)
    go(browser, f"#/write/{NAME}")
    browser.locator(".cm-line").first.click()
    browser.keyboard.press("Control+Home")
    browser.keyboard.type("# not saved\n")
    with served.client() as client:
        wait_until(browser, "document.querySelector('.cm-line').textContent === '# not saved'")
        browser.wait_for_timeout(1000)
        assert client.call("files.read", path=NAME)["draft"].startswith("# not saved\n")
    browser.reload()
    wait_until(browser, "document.querySelector('.cm-line')?.textContent === '# not saved'")
