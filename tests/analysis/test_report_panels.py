"""The report's panels in a browser: each shows the moment, and leads to others."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from picktree.analysis import Run
from picktree.analysis.explain import FailureStory
from picktree.analysis.report import write_report
from picktree.logs.node_visits import Visit

from ..browser import Chromium, Told, frames, wait_until
from ..logs.scripted_log import begins, ends, record, tree
from ..needs import CHROMIUM, needs

pytestmark = needs(CHROMIUM)

TIME = "picktreeReport.player.time"
NODE = "picktreeReport.player.node"
LANES = "picktreeReport.shell.panels.find(({ name }) => name === 'lanes').made"
PLOTS = "picktreeReport.shell.panels.find(({ name }) => name === 'plots').made"
GRASP = "Main/Repeat/Sequence/ForEach/SortOne/Recover/Sequence/Grasp"


@pytest.fixture(scope="module")
def failures(troubled_log: Path) -> tuple[FailureStory, ...]:
    with Run(troubled_log) as run:
        return run.explanation.failures


@pytest.fixture(scope="module")
def grasps(troubled_log: Path) -> list[Visit]:
    with Run(troubled_log) as run:
        return [visit for visit in run.visits if visit.path == GRASP]


@pytest.fixture(scope="module")
def desk(report: Path, chromium: Chromium) -> Iterator[tuple[Any, Told]]:
    """One page for all, its scene folded away: drawing that without a graphics card takes long."""
    folded = "localStorage.setItem('picktree.report.closed.stage', 'yes')"
    with chromium.page(report, size=(1280, 1000), script=folded) as opened:
        yield opened


@pytest.fixture
def page(desk: tuple[Any, Told]) -> Iterator[Any]:
    """Page at the first tick with nothing chosen; errors and requests of the page fail the test."""
    page, told = desk
    page.mouse.move(0, 0)
    page.evaluate(
        """() => {
            const { player } = picktreeReport;
            player.pause();
            player.selectFailure(null);
            player.selectNode(null);
            player.seek(player.begin);
        }"""
    )
    settled(page)
    yield page
    assert (told.problems, told.requests) == ([], [])


def settled(page: Any) -> None:
    """Wait until all panels were told of the time."""
    wait_until(
        page, "(({ shown, time, tick }) => shown.time === time && shown.tick === tick)(picktreeReport.player)"
    )
    frames(page, 2)


def test_above_the_failures_stands_what_was_tried_and_what_was_planted(page: Any) -> None:
    causes = page.locator("#panel-failures .causes li")
    assert causes.locator("code").all_inner_texts() == ["grasp.missed", "world.unknown_object"]
    assert causes.locator(".fate").all_inner_texts() == ["0 of 1 cured"] * 2
    assert "none cured (tried: SafeRetreat + Observe)" in causes.first.inner_text()
    planted = page.locator("#panel-failures .moments").first.inner_text()
    assert "is snatched away: grasp.missed" in planted
    assert planted.endswith("given up")


def test_nothing_in_the_story_of_a_failure_is_cut_off(page: Any) -> None:
    page.evaluate("picktreeReport.player.selectFailure(0)")
    headings = page.locator(".story.chosen h4").all_inner_texts()
    assert any(re.fullmatch(r"Choice of a grasp for \w+, [\d.]+ s", heading) for heading in headings)
    wide = "(one) => one.clientWidth && one.scrollWidth > one.clientWidth"
    boxes = "[...document.querySelectorAll('.story.chosen, .story.chosen *')]"
    assert page.evaluate(f"{boxes}.filter({wide}).map((one) => one.textContent)") == []


def test_the_list_of_failures_leads_to_each_of_them(page: Any, failures: tuple[FailureStory, ...]) -> None:
    stories = page.locator(".story")
    assert stories.count() == len(failures) >= 2
    stories.nth(1).locator(".story-main").click()
    wait_until(page, f"Math.abs({TIME} - {failures[1].time}) < 1e-6")
    assert page.evaluate(NODE) == failures[1].node
    assert page.locator(".story.chosen").get_attribute("data-number") == "1"
    assert failures[1].cause in stories.nth(1).inner_text()
    page.keyboard.press("p")
    wait_until(page, f"Math.abs({TIME} - {failures[0].time}) < 1e-6")
    wait_until(page, "document.querySelector('.story.chosen.present')?.dataset.number === '0'")
    told = stories.nth(0).inner_text()
    assert failures[0].sentence in told
    assert (
        f"at {failures[0].fate_at:.2f} s by {'/'.join(failures[0].fate_by.split('/')[-2:])}.".replace(
            "/", " › "
        )
        in told
    )
    assert "[object" not in told
    stories.nth(0).locator(".play").click()
    wait_until(page, "picktreeReport.player.playing")
    assert page.evaluate(TIME) < failures[0].time


def test_the_present_failure_is_brought_into_the_sight_of_its_list(page: Any) -> None:
    page.evaluate("picktreeReport.player.selectFailure(picktreeReport.player.failures.length - 1)")
    frames(page, 2)
    seen = page.evaluate(
        """() => {
            const box = document.querySelector(".failures-scroll").getBoundingClientRect();
            const card = document.querySelector(".story.chosen").getBoundingClientRect();
            return card.top >= box.top && card.top < box.bottom - 20;
        }"""
    )
    assert seen


def row(page: Any, name: str) -> Any:
    return page.locator(f".lanes-name[title='{name}']")


def test_lanes_close_and_open_as_the_tree_does(page: Any) -> None:
    assert row(page, GRASP).count() == 1
    for_each = "Main/Repeat/Sequence/ForEach"
    row(page, for_each).locator(".twisty").click()
    assert row(page, GRASP).count() == 0
    assert row(page, for_each).get_attribute("aria-expanded") == "false"
    row(page, for_each).focus()
    page.keyboard.press("ArrowRight")
    assert row(page, GRASP).count() == 1
    page.locator("#panel-lanes [title='Close all']").click()
    assert page.locator(".lanes-name").all_inner_texts() == ["▾\nMain", "▸\nRepeat"]
    page.locator("#panel-lanes [title='Open all']").click()
    assert row(page, GRASP).count() == 1


def test_lanes_show_what_ran_what_failed_and_what_is_searched(page: Any, grasps: list[Visit]) -> None:
    names = page.locator(".lanes-name")
    ran = names.count()
    page.get_by_label("Which nodes").select_option("all")
    everything = names.count()
    page.get_by_label("Which nodes").select_option("failed")
    failed = names.count()
    assert 0 < failed < ran < everything
    assert row(page, GRASP).locator(".count").inner_text() == str(sum(g.failed_itself for g in grasps))
    page.get_by_label("Which nodes").select_option("all")
    page.get_by_label("Find a node").fill("safer")
    hits = page.locator(".lanes-name.hit .said").all_inner_texts()
    assert set(hits) == {"SafeRetreat"}
    page.keyboard.press("Escape")
    assert names.count() == everything
    page.get_by_label("Which nodes").select_option("ran")
    assert names.count() == ran


def at(page: Any, time: float, path: str) -> tuple[float, float]:
    """Return the point (x, y) of a node's lane at a time, in pixels of the screen."""
    return tuple(
        page.evaluate(
            """([time, path]) => {
                const lanes = picktreeReport.shell.panels.find(({ name }) => name === "lanes").made;
                lanes.scroller.scrollIntoView({ block: "center" });
                const box = lanes.canvas.getBoundingClientRect();
                const line = document.querySelector(`.lanes-name[title='${path}']`).getBoundingClientRect();
                return [box.left + lanes.span.x(time), line.top + line.height / 2];
            }""",
            [time, path],
        )
    )


def test_a_bar_tells_its_visit_and_a_click_goes_there(page: Any, grasps: list[Visit]) -> None:
    failed = next(visit for visit in grasps if visit.outcome == "FAILURE")
    middle = (failed.start + failed.end) / 2
    page.mouse.move(*at(page, middle, GRASP))
    tip = page.locator(".lanes > .tip").inner_text()
    assert f"FAILURE: {failed.cause}" in tip
    assert f"{failed.start:.2f} s – {failed.end:.2f} s" in tip
    assert failed.item in tip
    assert failed.message in tip
    page.mouse.click(*at(page, middle, GRASP))
    wait_until(page, f"Math.abs({TIME} - {middle}) < 0.1")
    assert page.evaluate(NODE) == GRASP
    wait_until(page, f"document.querySelector(\".lanes-name[title='{GRASP}']\").dataset.status === 'running'")
    assert "running now" in page.locator(".lanes-details").inner_text()
    page.get_by_label("Its next visit").click()
    following = grasps[grasps.index(failed) + 1]
    wait_until(page, f"Math.abs({TIME} - {following.start}) < 1e-6")


def test_lanes_zoom_and_move_in_time(page: Any) -> None:
    span = f"(({{ from, to }}) => [from, to])({LANES}.span)"
    whole = page.evaluate(span)
    page.mouse.move(*at(page, 10.0, GRASP))
    page.keyboard.down("Control")
    page.mouse.wheel(0, -100)
    page.keyboard.up("Control")
    wait_until(page, f"{span}[1] - {span}[0] < {0.8 * (whole[1] - whole[0])}")
    zoomed = page.evaluate(span)
    assert zoomed[0] < 10 < zoomed[1]
    x, y = at(page, 10.0, GRASP)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 60, y, steps=4)
    page.mouse.up()
    moved = page.evaluate(span)
    assert moved[0] > zoomed[0] + 0.3
    assert moved[1] - moved[0] == pytest.approx(zoomed[1] - zoomed[0])
    page.get_by_label("Show the whole run").first.click()
    assert page.evaluate(span) == whole


def painted(page: Any, panel: str, canvas: str) -> Callable[[str], bool]:
    """Whether a canvas of a panel shows a colour of the page."""

    def found(colour: str) -> bool:
        return page.evaluate(
            """([panel, selector, colour]) => {
                const canvas = document.querySelector(`#panel-${panel} ${selector}`);
                const probe = document.createElement("canvas").getContext("2d");
                probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(`--${colour}`);
                probe.fillRect(0, 0, 1, 1);
                const [r, g, b] = probe.getImageData(0, 0, 1, 1).data;
                const { width, height } = canvas;
                const copy = Object.assign(document.createElement("canvas"), { width, height });
                const context = copy.getContext("2d", { willReadFrequently: true });
                context.drawImage(canvas, 0, 0);
                const { data } = context.getImageData(0, 0, width, height);
                for (let i = 0; i < data.length; i += 4) {
                    if (data[i] === r && data[i + 1] === g && data[i + 2] === b) return true;
                }
                return false;
            }""",
            [panel, canvas, colour],
        )

    return found


def test_lanes_are_painted_in_the_colours_of_the_page(page: Any) -> None:
    found = painted(page, "lanes", ".lanes-canvas")
    for theme in ("dark", "light"):
        page.locator("#theme").click()
        assert page.evaluate("document.documentElement.dataset.theme") == theme
        for name in ("success", "failure", "success_fill"):
            for _ in range(100):  # it is painted with the next frame
                if found(name):
                    break
                frames(page, 2)
            else:
                pytest.fail(f"nothing is painted in {name} when it is {theme}")
        assert not found("found")


def test_the_drawn_tree_shows_the_statuses_of_the_tick(page: Any, failures: tuple[FailureStory, ...]) -> None:
    page.locator("#panel-tree").scroll_into_view_if_needed()
    page.evaluate("picktreeReport.player.selectFailure(0)")
    node = page.locator(f"#panel-tree [data-path='{failures[0].node}']")
    node.wait_for(state="attached")
    wait_until(
        page, f"document.querySelector(\"#panel-tree [data-path='{GRASP}']\").classList.contains('failure')"
    )
    assert "selected" in node.get_attribute("class")
    assert page.locator("#panel-tree .edge.failure").count() >= 1
    page.evaluate(f"picktreeReport.player.seek({failures[0].time} - 0.5)")
    wait_until(
        page, f"document.querySelector(\"#panel-tree [data-path='{GRASP}']\").classList.contains('running')"
    )
    assert page.locator("#panel-tree .edge.running").count() >= 4
    page.locator("#panel-tree").get_by_role("button", name="Show the whole tree").click()
    page.locator("#panel-tree [data-path='Main/Repeat'] .id").click()
    assert page.evaluate(NODE) == "Main/Repeat"
    assert row(page, "Main/Repeat").get_attribute("aria-selected") == "true"


def test_plots_follow_the_time_and_lead_to_others(page: Any) -> None:
    names = page.locator(".plot").evaluate_all("plots => plots.map((plot) => plot.dataset.plot)")
    assert names == ["position", "velocity", "tracking", "force", "torque", "width", "grip"]
    width = page.locator("[data-plot=width]")
    width.scroll_into_view_if_needed()
    over = width.locator(".u-over").bounding_box()
    page.mouse.click(over["x"] + over["width"] / 2, over["y"] + 40)
    wait_until(page, f"Math.abs({TIME} - picktreeReport.player.end / 2) < 0.5")
    assert float(width.locator(".plot-values").inner_text()) >= 0
    page.mouse.move(over["x"] + 40, over["y"] + 40)
    page.mouse.down()
    page.mouse.move(over["x"] + over["width"] / 2, over["y"] + 40, steps=3)
    frames(page, 2)
    page.mouse.up()
    scales = f"{PLOTS}.all.filter(({{ chart }}) => chart).map(({{ chart }}) => chart.scales.x.max)"
    wait_until(page, f"{scales}.every((max) => max < 0.6 * picktreeReport.player.end)")
    assert len(page.evaluate(scales)) == 5
    page.get_by_role("button", name="Whole run", exact=True).click()
    wait_until(page, f"{scales}.every((max) => Math.abs(max - picktreeReport.player.end) < 0.1)")
    position = page.locator("[data-plot=position] .u-series").nth(1)
    position.locator("th").click()
    assert "u-off" in position.get_attribute("class")


def test_the_camera_shows_the_last_image_and_its_strip_leads_to_each(page: Any) -> None:
    taken = page.evaluate("picktreeReport.sections.images.images.map(({ time }) => time)")
    assert len(taken) >= 2
    page.locator(".thumb").nth(1).click()
    wait_until(page, f"Math.abs({TIME} - {taken[1]}) < 1e-6")
    settled(page)
    wait_until(page, "document.querySelector('.images-views img').naturalWidth === 320")
    assert f"{taken[1]:.2f} s taken now" in page.locator("figcaption").inner_text()
    assert page.locator(".thumb[aria-selected=true]").count() == 1
    page.get_by_role("button", name="Depth").click()
    assert page.locator(".images-views img").nth(1).is_visible()


def test_belief_and_blackboard_are_those_of_the_tick(page: Any, troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        taken = next(event.time for event in run.events if event.record.kind == "fault")
        moment = run.at(taken + 1.0)
        assert moment.belief is not None
        believed = {body.id for body in moment.belief.bodies}
        written = dict(moment.blackboard)
    page.evaluate(f"picktreeReport.player.seek({taken + 1.0})")
    settled(page)
    shown = page.locator(".belief tbody tr:visible:not(.gone) th").all_inner_texts()
    assert set(shown) == believed
    assert page.locator(".belief .off.lost").all_inner_texts() == ["not there"]
    keys = ".blackboard tr:not(.gone) th[scope=row]"
    assert set(page.locator(keys).evaluate_all("(all) => all.map((one) => one.title)")) == set(written)
    item = page.locator(".blackboard tr", has=page.locator("th[title='Main/item']"))
    assert item.locator(".value").inner_text() == written["Main/item"]
    changed = "[...document.querySelectorAll('.blackboard tr.changed th')].map((one) => one.title)"
    row = page.evaluate(
        "picktreeReport.sections.board.writes.tick[picktreeReport.sections.board.writes.tick.length - 1]"
    )
    page.evaluate(f"picktreeReport.player.seekTick({row})")
    wait_until(page, f"{changed}.length > 0")
    page.evaluate(f"picktreeReport.player.seekTick({row + 1})")
    wait_until(page, f"{changed}.length === 0")


def test_events_go_along_and_lead_to_their_moment(page: Any) -> None:
    rows = page.locator(".events-list li:visible")
    kinds = set(rows.evaluate_all("rows => rows.map((row) => row.dataset.kind)"))
    assert {"failure", "recovery", "fault", "item_done"} <= kinds
    assert not kinds & {"belief", "plan"}
    page.locator(".events-chips button", has_text="plan").first.click()
    assert page.locator(".events-list li[data-kind=plan]:visible").count() > 0
    fault = page.locator(".events-list li[data-kind=fault]")
    time = float(fault.locator("time").inner_text())
    fault.locator("button").click()
    wait_until(page, f"Math.abs({TIME} - {time}) < 1e-6")
    wait_until(page, f"+document.querySelector('.events-list .present time')?.textContent === {time}")


@pytest.fixture(scope="module")
def phone(report: Path, chromium: Chromium) -> Iterator[tuple[Any, Told]]:
    with chromium.page(report, size=(390, 844), at="#failure=1", touch=True) as opened:
        yield opened


def test_panels_fit_a_phone(phone: tuple[Any, Told]) -> None:
    page, told = phone
    for name in ("failures", "lanes", "tree", "board", "images", "events", "plots"):
        page.locator(f"#tab-{name}").click()
        frames(page, 2)
        panel = page.locator(f"#panel-{name}")
        assert panel.is_visible(), name
        assert page.evaluate(f"document.querySelector('#panel-{name}').scrollWidth") <= 390, name
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert told.problems == []


def test_a_tap_on_a_bar_tells_its_visit(phone: tuple[Any, Told], grasps: list[Visit]) -> None:
    page, _ = phone
    page.locator("#tab-lanes").click()
    frames(page, 2)
    page.touchscreen.tap(*at(page, (grasps[0].start + grasps[0].end) / 2, GRASP))
    wait_until(page, f"{NODE} === '{GRASP}'")
    assert "Grasp" in page.locator(".lanes > .tip").inner_text()


COUNTING = """for (const [name, { value }] of Object.entries(
  Object.getOwnPropertyDescriptors(CanvasRenderingContext2D.prototype),
)) {
  if (typeof value !== "function") continue;
  CanvasRenderingContext2D.prototype[name] = function (...given) {
    globalThis.drawn = (globalThis.drawn ?? 0) + 1;
    return value.apply(this, given);
  };
}"""


def test_many_visits_of_a_large_tree_are_drawn_with_few_strokes(tmp_path: Path, chromium: Chromium) -> None:
    """200 nodes that are looked at on and on, as guards are."""
    guards = [f"Main/G{k:03d}" for k in range(199)]
    script = {
        0: [begins("Main")],
        **{
            tick: [move for path in guards for move in (begins(path), ends(path))]
            for tick in range(1, 600, 12)
        },
    }
    file = tmp_path / "large.html"
    with Run(record(tmp_path / "log.mcap", tree("Main", *guards), 600, script)) as run:
        write_report(run, file)
    with chromium.page(file, script=COUNTING) as (page, told):
        strokes = page.evaluate(
            """() => {
                const lanes = picktreeReport.shell.panels.find(({ name }) => name === "lanes").made;
                globalThis.drawn = 0;
                lanes.draw();
                return globalThis.drawn;
            }"""
        )
        assert 0 < strokes < 10 * 200  # there are 9,950 visits
        assert page.locator(".lanes-name").count() == 200
        assert told.problems == []
