"""What is dragged in the page of a mission, and the keys that do the same: nodes, the palette, fixtures."""

from __future__ import annotations

import json
import re
import shutil
from typing import Any

import numpy as np
import pytest

from picktree.files.file_system import ROOT
from picktree.world.scene.scene_loading import SHIPPED

from ..browser import Told, wait_until
from ..needs import CHROMIUM, needs
from .conftest import Served
from .test_page import go, page
from .test_write_page import card, written

__all__ = ["page"]
pytestmark = needs(CHROMIUM)
NAME = "sort_by_colour.yaml"
SEQUENCE = "SortOne/Recover/Sequence"
GRASP = '          - Grasp: {object: "{item}"}'
PLACE = '          - Place: {object: "{item}", into: "{item.destination}"}'


def open_mission(served: Served, browser: Any, text: str | None = None) -> None:
    shutil.copyfile(ROOT / "examples" / NAME, served.folder / NAME)
    if text is not None:
        (served.folder / NAME).write_text(text, encoding="utf-8")
    go(browser, f"#/write/{NAME}")
    browser.get_by_text("✓ No faults").wait_for()


def drag(browser: Any, start: tuple[float, float], end: tuple[float, float]) -> None:
    browser.mouse.move(*start)
    browser.mouse.down()
    for part in np.linspace(0.1, 1.0, 8):
        browser.mouse.move(*(a + (b - a) * part for a, b in zip(start, end, strict=True)))
    browser.mouse.up()


def middle(box: dict[str, float]) -> tuple[float, float]:
    return box["x"] + 40, box["y"] + box["height"] / 2


def test_a_node_is_moved_by_drag_and_by_keys(served: Served, page: tuple[Any, Told]) -> None:
    browser, told = page
    open_mission(served, browser)
    before = (served.folder / NAME).read_text(encoding="utf-8")
    swapped = before.replace(f"{GRASP}\n{PLACE}\n", f"{PLACE}\n{GRASP}\n")
    assert swapped != before

    def saved() -> str:
        browser.keyboard.press("Control+s")
        wait_until(browser, "document.querySelector('.write-bar button').disabled")
        return (served.folder / NAME).read_text(encoding="utf-8")

    browser.locator(".cm-line", has_text="- Place:").click()
    place, grasp = card(browser, f"{SEQUENCE}/Place"), card(browser, f"{SEQUENCE}/Grasp")
    place.and_(browser.locator(".selected")).wait_for()
    browser.wait_for_timeout(300)
    start, onto = middle(place.bounding_box()), grasp.bounding_box()
    drag(browser, start, (start[0], start[1] - (place.bounding_box()["y"] - onto["y"]) - onto["height"] / 4))
    wait_until(browser, order_of("Place", "Grasp"))
    browser.locator(".cm-line", has_text="- Place:").click()
    assert saved() == swapped

    # By keys: down again, then out of the sequence and back into it.
    place.click()
    browser.keyboard.press("Alt+ArrowDown")
    wait_until(browser, order_of("Grasp", "Place"))
    browser.locator(".cm-line", has_text="- Place:").click()
    assert saved() == before
    browser.locator(".cm-line", has_text="GoTo:").get_by_text("GoTo", exact=True).click()
    goto = browser.locator(".tree-card.selected", has_text="GoTo")
    goto.click()
    path = goto.get_attribute("data-tree-node")
    assert path is not None
    browser.keyboard.press("Alt+ArrowLeft")
    card(browser, "Main/Repeat/Sequence/GoTo").and_(goto).wait_for()
    browser.keyboard.press("Alt+ArrowRight")
    card(browser, path).and_(goto).wait_for()
    assert "- Fallback: [SafeRetreat, {GoTo: {pose: home}}]" in written(browser)
    assert told.problems == []


def order_of(first: str, second: str) -> str:
    """Return a condition of the page: a line with the first node comes before one with the second."""
    lines = "[...document.querySelectorAll('.cm-line')].map((line) => line.textContent)"
    at = f"(name) => {lines}.findIndex((text) => text.includes(`- ${{name}}:`))"
    return f"(({at})('{first}') < ({at})('{second}'))"


def test_a_node_is_taken_from_the_palette(served: Served, page: tuple[Any, Told]) -> None:
    browser, told = page
    open_mission(served, browser)
    browser.locator(".cm-line", has_text="- Grasp:").click()
    grasp = card(browser, f"{SEQUENCE}/Grasp")
    grasp.and_(browser.locator(".selected")).wait_for()
    browser.get_by_role("tab", name="Add").click()
    browser.get_by_role("combobox", name="Search a node").fill("OpenGr")
    browser.get_by_role("option", name="OpenGripper").drag_to(grasp)
    card(browser, f"{SEQUENCE}/OpenGripper").wait_for()
    assert f"{GRASP}\n          - OpenGripper\n{PLACE}" in written(browser)
    assert told.problems == []


def on_screen(browser: Any, point: tuple[float, float, float]) -> tuple[float, float]:
    """Return where the first view of the scene panel shows a point of the world, px."""
    box = browser.locator(".scene-view canvas").bounding_box()
    eye, target = np.array([1.75, -1.25, 1.25]), np.array([0.35, 0.0, 0.1])
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    above = np.cross(right, ahead)
    offset = np.array(point) - eye
    half = box["height"] / 2 / np.tan(np.radians(42) / 2)
    depth = float(offset @ ahead)
    x = box["x"] + box["width"] / 2 + half * float(offset @ right) / depth
    y = box["y"] + box["height"] / 2 - half * float(offset @ above) / depth
    return x, y


def test_a_fixture_is_dragged_in_the_scene_and_only_its_line_changes(
    served: Served, page: tuple[Any, Told]
) -> None:
    browser, told = page
    scene, (x, y, z) = open_scene(served, browser)
    drag_bin(browser, (x, y, z))
    assert browser.get_by_label("Fixture or bin").input_value() == "red_bin"
    found = place_in(saved_line(served, browser, scene))
    # The hand takes the bin where the ray meets it first, which may be its rim.
    assert found == pytest.approx([x - 0.1, y + 0.05, z], abs=0.03)

    # By keys: a number, taken over with Enter.
    value = browser.get_by_label("x, m")
    assert float(value.input_value()) == pytest.approx(found[0], abs=1e-3)
    value.fill("0.4")
    value.press("Enter")
    assert place_in(saved_line(served, browser, scene)) == pytest.approx([0.4, *found[1:]], abs=1e-4)
    assert told.problems == []


def test_a_number_that_is_being_typed_outlives_the_answer_to_a_drag(
    served: Served, page: tuple[Any, Told]
) -> None:
    browser, told = page
    shows = HeldAnswers(browser, "scene.show")
    scene, at = open_scene(served, browser)
    shows.hold()
    drag_bin(browser, at)
    wait_until(browser, f"!{disabled('Save cell.yaml')}")
    value = browser.get_by_label("x, m")
    value.fill("0.4")
    shows.release()
    browser.wait_for_timeout(300)
    assert value.input_value() == "0.4"
    value.press("Enter")
    found = place_in(saved_line(served, browser, scene))
    assert found == pytest.approx([0.4, at[1] + 0.05, at[2]], abs=0.03)
    assert told.problems == []


def test_a_move_whose_text_is_on_its_way_is_saved_too(served: Served, page: tuple[Any, Told]) -> None:
    browser, told = page
    moves = HeldAnswers(browser, "scene.move")
    scene, at = open_scene(served, browser)
    drag_bin(browser, at)
    wait_until(browser, f"!{disabled('Save cell.yaml')}")
    moves.hold()
    value = browser.get_by_label("x, m")
    value.fill("0.4")
    value.press("Enter")
    browser.get_by_role("button", name="Save cell.yaml").click()
    browser.wait_for_timeout(300)
    moves.release()
    wait_until(browser, disabled("Save cell.yaml"))
    found = place_in(changed_line(scene, (served.folder / "cell.yaml").read_text(encoding="utf-8")))
    assert found == pytest.approx([0.4, at[1] + 0.05, at[2]], abs=0.03)
    assert told.problems == []


def open_scene(served: Served, browser: Any) -> tuple[str, tuple[float, float, float]]:
    """Open a mission's own scene; return its text and the place of its red bin, m."""
    scene = re.sub(r"  nut: .*\n|, nut: 1", "", (SHIPPED / "three_bins.yaml").read_text(encoding="utf-8"))
    (served.folder / "cell.yaml").write_text(scene, encoding="utf-8")
    mission = (ROOT / "examples" / NAME).read_text(encoding="utf-8")
    open_mission(served, browser, mission.replace("scene: three_bins ", "scene: cell.yaml "))
    browser.get_by_role("tab", name="Scene").click()
    browser.get_by_role("button", name="Save cell.yaml").wait_for()
    browser.locator(".scene-view canvas").scroll_into_view_if_needed()
    browser.wait_for_timeout(500)
    x, y, z = place_in(re.findall(r"red_bin:.*?(at: \[[^\]]*\])", scene, re.DOTALL)[0])
    return scene, (x, y, z)


def drag_bin(browser: Any, at: tuple[float, float, float]) -> None:
    """Drag the bin by -0.1 and 0.05 m, gripped near its floor."""
    x, y, height = at[0], at[1], at[2] + 0.005
    drag(browser, on_screen(browser, (x, y, height)), on_screen(browser, (x - 0.1, y + 0.05, height)))


def saved_line(served: Served, browser: Any, scene: str) -> str:
    """Save the scene, and return its only line that changed."""
    wait_until(browser, f"!{disabled('Save cell.yaml')}")
    browser.get_by_role("button", name="Save cell.yaml").click()
    wait_until(browser, disabled("Save cell.yaml"))
    return changed_line(scene, (served.folder / "cell.yaml").read_text(encoding="utf-8"))


def place_in(line: str) -> list[float]:
    return [float(word) for word in re.findall(r"at: \[([^\]]*)\]", line)[0].split(",")]


class HeldAnswers:
    """Answers to one call, which reach the page only when they are released."""

    def __init__(self, browser: Any, name: str) -> None:
        self._name, self._holds = name, False
        self._asked: set[int] = set()
        self._held: list[str] = []
        browser.route_web_socket("**/ws", self._connect)
        browser.reload()

    def hold(self) -> None:
        self._holds = True

    def release(self) -> None:
        self._holds = False
        for answer in self._held:
            self._page.send(answer)

    def _connect(self, page: Any) -> None:
        server = page.connect_to_server()
        self._page = page

        def ask(text: str) -> None:
            message = json.loads(text)
            if message.get("call") == self._name:
                self._asked.add(message["id"])
            server.send(text)

        def answer(text: str) -> None:
            waits = self._holds and json.loads(text).get("id") in self._asked
            if waits:
                self._held.append(text)
            else:
                page.send(text)

        page.on_message(ask)
        server.on_message(answer)


def disabled(name: str) -> str:
    return f"[...document.querySelectorAll('button')].find((each) => each.textContent === '{name}').disabled"


def changed_line(before: str, after: str) -> str:
    """Return the only line that is another one."""
    pairs = zip(before.split("\n"), after.split("\n"), strict=True)
    (line,) = (new for old, new in pairs if old != new)
    return line
