"""The page in a browser: from an empty folder to a comparison; markup in names is text; accessibility."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import quote

import pytest

from ..browser import Chromium, Told, wait_until
from ..needs import CHROMIUM, needs, packages
from .conftest import PATIENCE, Served, opened
from .hostile_files import IMAGE, LINK, MARKUP, hostile_batch, hostile_log

pytestmark = needs(CHROMIUM)
HERE = Path(__file__).parent / "node"
AXE = HERE / "node_modules" / "axe-core" / "axe.min.js"
FINDINGS = """axe.run({exclude: [["iframe"]]}, {iframes: false}).then((all) => all.violations
    .filter((each) => ["serious", "critical"].includes(each.impact))
    .map((each) => `${each.id}: ${each.nodes.map((node) => node.target)}`))"""


@pytest.fixture
def page(served: Served, chromium: Chromium) -> Iterator[tuple[Any, Told]]:
    """The studio in a browser, its start page open."""
    with opened(served, chromium) as found:
        yield found


def go(page: Any, address: str) -> None:
    page.evaluate("(address) => { location.hash = address; }", address)


def serious(page: Any) -> list[str]:
    """Serious findings of axe-core on the page, frames left out; none where it is missing."""
    if not AXE.is_file():
        return []
    page.evaluate(AXE.read_text(encoding="utf-8"))
    return list(page.evaluate(FINDINGS))


def test_from_an_empty_folder_to_a_what_if_and_a_comparison(
    served: Served, page: tuple[Any, Told], troubled_log: Path
) -> None:
    browser, told = page
    browser.get_by_role("button", name="Copy the examples here").click()
    browser.get_by_text("one_pick.yaml").first.wait_for()
    assert (served.folder / "sort_by_colour.yaml").is_file()
    assert serious(browser) == []

    go(browser, "#/runs")
    browser.get_by_text("No run in this folder yet").wait_for()
    shutil.copytree(troubled_log.parent, served.folder / "runs" / "troubled")
    browser.get_by_role("link", name="sort by colour").wait_for()  # it appears by itself
    assert serious(browser) == []
    browser.get_by_label("Condition").fill("status == 'succes'")
    browser.keyboard.press("Enter")
    browser.get_by_text("did you mean").wait_for()
    browser.get_by_label("Condition").fill("lost > 0 and 'grasp.missed' in causes")
    browser.keyboard.press("Enter")
    browser.get_by_text("1 run").wait_for()
    browser.locator("[data-index='0']").focus()
    browser.keyboard.press("Enter")

    browser.get_by_role("heading", name="sort by colour").wait_for()
    failure = browser.locator(".failures button.failure").first
    failure.wait_for()
    frame = browser.frame_locator("iframe")
    frame.locator("html[data-ready=yes]").wait_for(state="attached")
    failure.click()
    with served.client() as client:
        first = client.call("runs.explain", id="runs/troubled")["failures"][0]["time"]
    wait_until(
        browser, f"Math.abs(new URLSearchParams(location.hash.split('?')[1]).get('t') - {first}) < 0.001"
    )
    assert frame.locator("#clock").inner_text() == f"{first:.2f} s"
    assert serious(browser) == []

    browser.get_by_role("button", name="What if …").click()
    browser.get_by_label("none", exact=True).check()
    editor = browser.get_by_role("textbox", name="Mission", exact=True)
    editor.click()
    browser.keyboard.press("Control+Home")
    browser.keyboard.type("# tried without faults\n")
    assert serious(browser) == []
    browser.get_by_role("button", name="Go on from there").click()
    browser.locator("dialog .job[data-outcome=done], dialog .job[data-outcome=no]").wait_for()
    browser.locator("dialog pre", has_text="what if").wait_for()  # the last of it comes after the end
    edited = served.folder / "sort_by_colour.what-if.yaml"
    before = (served.folder / "sort_by_colour.yaml").read_text(encoding="utf-8")
    assert edited.read_text(encoding="utf-8") == f"# tried without faults\n{before}"
    browser.locator("dialog .job").get_by_role("link", name="Open").click()
    browser.get_by_role("heading", name="sort by colour").wait_for()
    wait_until(browser, "location.hash.startsWith('#/run/runs/') && !location.hash.includes('troubled')")

    browser.get_by_role("button", name="Compare …").click()
    dialog = browser.locator("dialog")
    dialog.get_by_role("button", name=re.compile("troubled")).click()
    dialog.locator(".job[data-outcome=no]").wait_for()
    dialog.get_by_text("the runs diverge at").wait_for()
    assert told.requests == []
    assert told.problems == []


# Number of images, scripts and links that run something.
MADE_OF_TEXT = """[...document.querySelectorAll("main img, main script, dialog img, [onerror], a")]
    .filter((each) => each.localName !== "a" || each.protocol === "javascript:").length"""


def test_markup_in_names_and_messages_is_text(
    served: Served, page: tuple[Any, Told], sample: ModuleType
) -> None:
    browser, told = page
    folder = served.folder / "runs" / '"><img src=x onerror=ran=1>'
    folder.mkdir(parents=True)
    hostile_log(sample, folder / "log.mcap")
    image = "<img src=x onerror=ran=1>"
    hostile_batch(served.folder / "runs" / f"batch {image}")
    (served.folder / "<b>mission.yaml").write_text(
        f"picktree: 1\nkind: mission\nname: '{MARKUP}'\nscene: '{image}'\n"
        f"trees:\n  Main: {{'{image}': {{pose: '{image}'}}}}\n"
        f"  '{image}': {{Grasp: {{'{image}': '{image}'}}}}\n"
    )
    (served.folder / f"{image}.yaml").write_text(
        f"picktree: 1\nkind: plan\nname: '{image}'\nmission: '{image}'\nset: {{'{image}': '{image}'}}\n"
    )
    addresses = (
        f"#/write/{quote('<b>mission.yaml')}",
        "#/write",
        "#/batches",
        f"#/plan/{quote(image)}.yaml",
        f"#/run/runs/{quote(folder.name)}",
        f"#/live/runs/{quote(folder.name)}",
        f"#/{MARKUP}",
        f"#/batch/runs/{quote(f'batch {image}')}",
    )
    for address in addresses:
        go(browser, address)
        browser.wait_for_timeout(700)
        assert browser.evaluate(f"[globalThis.ran ?? 0, {MADE_OF_TEXT}]") == [0, 0], address
    # The batch: its causes, forms and jobs.
    browser.get_by_role("heading", name=MARKUP).wait_for()
    browser.get_by_text(LINK).first.wait_for()
    browser.get_by_role("button", name=MARKUP).first.click()
    browser.wait_for_timeout(300)
    assert browser.evaluate(f"[globalThis.ran ?? 0, {MADE_OF_TEXT}]") == [0, 0]

    go(browser, "#/runs")
    link = browser.get_by_role("link", name=MARKUP)
    link.wait_for()
    link.click()
    browser.locator(".run-title h1").wait_for()
    assert MARKUP in browser.locator(".run-title h1").inner_text()
    failure = browser.locator(".failures button.failure").first
    failure.wait_for()
    frame = browser.frame_locator("iframe")
    frame.locator("html[data-ready=yes]").wait_for(state="attached")
    failure.click()
    assert f"grasp.{IMAGE}" in browser.get_by_role("region", name="Failures").inner_text()
    assert browser.evaluate(f"[globalThis.ran ?? 0, {MADE_OF_TEXT}]") == [0, 0]
    # The report has an origin of its own: nothing of the studio is within its reach.
    address = f"/runs/runs/{quote(folder.name)}/report"
    _, headers, _ = served.get(address)
    assert headers["content-security-policy"].startswith("sandbox allow-scripts;")
    inside = browser.frames[1]
    browser.wait_for_timeout(500)
    assert inside.evaluate("[globalThis.ran ?? 0, globalThis.origin]") == [0, "null"]
    assert inside.evaluate(MADE_OF_TEXT.replace("main img", "img[src=x]")) == 0
    with pytest.raises(Exception, match=r"SecurityError|cross-origin"):
        inside.evaluate("parent.document.title")
    assert [each for each in told.problems if "SecurityError" not in each] == []


@needs(packages("studio"))
def test_a_tree_of_a_thousand_nodes_opens_folds_and_is_used_by_keys(
    served: Served, page: tuple[Any, Told], tmp_path: Path
) -> None:
    browser, told = page
    bundle = tmp_path / "harness.js"
    done = subprocess.run(["node", "tree_harness.mjs", str(bundle)], cwd=HERE, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    browser.route(
        "**/page/studio.js", lambda route: route.fulfill(path=str(bundle), content_type="text/javascript")
    )
    browser.goto(f"http://127.0.0.1:{served.port}/")
    browser.locator(".tree-card").first.wait_for()
    assert browser.evaluate("globalThis.count") == 1000
    tree = browser.get_by_role("tree")
    tree.focus()
    seen = []
    for key in ("Home", "ArrowRight", "ArrowDown", "ArrowLeft"):
        browser.keyboard.press(key)
        seen.append(browser.evaluate("globalThis.selected"))
    assert seen == ["n0", "n1", "n2", "n0"]
    shown = browser.locator(".tree-card").count()
    browser.keyboard.press("-")
    wait_until(browser, "document.querySelectorAll('.tree-card').length === 1", PATIENCE)
    assert browser.locator("[aria-expanded=false]").count() == 1
    browser.keyboard.press("+")
    wait_until(browser, f"document.querySelectorAll('.tree-card').length >= {shown // 2}", PATIENCE)
    assert told.problems == []
