"""The report's page in a browser: it plays, seeks, goes to failures, folds, fits a phone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from picktree.analysis import Run
from picktree.analysis.render import bin_tints
from picktree.analysis.report import write_report
from picktree.session import RunRequest, Session

from ..browser import Chromium, Told, frames, on_top, wait_until
from ..needs import CHROMIUM, needs
from ..recorded_runs import pick_from_a_tote

pytestmark = needs(CHROMIUM)

TIME = "picktreeReport.player.time"


@pytest.fixture(scope="module")
def failures(troubled_log: Path) -> list[float]:
    """Their times."""
    with Run(troubled_log) as run:
        return [failure.time for failure in run.failures]


def seek(page: Any, time: float) -> None:
    page.evaluate(f"picktreeReport.player.seek({time})")


@pytest.fixture(scope="module")
def desk(report: Path, chromium: Chromium) -> Iterator[tuple[Any, Told]]:
    """One page for many tests: loading it costs more than most of them. It remembers what is copied."""
    kept = """Object.defineProperty(navigator, "clipboard", {
      value: { writeText: async (text) => { globalThis.copied = text; } },
    });"""
    with chromium.page(report, at="#t=1.25", script=kept) as (page, told):
        assert page.evaluate(TIME) == 1.25
        yield page, told


@pytest.fixture(scope="module")
def phone(report: Path, chromium: Chromium) -> Iterator[tuple[Any, Told]]:
    with chromium.page(report, size=(390, 844), touch=True) as opened:
        yield opened


@pytest.fixture
def page(desk: tuple[Any, Told]) -> Iterator[Any]:
    """Page at the first tick with nothing chosen; errors and requests of the page fail the test."""
    page, told = desk
    page.set_viewport_size({"width": 1280, "height": 800})
    page.evaluate(
        """() => {
            const { player } = picktreeReport;
            player.pause();
            player.selectFailure(null);
            player.selectNode(null);
            player.seek(player.begin);
            document.activeElement?.blur();
        }"""
    )
    yield page
    assert (told.problems, told.requests) == ([], [])


def test_play_moves_time_at_the_chosen_speed(page: Any) -> None:
    assert page.title() == "sort by colour, sort_small, seed 0"
    assert page.locator("#head h1").inner_text() == "sort by coloursort_small · seed 0"
    page.keyboard.press("Space")
    wait_until(page, f"{TIME} > 0.15")
    assert page.locator("#play").get_attribute("aria-label") == "Pause"
    page.keyboard.press("Space")
    stopped = page.evaluate(TIME)
    frames(page, 5)
    assert page.evaluate(TIME) == stopped
    page.locator("#speed").select_option("16")
    page.locator("#play").click()
    wait_until(page, f"{TIME} === picktreeReport.player.end && !picktreeReport.player.playing")
    page.keyboard.press("Space")  # from the end it begins anew
    wait_until(page, f"{TIME} < picktreeReport.player.end / 2")
    page.locator("#speed").select_option("1")


def test_keys_go_by_ticks_seconds_and_to_the_ends(page: Any) -> None:
    seek(page, 2.0)
    for key, time in (
        ("ArrowRight", 2.05), ("ArrowLeft", 2.0), ("Shift+ArrowRight", 3.0), ("Shift+ArrowLeft", 2.0),
        ("Home", 0.0),
    ):  # fmt: skip
        page.keyboard.press(key)
        assert page.evaluate(TIME) == pytest.approx(time), key
    page.keyboard.press("End")
    assert page.evaluate(f"{TIME} === picktreeReport.player.end")
    page.keyboard.press("?")
    assert page.locator("#help").is_visible()
    page.keyboard.press("Escape")
    assert not page.locator("#help").is_visible()


def test_scrubber_seeks_and_the_clock_follows(page: Any) -> None:
    box = page.locator("#scrub").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert page.evaluate(TIME) == pytest.approx(page.evaluate("picktreeReport.player.end / 2"), abs=0.2)
    assert wait_until(
        page, "document.getElementById('clock').textContent === `${picktreeReport.player.time.toFixed(2)} s`"
    )


def test_next_and_previous_failure(page: Any, failures: list[float]) -> None:
    assert failures
    for time in failures:
        page.keyboard.press("n")
        assert page.evaluate(TIME) == time
    page.keyboard.press("n")  # there is none after the last
    assert page.evaluate("picktreeReport.player.failure") == len(failures) - 1
    node = page.evaluate("picktreeReport.player.node")
    assert node == page.evaluate("picktreeReport.player.failures.at(-1).node")
    page.keyboard.press("Home")
    page.locator("#failure-after").click()
    assert page.evaluate(TIME) == failures[0]
    page.keyboard.press("End")
    page.keyboard.press("p")
    assert page.evaluate(TIME) == failures[-1]


def test_address_and_time_follow_each_other(page: Any, failures: list[float]) -> None:
    seek(page, 1.25)
    page.keyboard.press("ArrowRight")
    assert wait_until(page, "location.hash === '#t=1.3'")
    clock = "document.getElementById('clock').textContent"
    page.evaluate("location.hash = '#t=0.5'")
    assert wait_until(page, f"{clock} === '0.50 s'")
    assert page.evaluate(TIME) == 0.5
    page.evaluate("location.hash = '#failure=1'")
    assert wait_until(page, f"{clock} === '{failures[0]:.2f} s'")
    assert page.locator(".story.chosen").get_attribute("data-number") == "0"
    assert wait_until(page, "location.hash.includes('failure=1')")


def test_link_to_a_tick_is_copied(page: Any, report: Path) -> None:
    seek(page, 1.5)
    page.locator("#link").click()
    wait_until(page, "globalThis.copied !== undefined")
    assert page.evaluate("globalThis.copied") == f"{report.as_uri()}#t=1.5"


def test_what_was_folded_and_the_chosen_colours_stay(report: Path, chromium: Chromium) -> None:
    theme = "document.documentElement.dataset.theme"
    with chromium.page(report, at="#t=nonsense", dark=True) as (page, told):
        assert page.evaluate(TIME) == 0.0
        assert told.problems == []
        assert page.evaluate(theme) == "dark"
        page.locator("#theme").click()
        assert page.evaluate(theme) == "light"
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(246, 247, 249)"
        fold = page.locator("#panel-stage .fold")
        assert fold.get_attribute("aria-expanded") == "true"
        fold.click()
        assert fold.get_attribute("aria-expanded") == "false"
        assert not page.locator("#body-stage").is_visible()
        page.reload()
        page.wait_for_selector("html[data-ready=yes]", state="attached")
        assert page.evaluate(theme) == "light"
        assert not page.locator("#body-stage").is_visible()
        fold.focus()
        page.keyboard.press("Space")  # the key of the button that has the focus, not of the player
        assert page.locator("#body-stage").is_visible()
        assert not page.evaluate("picktreeReport.player.playing")


def test_scene_moves_with_time_and_shows_what_was_taken_away(page: Any, failures: list[float]) -> None:
    stage = "picktreeReport.shell.panels.find((panel) => panel.name === 'stage').made"
    gone = f"{stage}.truths.filter((one) => one.state === 'gone').length"
    wait_until(page, f"{stage}.views.sized && !{stage}.moved && {gone} === 0")
    start = page.evaluate(f"{stage}.robot.tcp.toArray()")
    page.evaluate(f"picktreeReport.player.seek({failures[0]})")
    wait_until(page, f"{gone} === 1")
    assert page.evaluate(f"{stage}.robot.tcp.toArray()") != start
    assert page.locator(".tag.apart").first.inner_text() == "not there"
    truth = page.get_by_role("button", name="Truth", exact=True)
    truth.click()
    page.wait_for_selector(".tag.apart", state="hidden")
    truth.click()


def test_scene_is_looked_at_from_all_sides(page: Any) -> None:
    seek(page, 2.0)
    views = "picktreeReport.shell.panels.find((panel) => panel.name === 'stage').made.views"
    wait_until(page, f"{views}.sized")
    chooser = page.get_by_label("View", exact=True)
    names = chooser.locator("option").all_inner_texts()
    assert names[:5] == ["Overview", "Front", "Left", "Right", "Top"]
    assert names[5:] == ["Camera overhead", "Follow the hand", "Your own view"]
    places = []
    for name in names[:-1]:
        chooser.select_option(name)
        places.append(tuple(page.evaluate(f"{views}.camera.position.toArray()")))
    assert len(set(places)) == len(places)
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Shift+ArrowRight")  # it follows the hand now
    wait_until(page, f"{views}.camera.position.x !== {places[-1][0]}")
    chooser.select_option("Overview")
    box = page.locator("#panel-stage canvas").bounding_box()
    page.mouse.move(box["x"] + 80, box["y"] + 80)
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + 80, steps=3)
    page.mouse.up()
    assert chooser.input_value() == "Your own view"
    assert page.evaluate(f"{views}.camera.position.toArray()") != list(places[0])


def test_without_webgl_the_rest_works(report: Path, chromium: Chromium) -> None:
    without = """HTMLCanvasElement.prototype.getContext = ((known) => function (kind, ...rest) {
      return kind.startsWith("webgl") ? null : known.call(this, kind, ...rest);
    })(HTMLCanvasElement.prototype.getContext);"""
    with chromium.page(report, script=without) as (page, _):
        assert page.locator("#panel-stage .empty").inner_text() == (
            "This browser cannot draw in 3-D (WebGL is missing or switched off). The rest of this page works."
        )
        page.keyboard.press("End")
        assert page.evaluate(f"{TIME} === picktreeReport.player.end")


def test_page_of_a_cut_log_says_so_and_works(troubled_log: Path, tmp_path: Path, chromium: Chromium) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(troubled_log.read_bytes()[: troubled_log.stat().st_size * 3 // 4])
    with Run(cut) as run:
        write_report(run, tmp_path / "cut.html")
        said = run.recovered
    with chromium.page(tmp_path / "cut.html") as (page, told):
        assert page.locator("#notes").inner_text() == said
        assert page.locator("#head").inner_text().split("\n")[-2:] == ["killed", "About"]
        page.get_by_text("About", exact=True).click()
        facts = page.locator(".about dl")
        assert "the log ends at " in facts.inner_text()
        page.mouse.click(700, 400)
        assert not facts.is_visible()
        page.keyboard.press("End")
        frames(page, 5)
        assert (told.problems, told.requests) == ([], [])


FIXED = ("#play", "#scrub", "#clock", "#panel-stage canvas")
"""Parts of the page that are in sight on any screen."""


def cut_off(page: Any, size: tuple[int, int]) -> list[str]:
    """Return the parts of `FIXED` that a window of that size, px, does not show whole and on top."""
    page.set_viewport_size({"width": size[0], "height": size[1]})
    frames(page, 3)
    boxes = {name: page.locator(name).bounding_box() for name in FIXED}
    return [
        name
        for name, box in boxes.items()
        if box["x"] < 0
        or box["x"] + box["width"] > size[0]
        or box["y"] < 0
        or box["y"] + box["height"] > size[1]
        or not on_top(page, name)
    ]


def extent(page: Any) -> tuple[int, int]:
    """Return width and height of the page with all that one would have to scroll to, px."""
    return tuple(
        page.evaluate("(({ scrollWidth: w, scrollHeight: h }) => [w, h])(document.scrollingElement)")
    )


@pytest.mark.parametrize("size", [(800, 600), (1280, 800), (1920, 1080)])
def test_page_fits_the_screen(size: tuple[int, int], page: Any) -> None:
    assert cut_off(page, size) == []
    assert extent(page) == size


@pytest.mark.parametrize("size", [(360, 640), (390, 844)])
def test_page_fits_a_phone(size: tuple[int, int], phone: tuple[Any, Told]) -> None:
    page, told = phone
    assert cut_off(page, size) == []
    assert extent(page) == size
    assert told.problems == []


def test_tabs_show_one_panel_at_a_time_on_a_phone(phone: tuple[Any, Told]) -> None:
    page, _ = phone
    page.set_viewport_size({"width": 390, "height": 844})
    tabs = page.get_by_role("tab")
    assert tabs.count() >= 2
    for index in range(tabs.count()):
        tabs.nth(index).click()
        shown = page.locator(".panel:visible").evaluate_all("all => all.map((one) => one.id)")
        assert shown == ["panel-stage", tabs.nth(index).get_attribute("aria-controls")]
        assert page.evaluate("document.scrollingElement.scrollWidth") <= 390


STAGE = 'picktreeReport.shell.panels.find((panel) => panel.name === "stage").made'


def test_a_heap_changes_with_its_looks_and_its_grasps_tell_why(tmp_path: Path, chromium: Chromium) -> None:
    mission = pick_from_a_tote(tmp_path)
    log = Session(RunRequest(mission, seed=5, out=tmp_path)).run().log
    with Run(log) as run:
        write_report(run, tmp_path / "report.html")
        search, end = run.candidates[0].time, run.end
        assert bin_tints(run.log) == {"red_bin": "red", "blue_bin": "blue"}
    with chromium.page(tmp_path / "report.html", at=f"#t={search + 0.05}") as (page, told):
        words = ".view .said .heights, .view .said .choice"
        heap, taken = page.locator(words).all_inner_texts()
        assert heap.startswith("0 … 100 mm; tote_heap: up to ")
        assert taken.startswith("tote_heap: ") and taken.endswith(" 1 taken")
        assert page.evaluate(f"{STAGE}.choices.verdict(0)").endswith(": accepted")
        meshes = f'{STAGE}.believed.find(({{ id }}) => id === "tote_heap").group.children'
        shown = f"{meshes}.findIndex((mesh) => mesh.visible)"
        before = page.evaluate(shown)
        seek(page, end)
        assert wait_until(page, f"{shown} > {before}")
        assert (told.problems, told.requests) == ([], [])
